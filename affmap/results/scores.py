"""Scores of claims, and the centers of all settings, as tables: pure functions of the results."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from affmap.results.claims import Claim, Criterion, Score
from affmap.results.metrics import METRICS, extra_metrics
from affmap.results.setting import ALWAYS, CONTEXT_SIZE, LAYOUT, PLANNER, ReportSettings, short_name
from affmap.results.tables import Results

_CELLS: dict[str, Callable[[Score, Criterion], Any]] = {
    "claim": lambda score, part: score.claim.name,
    "part": lambda score, part: part.name,
    "statement": lambda score, part: part.statement or score.claim.statement,
    "test": lambda score, part: part.outcome.test,
    "members": lambda score, part: part.outcome.members,
    "effect_of": lambda score, part: part.effect_of,
    "effect": lambda score, part: part.outcome.effect,
    "low": lambda score, part: part.outcome.low,
    "high": lambda score, part: part.outcome.high,
    "unit": lambda score, part: part.unit,
    "p": lambda score, part: part.outcome.p,
    "p_opposite": lambda score, part: part.outcome.p_opposite,
    "part_verdict": lambda score, part: part.outcome.verdict.value,
    "verdict": lambda score, part: score.verdict.value,
    "note": lambda score, part: part.outcome.note,
}
"""Column -> its cell for a part of a claim."""

COLUMNS = tuple(_CELLS)


def score(results: Results, claims: Sequence[Claim]) -> list[Score]:
    """Test every claim."""
    return [Score(claim, tuple(claim.test(results))) for claim in claims]


def as_table(scores: Sequence[Score]) -> pd.DataFrame:
    """One row per part of each claim, columns `COLUMNS`."""
    rows = [[cell(score, part) for cell in _CELLS.values()] for score in scores for part in score.parts]
    numbers = ("effect", "low", "high", "p", "p_opposite")
    return pd.DataFrame(rows, columns=list(COLUMNS)).astype(dict.fromkeys(numbers, float))


def medians(results: Results, settings: ReportSettings) -> pd.DataFrame:
    """The centers of all settings (see `centers`), with short names of planners."""
    table = centers(results, settings)
    return table.assign(planner=table["planner"].map(short_name))


def centers(results: Results, settings: ReportSettings) -> pd.DataFrame:
    """The center of each setting (over members for the validation loss, over runs in control), and the paper's axis.

    The center is the median, as in the paper's box plots, or the mean for `success`, as in its bars. A training has
    no planner, a layout only if trainings differ in it, and values of other factors only if it depends on them. If no
    axis is given, `paper_low`, `paper_high` and `inside` are empty.
    """
    own = [factor.column for factor in results.factors if factor not in ALWAYS]
    keys = [PLANNER.column, LAYOUT.column, *own, CONTEXT_SIZE.column]
    losses = results.last_epoch.assign(**{key: "" for key in keys if key not in results.last_epoch})
    if losses["layout"].nunique() == 1:
        losses["layout"] = ""
    metrics = ["validation_nll", "prediction_error", settings.outcome, *extra_metrics()]
    tables = [_centers(losses if metric == "validation_nll" else results.runs, metric, keys) for metric in metrics]
    places = {layout: place for place, layout in enumerate(["", *results.layouts])}  # in the order of the figures
    ordered = [each.sort_values("layout", key=lambda names: names.map(places), kind="stable") for each in tables]
    table = pd.concat(ordered, ignore_index=True)
    axes = table["metric"].map(lambda metric: settings.axes.get(metric, (math.nan, math.nan)))
    table["paper_low"], table["paper_high"] = axes.str[0], axes.str[1]
    inside = table["center"].between(table["paper_low"], table["paper_high"])
    table["inside"] = inside.astype("boolean").mask(table["paper_low"].isna())
    return table


def statistic(metric: str) -> str:
    """The statistic of a metric's center: the mean for shares, else the median."""
    return "mean" if METRICS[metric].unit == "share" else "median"


def center(values: "pd.Series[Any]", metric: str) -> float:
    """The center of some values of a metric; NaN if one is missing."""
    return float(values.astype(float).agg(statistic(metric), skipna=False))


def _centers(table: pd.DataFrame, metric: str, keys: Sequence[str]) -> pd.DataFrame:
    """One row per planner, layout, other factor and context size."""
    scores = table[metric].astype(float).groupby([table[key] for key in keys])
    table = scores.agg(number="size", center=lambda values: center(values, metric)).reset_index()
    columns = ["metric", *keys, "number", "statistic", "center", "unit"]
    return table.assign(metric=metric, statistic=statistic(metric), unit=METRICS[metric].unit)[columns]
