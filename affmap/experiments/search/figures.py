"""The figure of a search: its history, and the result over each value that was searched."""

from collections.abc import Collection
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from affmap.report.drawing.files import new_figure, save, style
from affmap.results.metrics import METRICS

BEST, USED, OTHER = "#0072B2", "#D55E00", "0.6"

POOR = 0.8
"""Share of the trials within the axis of the result; poorer trials are triangles at its end."""


def draw_search(
    table: pd.DataFrame, objective: str, used: int | None, log_keys: Collection[str], path: Path, notice: str | None
) -> None:
    """Draw and save the trials of a search: in their order, and by each of the values that were searched.

    Args:
        table: the trials, as `report.read` gives them.
        objective: the metric that the search optimised.
        used: the trial of the values in use, or None.
        log_keys: keys with a logarithmic axis.
        path: path of the files, without ending.
        notice: a warning on the figure, or None.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    keys = list(table.columns[4:])
    columns = min(3, 1 + len(keys))
    rows = -(-(1 + len(keys)) // columns)
    with style():
        figure = new_figure(0.4 + 2.0 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        history(axes[0], table, objective, used)
        for ax, key in zip(axes[1:], keys, strict=False):
            by_value(ax, table, objective, used, key, key in log_keys)
        for ax in axes[1 + len(keys) :]:
            ax.remove()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
        save(figure, path, notice)


def history(ax: Axes, table: pd.DataFrame, objective: str, used: int | None) -> Axes:
    """Draw the result of each trial in order, and the best so far.

    Args:
        ax: where to draw.
        table: one row per trial: trial, status, result.
        objective: the metric of the results.
        used: the trial of the values in use, or None.
    """
    complete = table[table["status"] == "ok"]
    so_far = complete["result"].cummax() if objective == "success" else complete["result"].cummin()
    _points(ax, complete, "trial", objective, used)
    ax.step(complete["trial"], so_far, where="post", color=BEST, lw=1, label="best so far")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlabel("trial")
    ax.set_ylabel(METRICS[objective].label)
    return ax


def by_value(ax: Axes, table: pd.DataFrame, objective: str, used: int | None, key: str, log: bool) -> Axes:
    """Draw the result of each trial over the value of one key.

    Args:
        ax: where to draw.
        table: one row per trial: trial, status, result, and a column named by the key.
        objective: the metric of the results.
        used: the trial of the values in use, or None.
        key: a column; values that are not numbers are drawn side by side.
        log: whether the axis is logarithmic.
    """
    complete = table[table["status"] == "ok"].copy()
    if not pd.api.types.is_numeric_dtype(complete[key]):
        complete[key] = complete[key].astype(str)
    _points(ax, complete, key, objective, used)
    if log:
        ax.set_xscale("log")
    ax.set_xlabel(key)
    return ax


def _points(ax: Axes, complete: pd.DataFrame, column: str, objective: str, used: int | None) -> None:
    up = objective == "success"
    results = complete["result"]
    best, end = (results.max(), results.quantile(1 - POOR)) if up else (results.min(), results.quantile(POOR))
    room = 0.08 * abs(best - end) or 0.1
    low, high = min(best, end) - room, max(best, end) + room
    poor = (results < low) | (results > high)

    def mark(which: pd.Series, marker: str, color: str, size: float, label: str) -> None:
        if which.any():
            place = complete[which]
            y = place["result"].clip(low, high)
            ax.plot(place[column], y, marker, color=color, ms=size, label=label, clip_on=False, zorder=size)

    mark(~poor, "o", OTHER, 3.5, "trial")
    mark(poor, "v" if up else "^", OTHER, 3.5, "beyond the axis")
    best_trial = complete["trial"].iloc[int(results.argmax() if up else results.argmin())]
    mark(complete["trial"] == best_trial, "o", BEST, 5.0, "best")
    mark(complete["trial"] == used, "D", USED, 4.5, "in use")
    ax.set_ylim(low, high)
