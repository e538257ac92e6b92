"""The figure of a comparison: differences to the first value with their intervals, a panel for each metric."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import SymmetricalLogLocator

from affmap.report.drawing.colors import PLAN_COLOR, context_color
from affmap.report.drawing.numbers import HUGE
from affmap.report.figures.files import STYLE, new_figure, save
from affmap.results.metrics import METRICS

SPACING = "lookup.spacing"
"""The key of compared look-ups, whose context codes have errors."""


def draw_differences(table: pd.DataFrame, runs: pd.DataFrame, key: str, path: Path, notice: str | None) -> None:
    """Draw and save what `comparison.compare` has found.

    Args:
        table: what it returned.
        runs: the runs that it compared.
        key: what was compared.
        path: of the files, without their ending.
        notice: what must stand on the figure, or None.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lookups = key == SPACING
    values = list(dict.fromkeys([*table["a"], *table["b"]]))
    names = [value.replace("_", " ") if isinstance(value, str) else f"{value:g}" for value in values]
    if lookups:
        names = ["exact" if value == 0 else name for value, name in zip(values, names, strict=True)]
    metrics = list(table["metric"].unique())
    count = len(metrics) + lookups
    rows = -(-count // 4)
    with mpl.rc_context(STYLE):
        figure = new_figure(0.3 + rows * (1.75 + 0.05 * max(map(len, names))))
        axes = figure.subplots(rows, -(-count // rows), squeeze=False).ravel()
        for ax in axes[count:]:
            ax.set_axis_off()
        for ax, metric in zip(axes[lookups:], metrics, strict=False):
            differences(ax, table[table["metric"] == metric], values)
        if lookups:
            code_errors(axes[0], runs, values)
        for ax in axes[:count]:
            value_axis(ax, names, "map spacing (u)" if lookups else key)
        handles, settings = axes[count - 1].get_legend_handles_labels()
        if len(settings) > 1:
            figure.legend(handles, settings, loc="outside lower center", ncols=5, frameon=False)
        save(figure, path, notice)


def code_errors(ax: Axes, runs: pd.DataFrame, spacings: Sequence[float | str]) -> Axes:
    """How far the planner's context codes are from exact ones: mean and standard deviation over runs.

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
    """Differences of a metric to that of the first value, with their 95 % intervals, and the margin as a band.

    Planners, layouts and context sizes stand side by side.

    Args:
        ax: where to draw.
        table: what `comparison.compare` returned, for one metric.
        values: what was compared, the first being what the others are compared with.
    """
    unit, margin = table["unit"].iloc[0], table["margin"].iloc[0]
    ax.axhspan(-margin, margin, color="0.92", lw=0)
    ax.axhline(0, color="0.6", lw=0.8)
    keys = [key for key in ("planner", "layout", "context_size") if key in table]
    settings = list(table.groupby(keys))
    for place, (setting, group) in enumerate(settings):
        named = dict(zip(keys, setting, strict=True))
        shift = (place - (len(settings) - 1) / 2) * min(0.15, 0.7 / len(settings))
        places = [values.index(value) + shift for value in group["b"]]
        reach = [group["difference"] - group["low"], group["high"] - group["difference"]]
        several = len(settings) > 1 and "context_size" in keys
        ax.errorbar(
            places,
            group["difference"],
            reach,
            fmt="os^vDPX*"[place % 8],
            color=context_color(group["context_size"].iloc[0]) if several else PLAN_COLOR,
            ms=3.5,
            capsize=2,
            lw=1,
            label=", ".join(
                f"C = {p}" if key == "context_size" else str(p).replace("_", " ") for key, p in named.items()
            ),
        )
    if max(table["difference"].abs().max(), table["high"].max(), -table["low"].min()) > HUGE:
        ax.set_yscale("symlog", linthresh=1)  # the others, and the margin, are to be seen, too
        ax.yaxis.set_major_locator(SymmetricalLogLocator(base=100, linthresh=1))
    ax.set_title(METRICS[table["metric"].iloc[0]].name, loc="left")
    ax.set_ylabel(f"difference ({unit})")
    return ax


def value_axis(ax: Axes, names: Sequence[str], label: str) -> Axes:
    """Write the names of the compared values along the horizontal axis, a place each."""
    ax.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor")
    ax.set(xlabel=label, xlim=(-0.5, len(names) - 0.5))
    return ax
