"""Claims and their criteria, and tests of tables that several claims share. Knows no experiment.

A member's score is its mean over its runs; tests are paired by member (`statistics.py`). An average over context sizes
weighs them equally, and takes those only that both settings have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.env.layout import Layout
from affmap.results import statistics
from affmap.results.files import Floats, Maps
from affmap.results.metrics import METRICS
from affmap.results.numbers import number, p_value
from affmap.results.setting import CONTEXT_SIZE, Factor, Value
from affmap.results.statistics import Direction, Order, Outcome, Verdict
from affmap.results.tables import Results, score_matrix

SIGNED_RANK, TREND = "Wilcoxon signed-rank", "Page's trend test"

DECIDED_LATE = "that parts called “learned” do not count for the verdict was decided after those of IV-4 had been seen"
"""Remark on claims with such parts of which one does not hold in the published run, see `encoded`."""

NOWHERE = statistics.undecided(SIGNED_RANK, 0, "this world has no place where the parts can be seen alone")
NO_CONTEXT = statistics.undecided(SIGNED_RANK, 0, "needs a context size above 0")

Contrast = Callable[[Maps, Layout, float], tuple[Floats, Floats]]
"""Two distances `[M]` in affordance maps of a layout, for a vehicle of a radius (u)."""

Test = Callable[[NDArray[np.floating], NDArray[np.floating]], Outcome]
"""A test of two scores `[M]`."""


class Criterion(NamedTuple):
    """One test of a claim."""

    name: str
    """The letter of a part of the claim; empty where a claim has one part."""
    effect_of: str
    """The difference that is the effect, in words."""
    unit: str
    """Unit of the effect; `sd` is a standard deviation of a member's own map."""
    outcome: Outcome
    statement: str = ""
    """The statement of this part, where a claim has several."""
    counts: bool = True
    """Whether the claim's verdict depends on it; tests of learning go beyond the paper, and do not."""


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper that can be tested."""

    name: str
    statement: str
    test: Callable[[Results], Sequence[Criterion]]
    remark: str = ""
    """A caveat of the verdict, such as a choice made after seeing the results."""


@dataclass(frozen=True)
class Score:
    """A claim and the outcomes of its tests."""

    claim: Claim
    parts: tuple[Criterion, ...]

    @property
    def verdict(self) -> Verdict:
        """The verdict of all parts that count."""
        return statistics.conjunction([part.outcome.verdict for part in self.parts if part.counts])

    @property
    def p(self) -> float | None:
        """The largest p of the parts that count (an intersection-union test); None if one of them has none."""
        p = [part.outcome.p for part in self.parts if part.counts]
        return None if None in p else max(value for value in p if value is not None)


def holm(scores: Sequence[Score]) -> list[float | None]:
    """The p of each claim, corrected for the number of claims that have one; None for the others."""
    corrected = iter(statistics.holm([score.p for score in scores if score.p is not None]))
    return [None if score.p is None else next(corrected) for score in scores]


class Pair(NamedTuple):
    """Two settings to compare."""

    column: str
    """The column in which they differ: `planner` or `layout`."""
    first: str
    second: str


class Painted(NamedTuple):
    """Maps of a context size, their layout, and the radius of the vehicle (u)."""

    context_size: int
    maps: Maps
    layout: Layout
    radius: float


def select_runs(results: Results, layout: str | None = None, planner: str = "cem") -> pd.DataFrame:
    """The runs of a planner, in one layout or all. The paper's Experiments II to V have the evolutionary one only."""
    runs = results.runs[results.runs["planner"] == planner]
    return runs if layout is None else runs[runs["layout"] == layout]


def runs_with(results: Results, factor: Factor, value: Value, layout: str) -> pd.DataFrame:
    """The runs with a value of a factor in a layout; none where it was not flown."""
    runs = select_runs(results, layout)
    return runs[runs[factor.column] == value] if factor.column in runs else runs.iloc[:0]


def member_scores(results: Results, metric: str, factor: Factor, value: Value, layout: str) -> pd.Series[float]:
    """Mean of a metric over each member's `runs_with` a value; empty where there are none."""
    runs = runs_with(results, factor, value, layout)
    return score_matrix(runs, metric).iloc[:, 0].astype(float) if len(runs) else pd.Series(dtype=float)


def trend(
    table: pd.DataFrame,
    metric: str,
    direction: Direction,
    who: str,
    name: str = "",
    statement: str = "",
    factor: Factor = CONTEXT_SIZE,
) -> Criterion:
    """Test a trend over the values of a factor in `table`; if it is empty, the note says that `who` was not run."""
    if table.empty:
        outcome = statistics.undecided(TREND, 0, f"{who} was not run")
        return Criterion(name, f"{factor.label}s", METRICS[metric].unit, outcome, statement)
    matrix = score_matrix(table, metric, [factor.column])
    effect_of = " minus ".join(factor.format(matrix.columns[end]) for end in (-1, 0))
    outcome = statistics.trend(matrix.to_numpy(), direction, METRICS[metric].statistic)
    return Criterion(name, effect_of, METRICS[metric].unit, outcome, statement)


def paired(table: pd.DataFrame, metric: str, pair: Pair, order: Order) -> Outcome:
    """Test whether the first setting of a pair scores lower (or higher), on average over the context sizes.

    If there are several sizes, the note has each of them.
    """
    return _with_sizes(table, metric, pair, _test(metric, order))[0]


def paired_at_every_size(table: pd.DataFrame, metric: str, pair: Pair, order: Order) -> Outcome:
    """Test whether the first setting scores lower (or higher) than the second at each context size."""
    mean, each = _with_sizes(table, metric, pair, _test(metric, order))
    return statistics.everywhere(each, mean)


def _test(metric: str, order: Order) -> Test:
    return lambda first, second: statistics.paired(first, second, order, METRICS[metric].statistic)


def same(table: pd.DataFrame, metric: str, pair: Pair, margin: float) -> Outcome:
    """Test whether a pair scores the same up to a margin, on average; the note has each context size."""
    return _with_sizes(table, metric, pair, lambda first, second: statistics.same(first, second, margin))[0]


def loss_falls(results: Results) -> list[Criterion]:
    """Test whether the validation loss of the last epoch, whose weights control uses, falls with the context size."""
    return [trend(results.last_epoch, "validation_nll", "falls", "a training")]


def largest_maps(results: Results, layout: str | None = None) -> Painted | None:
    """The maps of the largest context size in a layout (by default the first one), or None if there are none."""
    maps = results.maps(layout)
    if not maps:
        return None
    size = max(maps)
    setting = results.setting(size, layout=layout)
    assert setting is not None  # it has maps
    return Painted(size, maps[size], results.map_layout(setting), results.vehicle_radius(setting))


def encoded(
    painted: Painted | None, contrast: Contrast, order: Order, name: str, effect_of: str, statement: str
) -> list[Criterion]:
    """Test a contrast between distances in trained maps, and whether it is larger than in untrained ones."""
    size, outcome, learning = 0, NO_CONTEXT, NO_CONTEXT
    if painted is not None:
        size, maps, layout, radius = painted
        trained, untrained = (contrast(each, layout, radius) for each in (maps, maps.untrained))
        outcome, learning = contrasts(trained, untrained, order)
    again = f"{statement.removesuffix('.')}: more so than in the same member's map before training."
    return [
        Criterion(name, f"{effect_of}, C = {size}", "sd", outcome, statement),
        Criterion(
            f"{name}, learned", "trained minus untrained of the same difference", "sd", learning, again, counts=False
        ),
    ]


def contrasts(
    trained: tuple[Floats, Floats], untrained: tuple[Floats, Floats], order: Order
) -> tuple[Outcome, Outcome]:
    """Test whether the first distance `[M]` is the lower (or higher) after training, and by more than before it.

    Similar pictures have similar codes in an untrained network, too; only the second test is about learning.
    """
    if not len(trained[0]):
        return NOWHERE, NOWHERE
    after, before = trained[0] - trained[1], untrained[0] - untrained[1]
    return statistics.paired(*trained, order), statistics.paired(after, before, order)


def with_note(outcome: Outcome, notes: Sequence[str]) -> Outcome:
    """The outcome with further notes."""
    return replace(outcome, note="; ".join(filter(None, [outcome.note, *notes])))


def short(outcome: Outcome, unit: str) -> str:
    """An outcome for a note: effect, p value and verdict; its own note if it has no effect."""
    if outcome.effect is None or outcome.low is None:
        return outcome.note
    p = "" if outcome.p is None else f"p {p_value(outcome.p)}, "
    return f"{number(outcome.effect, sign=True)} {unit}, {p}{outcome.verdict}"


def _paired(table: pd.DataFrame, metric: str, pair: Pair) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores `[M, S]` of either setting at the S context sizes (columns) that both have; S may be 0."""
    table = table[table[pair.column].isin([pair.first, pair.second])]
    both = table.groupby("context_size")[pair.column].transform("nunique") == 2
    if not both.any():
        return pd.DataFrame(), pd.DataFrame()
    settings = score_matrix(table[both], metric, [pair.column, "context_size"])
    return settings[[pair.first]].droplevel(0, axis=1), settings[[pair.second]].droplevel(0, axis=1)


def _on_average(first: pd.DataFrame, second: pd.DataFrame, pair: Pair, test: Test) -> Outcome:
    if first.empty:
        nothing = np.empty(0)
        return replace(test(nothing, nothing), note=f"needs runs of both {pair.column}s")
    return test(first.to_numpy(dtype=float).mean(axis=1), second.to_numpy(dtype=float).mean(axis=1))


def _with_sizes(table: pd.DataFrame, metric: str, pair: Pair, test: Test) -> tuple[Outcome, list[Outcome]]:
    """The outcome on average over the context sizes, with a note about each, and the outcomes of each."""
    first, second = _paired(table, metric, pair)
    each = {size: test(first[size].to_numpy(float), second[size].to_numpy(float)) for size in first}
    notes = [f"C = {size}: {short(outcome, METRICS[metric].unit)}" for size, outcome in each.items() if len(each) > 1]
    return with_note(_on_average(first, second, pair, test), notes), list(each.values())
