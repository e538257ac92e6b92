"""The claims of Experiment V, disentanglement: trained in four worlds of one property, flown in random ones of all."""

import numpy as np

from affmap.report import statistics
from affmap.report.claims import parts
from affmap.report.claims.parts import METRICS, Claim, Pair, Part
from affmap.report.tables import Results, score_matrix
from affmap.report.text import number

EASY, HARD = "procedural_easy", "procedural_hard"
"""Layouts."""

NEARLY_ALWAYS = 0.9
"""Share of runs. The paper says "nearly all the time": at most one in ten fails."""


def _easy_beats_hard(results: Results) -> list[Part]:
    runs = parts.flown(results)
    more = parts.lower_at_every_size(runs, "success", Pair("layout", HARD, EASY))
    less = parts.lower_at_every_size(runs, "prediction_error", Pair("layout", EASY, HARD))
    over = "mean over context sizes (p and verdict: of all of them)"
    return [
        Part("success", f"hard minus easy, {over}", METRICS["success"], more, "More runs succeed in easy worlds."),
        Part(
            "error", f"easy minus hard, {over}", METRICS["prediction_error"], less, "Errors are smaller in easy worlds."
        ),
    ]


def _improves(results: Results) -> list[Part]:
    found = []
    for called, layout in (("easy", EASY), ("hard", HARD)):
        runs, who = parts.flown(results, layout), f"EB in {called} worlds"
        more, less = (
            f"{called}: more runs succeed with larger contexts.",
            f"{called}: the error falls with the context size.",
        )
        found.append(parts.trend(runs, "success", "rises", who, f"{called}, success", more))
        found.append(parts.trend(runs, "prediction_error", "falls", who, f"{called}, error", less))
    return found


def _nearly_always(results: Results) -> list[Part]:
    """A world may have no way for a vehicle that steers freely; how the other runs did is in the note."""
    runs = parts.flown(results, EASY)
    runs = runs[runs["context_size"] == runs["context_size"].max()]
    shares = score_matrix(runs, "success").to_numpy(float)[:, 0] if len(runs) else np.empty(0)
    outcome = statistics.at_least(shares, NEARLY_ALWAYS)
    if not len(runs):
        return [Part("", "share at the largest C", METRICS["success"], outcome)]
    ways = runs[runs["crossable"].astype(bool)]
    note = f"where a way is known to exist: {number(ways['success'].mean())} ({len(ways)} of {len(runs)} runs)"
    effect_of = f"share at C = {runs['context_size'].iloc[0]}"
    return [Part("", effect_of, METRICS["success"], parts.with_note(outcome, [note]))]


CLAIMS = (
    Claim("V-1", "The validation loss falls with the context size.", parts.loss_falls),
    Claim("V-2", "At every context size, easy worlds are mastered better than hard ones.", _easy_beats_hard),
    Claim("V-3", "In easy and in hard worlds, control improves with the context size.", _improves),
    Claim(
        "V-4",
        f"With the largest context, runs in easy worlds succeed nearly always: at least {NEARLY_ALWAYS:g} of them.",
        _nearly_always,
    ),
)
