"""Metrics: one entry each, with column, unit, label, margin, and the function of trajectories that computes it.

A new metric needs nothing but an entry, here or from users. Reports of older results have it, too, because a column
that a stored table lacks is computed when the table is read.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.results.files import LAYOUT_COLUMNS, Trajectories
from affmap.settings import ConfigError, extensions
from affmap.settings.messages import format_value

Statistic = Literal["mean", "median"]

Column: TypeAlias = NDArray[Any] | pd.Series
"""`[B]`, a value for each run."""


@dataclass(frozen=True)
class Metric:
    """A metric: a column of the tables; `register_metric` makes it known.

    Attributes:
        name: in a sentence.
        unit: such as `u` or `steps`.
        label: of an axis.
        of_runs: function of the `affmap.results.files.Trajectories` of B runs that returns a value for each, `[B]`;
            None if it does not follow from trajectories.
        statistic: the effect in tests, mean or median of the members' differences; likelihoods have heavy tails.
        margin: a difference that would not matter: small compared with those between context sizes.
        stored: whether the table of a control stage has the column; its columns are fixed, so new metrics are not
            stored.
    """

    name: str
    unit: str
    label: str
    of_runs: Callable[[Trajectories], Column] | None = None
    statistic: Statistic = "mean"
    margin: float | None = None
    stored: bool = False


def _prediction_error(paths: Trajectories) -> Column:
    """Mean over steps of the negative log-likelihood of the change of position, nats."""
    return paths.prediction_error.mean(axis=1)


def _mean_distance(paths: Trajectories) -> Column:
    """Mean over the steps' ends of the distance between true position and goal, u."""
    return np.linalg.norm(paths.position[:, 1:] - paths.goal[:, None], axis=-1).mean(axis=1)


def _reached(paths: Trajectories) -> Column:
    """Whether the goal was reached at the end of any step."""
    return np.asarray(paths.reached.any(axis=1))


def _steps_to_reach(paths: Trajectories) -> Column:
    """Number of the step that reached the goal; empty if none did."""
    return pd.Series(paths.reached.argmax(axis=1) + 1).where(np.asarray(_reached(paths))).astype("Int64")


def success(paths: Trajectories) -> Column:
    """Whether the goal was reached, and the vehicle never was in fog (Experiment IV)."""
    return paths.reached.any(axis=1) & (paths.in_fog.sum(axis=1) == 0)


def _steps_touching(paths: Trajectories) -> Column:
    """Steps at whose end the vehicle touched a surface."""
    return paths.touching.sum(axis=1)


def _steps_in_fog(paths: Trajectories) -> Column:
    """Steps at whose end the vehicle was in fog."""
    return paths.in_fog.sum(axis=1)


def _final_spread(paths: Trajectories) -> Column:
    """Largest distance of the last quarter's positions from their mean, u: small where the vehicle is stuck."""
    end = paths.position[:, paths.position.shape[1] * 3 // 4 :]
    return np.linalg.norm(end - end.mean(axis=1, keepdims=True), axis=-1).max(axis=1)


METRICS = {
    "validation_nll": Metric("validation loss", "nats", "validation NLL (nats)", statistic="median", margin=0.5),
    "prediction_error": Metric(
        "prediction error", "nats", "prediction error (nats)", _prediction_error, "median", margin=0.5, stored=True
    ),
    "mean_distance": Metric(
        "mean distance", "u", "mean distance to the goal (u)", _mean_distance, margin=0.05, stored=True
    ),
    "reached": Metric("reached", "share", "share of runs that reached the goal", _reached, margin=0.05, stored=True),
    "steps_to_reach": Metric("steps to reach", "steps", "steps to the goal", _steps_to_reach, stored=True),
    "success": Metric("success", "share", "share of successful runs", success, margin=0.05, stored=True),
    "steps_touching": Metric("steps touching", "steps", "steps touching a surface", _steps_touching, stored=True),
    "steps_in_fog": Metric("steps in fog", "steps", "steps in fog", _steps_in_fog, stored=True),
    "final_spread": Metric("final spread", "u", "spread at the end (u)", _final_spread, stored=True),
}
"""Column -> metric, in the order of the table of runs."""


_OURS = frozenset(METRICS)


def register_metric(column: str, metric: Metric) -> None:
    """Make a metric known to reports, which show it beside their own, also for results that were made before.

    Args:
        column: its name in tables.
        metric: its function, `of_runs`, gets the trajectories of B runs and returns B values.

    Raises:
        ValueError: the name is taken, or no column; or the metric is none, or has no function.
    """
    if not isinstance(metric, Metric):
        raise ValueError(
            f"the metric {format_value(column)} is {format_value(metric)}; give affmap.Metric(name, unit, label, "
            "function), such as affmap.Metric('effort', 'throttles', 'open throttles', effort)."
        )
    taken = {*_OURS, *PLACES, *LAYOUT_COLUMNS}
    if not re.fullmatch("[a-z][a-z0-9_]*", str(column)) or column in taken:
        raise ValueError(
            f"the metric {format_value(column)} needs a name of its own, of small letters, digits and _; there are: "
            f"{', '.join(sorted(taken))}."
        )
    if not callable(metric.of_runs) or metric.stored:
        raise ValueError(f"the metric {column!r} needs a function of trajectories, of_runs, and cannot be stored.")
    extensions.note("metric", column, sys._getframe(1).f_globals["__name__"])  # that of a function may be another
    METRICS[column] = metric


def stored_metrics() -> list[str]:
    """Columns of metrics in the table of a control stage."""
    return [column for column, metric in METRICS.items() if metric.stored]


def extra_metrics() -> list[str]:
    """Columns of metrics that are not stored, those of users among them; reports show them besides the usual ones.

    Raises:
        ConfigError: a module that the user named cannot be imported.
    """
    extensions.load()
    return [column for column, metric in METRICS.items() if metric.of_runs and not metric.stored]


def run_metrics() -> list[str]:
    """Columns of all metrics of runs, those of the table of a control stage first."""
    return [*stored_metrics(), *extra_metrics()]


PLACES: dict[str, Callable[[Trajectories], Column]] = {
    "member": lambda paths: paths.member,
    "run": lambda paths: paths.run,
    "start_x": lambda paths: paths.position[:, 0, 0],
    "start_y": lambda paths: paths.position[:, 0, 1],
    "goal_x": lambda paths: paths.goal[:, 0],
    "goal_y": lambda paths: paths.goal[:, 1],
}
"""Column -> function that computes it; these columns identify a run of a setting. Lengths in u."""


def places(paths: Trajectories) -> pd.DataFrame:
    """The member, number, start and goal of B runs, a row each."""
    return pd.DataFrame({column: compute(paths) for column, compute in PLACES.items()})


def table(paths: Trajectories, columns: Sequence[str]) -> pd.DataFrame:
    """The places of B runs and some of their metrics, a row each; see `summarise`."""
    return places(paths).join(summarise(paths, columns))


def summarise(paths: Trajectories, columns: Sequence[str]) -> pd.DataFrame:
    """The metrics of B runs, a row each, in the order of `columns`.

    Raises:
        ConfigError: a metric has another number of values.
    """
    functions = {column: METRICS[column].of_runs for column in columns}
    values = {column: compute(paths) for column, compute in functions.items() if compute}
    for column, value in values.items():
        if np.shape(value) != paths.run.shape:
            raise ConfigError(
                f"the metric {column!r} returned shape {[*np.shape(value)]}; it should return a value for each run, "
                f"{[*paths.run.shape]}."
            )
    return pd.DataFrame(values)
