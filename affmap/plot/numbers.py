"""Plots of tables: losses of training and metrics of control. A table may be that of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from affmap.control.agent import Agent
from affmap.control.episodes import Runs
from affmap.control.pretrained import reference
from affmap.plot.canvas import canvas
from affmap.report.drawing import losses as curves
from affmap.report.drawing import numbers
from affmap.report.drawing.colors import Groups, group_colors, name_of, readable, x_colors
from affmap.results.metrics import METRICS
from affmap.results.setting import CONTEXT_SIZE, FACTORS, Factor, ReportSettings, Value
from affmap.settings import ConfigError
from affmap.settings.messages import one_line
from affmap.store.files import guarded_read

Table = pd.DataFrame | Runs | Path | str
"""A table; or runs of `affmap.fly`, which have one; or the folder of a report, such as `runs/exp1`; or the name of one
of the reference run's, `exp1`."""

ALL = "(all)"
"""The only group of a plot without groups, and the column that names it."""


def losses(table: Table | Agent, by: str | None = CONTEXT_SIZE.column, *, ax: Axes | None = None) -> Axes:
    """Draw the validation loss over epochs, a curve for each value: mean and standard deviation (shade) over members.

    Args:
        table: a row for each value, member and epoch, with the columns `by`, `member`, `epoch` and `validation_nll`
            (nats). Or an agent, whose members are those of a single curve.
        by: the column with a curve for each value; None for a single curve, as of a table without context sizes.
        ax: where to draw.

    Raises:
        ConfigError: there is no such table or column, or a curve would have several losses of a member at an epoch; or
            the losses of the agent are unknown.
    """
    if isinstance(table, Runs):
        raise ConfigError("runs have no losses; give the agent that has flown them, or its `losses`.")
    rows = _losses(table) if isinstance(table, Agent) else _read(table, "validation")
    if by == CONTEXT_SIZE.column and by not in rows:
        by = None
    rows = rows.assign(**{ALL: ALL}) if by is None else rows
    factor = _factor(by or ALL)
    one = [*dict.fromkeys([factor.column, "member", "epoch"])]
    _check(rows, [*one, "validation_nll"])
    if rows.empty:
        raise ConfigError("the table has no rows, and so no losses.")
    if rows.duplicated(one).any():
        others = [str(column) for column in rows if column not in (*one, "training_nll", "validation_nll")]
        raise ConfigError(
            f"the table has several losses of one member at one epoch{f' and {by}' if by else ''}; draw by another "
            f"column, or choose the rows of one {' and '.join(others) or 'training'} first."
        )
    names = _names(rows[factor.column], factor)
    palette = _palette(names, factor)
    colors = {value: palette[name] for value, name in names.items()}
    with canvas(ax) as axes:
        curves.learning_curves(axes, rows, factor=factor, names=names if _are_words(names) else {}, colors=colors)
        if len(names) > 1:
            numbers.titled(axes, f"Loss by {factor.label}")
        _trim_legend(axes)
    return axes


def boxes(
    table: Table, metric: str, by: str = CONTEXT_SIZE.column, color: str | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw box plots of a metric of runs, as in the paper.

    Boxes are quartiles, whiskers extend to the last point within 1.5 interquartile ranges, outliers are not drawn.

    Args:
        table: a row a run, with the columns `metric`, `by` and `color`. Rows where one of the last two is empty, such
            as the context size of agents without a model, are left out.
        metric: one of `affmap.results.METRICS`.
        by: the column along the x axis.
        color: the column of groups that stand side by side in colours of their own; by default there is one group.
        ax: where to draw.

    Raises:
        ConfigError: there is no such table, column or metric, or the metric is a yes or no (see `bars`).
    """
    rows, groups = _grouped(table, metric, by, color)
    if rows[metric].dtype == bool:
        raise ConfigError(f"{metric} is a yes or no of each run: draw the shares of runs with affmap.plot.bars.")
    with canvas(ax) as axes:
        numbers.boxes(axes, rows, metric, groups)
        _trim_legend(axes)
    return axes


def bars(
    table: Table, metric: str, by: str = CONTEXT_SIZE.column, color: str | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw shares of runs, such as those that reached the goal: mean over members and 95 % interval.

    With fewer than five members there is no interval. See `boxes`; the table also has the column `member`.
    """
    rows, groups = _grouped(table, metric, by, color)
    _check(rows, ["member"])
    with canvas(ax) as axes:
        numbers.bars(axes, rows, metric, groups, intervals=True)
        _trim_legend(axes)
    return axes


def _grouped(table: Table, metric: str, by: str, color: str | None) -> tuple[pd.DataFrame, Groups]:
    """The runs of a table, and their groups by colour and along the x axis."""
    rows = _read(table, "runs")
    if metric not in METRICS:
        raise ConfigError(f"there is no metric {metric!r}; there are: {', '.join(METRICS)}.")
    _check(rows, [metric, by, *([color] if color else [])])
    rows = rows.dropna(subset=[by, color]) if color else rows.dropna(subset=[by]).assign(**{ALL: ALL})
    if rows.empty:
        raise ConfigError(f"the table has no row with a value of {' and '.join(filter(None, [by, color]))}.")
    factor, x = _factor(color or ALL), _factor(by)
    names, x_names = _names(rows[factor.column], factor), _names(rows[by], x)
    return rows, Groups(factor.column, names, _palette(names, factor), x, x_names if _are_words(x_names) else {})


def _losses(agent: Agent) -> pd.DataFrame:
    """The losses of an agent, with the context size of its models."""
    if agent.losses is None:
        raise ConfigError(
            "the losses of the agent's training are unknown: an installed package has only the weights of published "
            "agents, and a clone of the repository has all; or give the agent's `losses`."
        )
    return agent.losses.assign(**{CONTEXT_SIZE.column: agent.stack.context_size})


def _read(table: Table, name: str) -> pd.DataFrame:
    """A table, or that with a name of a report."""
    if isinstance(table, Runs):
        table = table.table
    if isinstance(table, pd.DataFrame):
        return table
    for folder in (Path(table), reference() / table) if isinstance(table, str | Path) else ():
        path = folder / "tables" / f"{name}.csv"
        if path.is_file():
            with guarded_read(path):
                return pd.read_csv(path)
    raise ConfigError(
        f"{one_line(str(table), 100)} is no report with tables/{name}.csv: give a table, the folder of a report, or "
        "the name of an experiment of the reference run, whose tables only a clone of the repository has."
    )


def _check(table: pd.DataFrame, columns: Sequence[str]) -> None:
    if lacking := [column for column in columns if column not in table]:
        raise ConfigError(f"the table has no column {lacking[0]!r}; it has {', '.join(map(str, table.columns))}.")


def _factor(column: str) -> Factor:
    """The factor of a column of a table; without an entry, it is labelled by the name of the column."""
    label = column.replace("_", " ")
    return {factor.column: factor for factor in FACTORS.values()}.get(column) or Factor(column, column, label, label)


def _names(column: pd.Series[Any], factor: Factor) -> dict[Value, str]:
    """Value -> its name for readers, of all values in a column: numbers ascend, others come as they do in the table."""
    settings = ReportSettings.load("report", "default")
    values = column.unique().tolist()
    values = values if _are_words(values) else sorted(values)
    return {
        value: readable(value, settings) if isinstance(value, str) else name_of(factor, value, settings)
        for value in values
    }


def _palette(names: Mapping[Value, str], factor: Factor) -> dict[str, str]:
    """Name -> colour: words as the groups of a report have them, numbers as its curves do."""
    if _are_words(names):
        return group_colors(names)
    colors = x_colors(factor, names)
    return {name: colors[value] for value, name in names.items()}


def _are_words(values: Iterable[Value]) -> bool:
    return any(isinstance(value, str) for value in values)


def _trim_legend(ax: Axes) -> None:
    """Remove a legend of one entry, which tells nothing apart."""
    legend = ax.get_legend()
    if legend and len(legend.get_texts()) == 1:
        legend.remove()
