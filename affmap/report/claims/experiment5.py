"""The claims of Experiment V, disentanglement: trained in four worlds of one property, flown in random ones of all."""

from functools import partial

import numpy as np

from affmap.effects import EFFECTS
from affmap.report import statistics
from affmap.report.claims import encoding, parts
from affmap.report.claims.parts import Claim, Pair, Part
from affmap.report.metrics import METRICS
from affmap.report.statistics import Order
from affmap.report.tables import Results, score_matrix
from affmap.report.text import number

EASY, HARD = "procedural_easy", "procedural_hard"
"""Layouts."""

KINDS = ("obstacle", "fog", "force_up", "force_down")
"""Effects."""

NEARLY_ALWAYS = 0.9
"""Share of runs. The paper says "nearly all the time": at most one in ten fails."""


def _easy_beats_hard(results: Results) -> list[Part]:
    runs = parts.flown(results)
    found = []
    compared: dict[str, tuple[str, Order, str]] = {
        "success": ("success", "higher", "More runs succeed in easy worlds."),
        "error": ("prediction_error", "lower", "Errors are smaller in easy worlds."),
    }
    for name, (metric, order, says) in compared.items():
        outcome = parts.paired_at_every_size(runs, metric, Pair("layout", EASY, HARD), order)
        effect_of = "easy minus hard, mean over context sizes (p and verdict: of all of them)"
        found.append(Part(name, effect_of, METRICS[metric].unit, outcome, says))
    return found


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
        return [Part("", "share at the largest C", METRICS["success"].unit, outcome)]
    ways = runs[runs["crossable"].astype(bool)]
    note = f"where a way is known to exist: {number(ways['success'].mean())} ({len(ways)} of {len(runs)} runs)"
    effect_of = f"share at C = {runs['context_size'].iloc[0]}"
    return [Part("", effect_of, METRICS["success"].unit, parts.with_note(outcome, [note]))]


def _distinct(results: Results) -> list[Part]:
    """The paper says this of a figure, without a number."""
    painted = parts.largest_maps(results)
    found: list[Part] = []
    for name, kind in zip("abcd", KINDS, strict=True):
        others = ["free space", *(other for other in KINDS if other != kind)]
        contrast = partial(encoding.separation, kind=kind, others=others)
        label = EFFECTS[kind].label
        says = f"Codes of “{label}” are farther from those of every other kind than the codes of either scatter."
        effect_of = f"distance between “{label}” and another kind minus scatter of their codes, for the least distinct"
        found += parts.encoded(painted, contrast, "higher", name, effect_of, says)
    return found


CLAIMS = (
    Claim("V-1", "The validation loss falls with the context size.", parts.loss_falls),
    Claim("V-2", "At every context size, easy worlds are mastered better than hard ones.", _easy_beats_hard),
    Claim("V-3", "In easy and in hard worlds, control improves with the context size.", _improves),
    Claim(
        "V-4",
        f"With the largest context, runs in easy worlds succeed nearly always: at least {NEARLY_ALWAYS:g} of them.",
        _nearly_always,
    ),
    Claim("V-5", "The map of a world with all properties encodes each of them differently.", _distinct),
)
