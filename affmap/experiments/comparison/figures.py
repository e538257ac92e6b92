"""The figure of a comparison: differences to the first value with their intervals, a panel for each metric."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from affmap.report.drawing.colors import context_color
from affmap.report.drawing.files import new_figure, save, style
from affmap.report.drawing.numbers import HUGE
from affmap.results.metrics import METRICS
from affmap.results.setting import PLANNERS, value_name

SPACING = "lookup.spacing"
"""The key of compared look-ups, whose context codes have errors."""

LEGEND_WIDTH = 120
"""Characters that fit side by side below the panels."""


def draw_differences(table: pd.DataFrame, runs: pd.DataFrame, key: str, path: Path, notice: str | None) -> None:
    """Draw and save the results of `comparison.compare`.

    Args:
        table: the results.
        runs: the compared runs.
        key: the compared key.
        path: path of the files, without ending.
        notice: a warning on the figure, or None.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lookups = key == SPACING
    first, others = table["a"].iloc[0], list(dict.fromkeys(table["b"]))
    names = {value: "exact" if lookups and value == 0 else _readable(value) for value in [first, *others]}
    metrics = list(table["metric"].unique())
    count = len(metrics) + lookups
    rows = -(-count // 4)
    with style():
        figure = new_figure(0.6 + rows * (1.75 + 0.05 * max(len(names[value]) for value in others)))
        axes = figure.subplots(rows, -(-count // rows), squeeze=False).ravel()
        for ax in axes[count:]:
            ax.set_axis_off()
        for ax, metric in zip(axes[lookups:], metrics, strict=False):
            differences(ax, table[table["metric"] == metric], others)
            value_axis(ax, [names[value] for value in others])
        if lookups:
            value_axis(code_errors(axes[0], runs, [first, *others]), [*names.values()])
        compared = f"{'map spacing (u)' if lookups else key}: differences to {names[first]}"
        figure.suptitle(compared, x=0.01, ha="left", fontsize=8)
        handles, settings = axes[count - 1].get_legend_handles_labels()
        if len(settings) > 1:
            columns = max(1, min(len(settings), LEGEND_WIDTH // (max(map(len, settings)) + 10)))
            figure.legend(handles, settings, loc="outside lower center", ncols=columns, frameon=False)
        save(figure, path, notice)


def code_errors(ax: Axes, runs: pd.DataFrame, spacings: Sequence[float | str]) -> Axes:
    """Draw the errors of the planner's context codes: mean and standard deviation over runs.

    Args:
        ax: where to draw.
        runs: one row per run.
        spacings: of the maps, u, in the order in which they are to be drawn; 0 is the exact look-up.
    """
    scores = runs.groupby("lookup_spacing")["lookup_error"].agg(["mean", "std"]).loc[list(spacings)]
    ax.errorbar(range(len(spacings)), scores["mean"], scores["std"], fmt="o", color="0.3", ms=3.5, capsize=2, lw=1)
    ax.set_ylim(bottom=0)
    ax.set_title("context codes", loc="left")
    ax.set_ylabel("mean absolute error")
    return ax


def differences(ax: Axes, table: pd.DataFrame, values: Sequence[float | str]) -> Axes:
    """Draw differences of a metric from its first value, with their 95 % intervals, and the margin as a band.

    Planners, layouts and context sizes stand side by side.

    Args:
        ax: where to draw.
        table: results of `comparison.compare` for one metric.
        values: the values compared with the first one.
    """
    unit, margin = table["unit"].iloc[0], table["margin"].iloc[0]
    ax.axhspan(-margin, margin, color="0.92", lw=0)
    ax.axhline(0, color="0.6", lw=0.8)
    keys = [key for key in ("planner", "layout", "context_size") if key in table]
    telling = [key for key in keys if table[key].nunique() > 1]
    settings = list(table.groupby(keys))
    for place, (setting, group) in enumerate(settings):
        labels = dict(zip(keys, setting, strict=True))
        shift = (place - (len(settings) - 1) / 2) * min(0.15, 0.7 / len(settings))
        places = [values.index(value) + shift for value in group["b"]]
        reach = [group["difference"] - group["low"], group["high"] - group["difference"]]
        several = len(settings) > 1 and "context_size" in keys
        ax.errorbar(
            places,
            group["difference"],
            reach,
            fmt="os^vDPX*"[place % 8],
            color=context_color(group["context_size"].iloc[0]) if several else PLANNERS["cem"].color,
            ms=3.5,
            capsize=2,
            lw=1,
            label=", ".join(
                f"C = {labels[key]}" if key == "context_size" else str(labels[key]).replace("_", " ") for key in telling
            ),
        )
    if max(table["difference"].abs().max(), table["high"].max(), -table["low"].min()) > HUGE:
        ax.set_yscale("symlog", linthresh=1)  # keeps the others and the margin visible
        low, high = ax.get_ylim()
        decades = int(np.log10(max(abs(low), abs(high))))
        step = max(1, -(-decades // 4))
        powers = [10.0**power for power in range(step, decades + 1, step)]
        ax.set_yticks([tick for tick in (*(-each for each in powers), 0.0, *powers) if low <= tick <= high])
        ax.minorticks_off()
    ax.set_title(METRICS[table["metric"].iloc[0]].name, loc="left")
    ax.set_ylabel(f"difference ({unit})")
    return ax


def value_axis(ax: Axes, names: Sequence[str]) -> Axes:
    """Write the names of the compared values along the horizontal axis, a place each."""
    style: dict[str, Any] = {"rotation": 60, "ha": "right", "rotation_mode": "anchor"}
    ax.set_xticks(range(len(names)), names, **(style if len(names) > 3 or max(map(len, names)) > 10 else {}))
    ax.set_xlim(-0.5, len(names) - 0.5)
    return ax


def _readable(value: float | str) -> str:
    return value_name(value).replace("_", " ")
