"""The paper's claims about Experiment I as data, and their scores: pure functions of the results' tables.

A member's score is its mean over its runs; tests are paired by member (`statistics.py`). The validation loss is that
of the last epoch, whose weights control uses. Nothing here depends on what the verdicts turn out to be.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import pandas as pd

from affmap.report import maps, statistics
from affmap.report.statistics import Direction, Outcome, Verdict
from affmap.report.tables import PLANNERS, Floats, Results, score_matrix
from affmap.report.text import number, p_value

METRICS = {"validation_nll": "nats", "prediction_error": "nats", "mean_distance": "u"}
"""Metric -> unit."""

PAPER_RANGES = {"validation_nll": (-10.0, -8.0), "prediction_error": (-12.0, -8.0), "mean_distance": (0.4, 1.2)}
"""Metric -> lowest and highest axis tick of the paper's Figure 4; it prints no result as text."""


class Part(NamedTuple):
    """One test of a claim."""

    name: str
    """Empty, or the letter of the part where a claim has several."""
    effect_of: str
    """What the effect is the difference of."""
    outcome: Outcome
    statement: str = ""
    """What this part says where a claim has several."""


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper that can be tested."""

    name: str
    statement: str
    unit: str
    """Of the effect; `sd` is a standard deviation of a member's own map."""
    test: Callable[[Results], Sequence[Part]]


@dataclass(frozen=True)
class Score:
    """A claim and what its tests say."""

    claim: Claim
    parts: tuple[Part, ...]

    @property
    def verdict(self) -> Verdict:
        """Of all parts together."""
        return statistics.conjunction([part.outcome.verdict for part in self.parts])


def score(results: Results) -> list[Score]:
    """Test every claim."""
    return [Score(claim, tuple(claim.test(results))) for claim in CLAIMS]


def as_table(scores: Sequence[Score]) -> pd.DataFrame:
    """One row per part of each claim; empty cells where there is nothing to report."""
    rows = []
    for item in scores:
        for part in item.parts:
            outcome = part.outcome
            rows.append(
                {
                    "claim": item.claim.name,
                    "part": part.name,
                    "statement": part.statement or item.claim.statement,
                    "test": outcome.test,
                    "members": outcome.members,
                    "effect_of": part.effect_of,
                    "effect": outcome.effect,
                    "low": outcome.low,
                    "high": outcome.high,
                    "unit": item.claim.unit,
                    "p": outcome.p,
                    "p_opposite": outcome.p_opposite,
                    "part_verdict": outcome.verdict.value,
                    "verdict": item.verdict.value,
                    "note": outcome.note,
                }
            )
    return pd.DataFrame(rows).astype(dict.fromkeys(("effect", "low", "high", "p", "p_opposite"), float))


def medians(results: Results) -> pd.DataFrame:
    """Median of each setting (over members for the validation loss, over runs in control) and the paper's range."""
    losses = results.last_epoch.assign(planner="")
    tables = []
    for metric, unit in METRICS.items():
        values = losses if metric == "validation_nll" else results.runs
        groups = values.groupby(["planner", "context_size"])[metric]
        table = groups.agg(number="size", median=lambda scores: scores.median(skipna=False)).reset_index()
        low, high = PAPER_RANGES[metric]
        inside = table["median"].between(low, high)
        table = table.assign(unit=unit, paper_low=low, paper_high=high, inside=inside)
        table.insert(0, "metric", metric)
        tables.append(table)
    return pd.concat(tables, ignore_index=True).replace({"planner": PLANNERS})


def _validation_trend(results: Results) -> list[Part]:
    return [_trend(score_matrix(results.last_epoch, "validation_nll"), "falls")]


def _control_trend(results: Results, planner: str, metric: str, direction: Direction) -> list[Part]:
    runs = results.runs[results.runs["planner"] == planner]
    if runs.empty:
        outcome = statistics.undecided("Page's trend test", 0, f"{PLANNERS[planner]} was not run")
        return [Part("", "context sizes", outcome)]
    return [_trend(score_matrix(runs, metric), direction)]


def _trend(matrix: pd.DataFrame, direction: Direction) -> Part:
    effect_of = f"C = {matrix.columns[-1]} minus C = {matrix.columns[0]}"
    return Part("", effect_of, statistics.trend(matrix.to_numpy(), direction))


def _planners_without_context(results: Results) -> list[Part]:
    return [Part("", "GB minus EB at C = 0", _lower_distance(results.runs.query("context_size == 0"), "gradient"))]


def _planners_with_context(results: Results) -> list[Part]:
    runs = results.runs.query("context_size > 0")
    both = runs.groupby("context_size")["planner"].transform("nunique") == len(PLANNERS)
    outcome = _lower_distance(runs[both], "cem")
    each = [
        f"C = {size!s}: {_effect_and_p(_lower_distance(group, 'cem'))}"
        for size, group in runs[both].groupby("context_size")
    ]
    note = "; ".join(filter(None, [outcome.note, *each]))
    return [Part("", "EB minus GB, mean over C > 0", replace(outcome, note=note))]


def _lower_distance(runs: pd.DataFrame, better: str) -> Outcome:
    """Is the mean distance of the `better` planner lower than that of the other? Context sizes weigh the same."""
    worse = next(planner for planner in PLANNERS if planner != better)
    if set(runs["planner"]) != {better, worse}:
        return statistics.undecided("Wilcoxon signed-rank", 0, "needs runs of both planners")
    settings = score_matrix(runs, "mean_distance", ["planner", "context_size"])
    first, second = (settings[planner].to_numpy(dtype=float).mean(axis=1) for planner in (better, worse))
    return statistics.lower(first, second)


def _effect_and_p(outcome: Outcome) -> str:
    if outcome.effect is None or outcome.p is None:
        return outcome.note
    return f"{number(outcome.effect, sign=True)} u, p {p_value(outcome.p)}, {outcome.verdict}"


def _map_encoding(results: Results) -> list[Part]:
    size = max(results.maps, default=0)
    parts = []
    for name, (statement, effect_of, compare) in _ENCODING.items():
        if size:
            trained = compare(results.maps[size], results.world)
            untrained = compare(results.maps[size].untrained, results.world)
            outcome, learned = _contrasts(trained, untrained)
        else:
            outcome = learned = statistics.undecided("Wilcoxon signed-rank", 0, "needs a context size above 0")
        parts.append(Part(name, f"{effect_of}, C = {size}", outcome, statement))
        again = f"{statement.removesuffix('.')}: more so than in the same member's map before training."
        parts.append(Part(f"{name}, learned", "trained minus untrained of the same difference", learned, again))
    return parts


def _contrasts(trained: tuple[Floats, Floats], untrained: tuple[Floats, Floats]) -> tuple[Outcome, Outcome]:
    """Test whether the first distance is smaller than the second after training, and by more than before it.

    Similar pictures have similar codes in an untrained network, too; only the second test shows what was learned.
    """
    if not len(trained[0]):
        return _NOWHERE, _NOWHERE
    return statistics.lower(*trained), statistics.lower(trained[0] - trained[1], untrained[0] - untrained[1])


_ENCODING = {
    "a": (
        "Codes beside a surface are farther from the free-space code than codes elsewhere.",
        "distance to the free-space code, elsewhere minus beside",
        maps.obstacle_contrast,
    ),
    "b": (
        "Codes beside an obstacle's side are nearer to those beside the border side that blocks the same direction.",
        "distance to the matching minus to the other border sides",
        maps.side_match,
    ),
}

_NOWHERE = statistics.undecided("Wilcoxon signed-rank", 0, "this world has no place where the parts can be seen alone")

CLAIMS = (
    Claim("I-1", "The validation loss falls with the context size.", "nats", _validation_trend),
    Claim(
        "I-2",
        "EB: the prediction error falls with the context size.",
        "nats",
        partial(_control_trend, planner="cem", metric="prediction_error", direction="falls"),
    ),
    Claim(
        "I-3",
        "EB: the mean distance falls with the context size.",
        "u",
        partial(_control_trend, planner="cem", metric="mean_distance", direction="falls"),
    ),
    Claim(
        "I-4",
        "GB: the prediction error falls with the context size.",
        "nats",
        partial(_control_trend, planner="gradient", metric="prediction_error", direction="falls"),
    ),
    Claim(
        "I-5",
        "GB: the mean distance rises with the context size.",
        "u",
        partial(_control_trend, planner="gradient", metric="mean_distance", direction="rises"),
    ),
    Claim("I-6", "Without a context, GB comes closer to the goal than EB.", "u", _planners_without_context),
    Claim("I-7", "With a context, EB comes closer to the goal than GB.", "u", _planners_with_context),
    Claim(
        "I-8",
        "The map encodes obstacles unlike free space, and their sides like the matching sides of the border.",
        "sd",
        _map_encoding,
    ),
)
"""Claims I-1 to I-8. EB: evolutionary-based, GB: gradient-based."""
