"""Drawing functions for runs that fail: they take tables and Axes and return the Axes."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from affmap.env.effects import EFFECTS
from affmap.report.drawing.colors import NUMBERS, x_colors
from affmap.report.drawing.numbers import LINEAR, mark_zeros, name_places, say, unpredicted
from affmap.results import failures
from affmap.results.setting import CONTEXT_SIZE, Factor, Value

REASON_COLORS = {"fog": EFFECTS["fog"].color, "stuck": "#333333", "other": "#CC6677"}


def reasons(ax: Axes, runs: pd.DataFrame, x: Factor = CONTEXT_SIZE, names: Mapping[Value, str] = NUMBERS) -> Axes:
    """Draw the share of runs that failed for each reason, by context size or another factor.

    Args:
        ax: where to draw.
        runs: one row per run, with the column `reason` (`failures.with_reasons`).
        x: the factor on the x axis.
        names: of its values, for readers; empty for numbers.
    """
    shares = failures.shares(runs, "reason", failures.REASONS, x.column)
    return _stacked(ax, shares, failures.REASONS, REASON_COLORS, x, names, "no run failed")


def nearest(ax: Axes, runs: pd.DataFrame, x: Factor = CONTEXT_SIZE, names: Mapping[Value, str] = NUMBERS) -> Axes:
    """Draw the share of runs that never arrived, by the object nearest to their end and by a factor.

    Args:
        ax: where to draw.
        runs: one row per run, see `failures.with_nearest`.
        x: the factor on the x axis.
        names: of its values, for readers; empty for numbers.
    """
    things = {thing: name for thing, name in failures.things().items() if (runs["nearest"] == thing).any()}
    colors = {failures.SURFACE: EFFECTS["obstacle"].color, **{name: each.color for name, each in EFFECTS.items()}}
    shares = failures.shares(runs, "nearest", things, x.column)
    return _stacked(ax, shares, things, colors, x, names, "every run arrived")


def step_errors(ax: Axes, steps: pd.DataFrame, x: Factor = CONTEXT_SIZE, names: Mapping[Value, str] = NUMBERS) -> Axes:
    """Draw the median prediction error of single steps over the number of circles that acted on the vehicle.

    Args:
        ax: where to draw.
        steps: one row per step, see `failures.step_errors`.
        x: the factor with one curve per value.
        names: of its values, for readers; empty for numbers.
    """
    medians = steps.groupby([x.column, "acting"], sort=False)["prediction_error"].median().sort_index(level=1)
    if not len(medians):
        ax.set(xticks=[], yticks=[])
        return say(ax, "no step\nwas outside fog")
    if not np.isfinite(medians).any():
        return unpredicted(ax, "step error")
    for value, color in x_colors(x, steps[x.column].unique()).items():
        curve = medians[value]
        ax.plot(curve.index, curve, marker=".", ms=4, lw=1, color=color, label=names.get(value, x.format(value)))
    ax.set_xticks(range(failures.MANY + 1), [*map(str, range(failures.MANY)), f"{failures.MANY}+"])
    ax.set(xlabel="circles that act", ylabel="median step\nerror (nats)", xlim=(-0.2, failures.MANY + 0.2))
    most = int(medians.index.get_level_values("acting").max())
    if most < failures.MANY:
        low, high = ax.get_xlim()
        say(ax, "no\nsuch\nstep", ((most + 0.4 + high) / 2 - low) / (high - low))
    if medians.max() > LINEAR:
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.set_ylabel(f"median step error\n(nats, log beyond ±{LINEAR})")
        ax.margins(y=0.1)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, handlelength=0.9, fontsize=6.5)
    return ax


def fog_distances(
    ax: Axes,
    ends: pd.DataFrame,
    values: Sequence[Value],
    x: Factor = CONTEXT_SIZE,
    names: Mapping[Value, str] = NUMBERS,
) -> Axes:
    """Draw the distance to fog at the end of runs that never arrived, one point each; dashed: the edge of fog.

    Args:
        ax: where to draw.
        ends: one row per run, see `failures.end_distances`.
        values: of the factor on the x axis, in their order.
        x: that factor.
        names: of its values, for readers; empty for numbers.
    """
    if not len(ends):
        ax.set(xticks=[], yticks=[])
        return say(ax, "every run\narrived")
    places = ends[x.column].map({value: place for place, value in enumerate(values)}).to_numpy(float)
    # Points side by side, in a fixed order, so that runs with similar distances stay visible.
    spread = 0.6 * ((np.arange(len(ends)) * 0.618) % 1 - 0.5)
    ax.axhline(0, color=EFFECTS["fog"].color, lw=1.2, ls="--", zorder=0)
    ax.plot(places + spread, ends["distance"], ls="", marker="o", ms=2.5, mew=0, color="0.2", alpha=0.6)
    name_places(ax, values, names)
    ax.set(xlabel=x.label, ylabel="distance (u)", xlim=(-0.6, len(values) - 0.4))
    return ax


def _stacked(
    ax: Axes,
    table: pd.DataFrame,
    kinds: Mapping[str, str],
    colors: Mapping[str, str],
    x: Factor,
    names: Mapping[Value, str],
    nothing: str,
) -> Axes:
    """Draw stacked bars of shares of runs, by the factor on the x axis (rows) and kind (columns); or say `nothing`."""
    bottom = np.zeros(len(table))
    for kind, name in kinds.items():
        heights = table[kind].to_numpy()
        ax.bar(range(len(table)), heights, 0.75, bottom, color=colors[kind], ec="black", lw=0.6, label=name)
        bottom += heights
    mark_zeros(ax, np.flatnonzero(bottom == 0) if bottom.any() else [])
    name_places(ax, list(table.index), names)
    ax.set(xlabel=x.label, ylabel="share of runs", ylim=(0.0, 1.0))
    return ax if bottom.any() else say(ax, nothing)
