"""Drawing functions for losses: they take tables and Axes and return the Axes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from affmap.report.drawing.colors import NUMBERS, Groups, x_colors
from affmap.report.drawing.numbers import HUGE, LINEAR, Span, legend_above, mark, name_places
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import CONTEXT_SIZE, Factor, Value

KIND_COLORS = {
    "free": "#332288",
    "touching": "#8c8c8c",
    "entering": "#CC3311",
    "inside": "#88CCEE",
    "leaving": "#DDCC77",
}
"""Kind of step -> colour (Tol), safe for colour-blind readers."""

STEP_MARKERS = {"median": "o", "mean": "D"}
"""Statistic of the losses of a kind of step -> sign."""

BLACK = "0.15"
"""Points of losses that are not grouped."""

FLATTENED = 4.0
"""Shades that make the axis more than this many times as high as the curves are cut."""

NOTE = 0.13
"""Room for a line of words above the curves, as a share of their height."""


def learning_curves(
    ax: Axes,
    validation: pd.DataFrame,
    paper: Span = None,
    factor: Factor = CONTEXT_SIZE,
    names: Mapping[Value, str] = NUMBERS,
    colors: Mapping[Value, str] | None = None,
) -> Axes:
    """Draw the validation NLL over epochs, one curve per value: mean and standard deviation (shade) over members.

    Args:
        ax: where to draw.
        validation: one row per value, member and epoch.
        paper: see `Span`.
        factor: the factor with one curve per value.
        names: of the values, for readers.
        colors: of the values; by default those of an axis.
    """
    mark(ax, paper)
    values = in_order(validation[factor.column], names)
    num_epochs = validation["epoch"].nunique()
    sns.lineplot(
        validation,
        x="epoch",
        y="validation_nll",
        hue=factor.column,
        hue_order=values,
        palette=dict(colors or x_colors(factor, values)),
        errorbar="sd",
        err_kws={"alpha": 0.18, "lw": 0},
        lw=1.4,
        marker="o" if num_epochs < 10 else None,
        legend="full",
        ax=ax,
    )
    _epochs(ax).set_ylabel(METRICS["validation_nll"].label)
    texts = {str(value): name for value, name in names.items()}
    for line in ax.get_lines():
        line.set_label(texts.get(str(line.get_label()), line.get_label()))
    if factor == CONTEXT_SIZE:
        _focus(ax, validation, paper)
    else:
        _cut_bands(ax)
    return legend_above(ax)


def in_order(column: "pd.Series[Any]", names: Mapping[Value, str]) -> list[Value]:
    """The distinct values in a column, in the order of their names; without names, numbers ascend."""
    values = set(column)
    return [value for value in names if value in values] or sorted(values)


def _cut_bands(ax: Axes) -> None:
    """End the axis half its curves' height above and below them where outliers would flatten them.

    These are shades of single members, and the beginnings of curves, a tenth of their epochs.
    """
    curves = [np.asarray(line.get_ydata(), float) for line in ax.get_lines()]
    heights = np.concatenate([curve[len(curve) // 10 :] for curve in curves] or [np.zeros(1)])
    low, high = np.nanmin(heights), np.nanmax(heights)
    bottom, top = ax.get_ylim()
    if np.isfinite(high - low) and top - bottom > FLATTENED * (high - low) > 0:
        ax.set_ylim(max(bottom, low - 0.5 * (high - low)), min(top, high + 0.5 * (high - low)))


def _focus(ax: Axes, validation: pd.DataFrame, paper: Span) -> None:
    """Fit the axis to the curves with a context if the one without rises far above them, and label that one.

    Losses that are not finite, of members that have diverged, are left out.
    """
    validation = validation[np.isfinite(validation["validation_nll"])]
    losses = validation.pivot_table(index="epoch", columns="context_size", values="validation_nll", aggfunc="mean")
    spread = validation.pivot_table(index="epoch", columns="context_size", values="validation_nll", aggfunc="std")
    sizes = [size for size in sorted(validation["context_size"].unique()) if size > 0]
    if not sizes or 0 not in losses:
        return
    spread = spread.reindex_like(losses[sizes]).fillna(0.0)  # a single member has none
    bands = [(losses[sizes] + sign * spread).stack().to_numpy() for sign in (-1, 1)]
    low, high = min([np.quantile(bands[0], 0.01), *(paper or ())]), max([np.quantile(bands[1], 0.99), *(paper or ())])
    without = losses[0].dropna()
    if without.max() < high + (high - low) / 2:
        return
    margin = 0.05 * (high - low)
    ax.set_ylim(low - margin, high + margin + NOTE * (high - low))
    ax.text(
        0.98,
        0.97,
        f"C = 0: {number(without.max(), 1)} at its worst, {number(without.iloc[-1], 1)} at the end",
        ha="right",
        va="top",
        fontsize=7,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 1.0, "pad": 1.0},
        transform=ax.transAxes,
    )


def step_losses(
    ax: Axes,
    steps: pd.DataFrame,
    kind: str,
    factor: Factor = CONTEXT_SIZE,
    names: Mapping[Value, str] = NUMBERS,
    groups: Groups | None = None,
) -> Axes:
    """Draw losses of one kind of step: medians and means over steps, by the factor that distinguishes trainings.

    Points are medians over members, lines their quartiles. The axis is logarithmic for very large losses.

    Args:
        ax: where to draw.
        steps: one row per training and member, with `kind`, `median` and `mean` (nats).
        kind: one of the kinds of step.
        factor: on the x axis.
        names: of the values on the x axis, for readers, in their order; empty for numbers.
        groups: trainings side by side in colours of their own; None where there is one training per value.
    """
    of_kind = steps[steps["kind"] == kind]
    values = in_order(steps[factor.column], names)
    if groups is None:
        parts = [(of_kind, BLACK)]
    else:
        of_group = groups.of(of_kind)
        parts = [(of_kind[of_group == name], groups.palette[name]) for name in groups.names.values()]
    width = min(0.24, 0.8 / (2 * len(parts)))
    points = [(rows, color, column) for rows, color in parts for column in STEP_MARKERS]
    top = 0.0
    for place, (rows, color, column) in enumerate(points):
        summary = rows.groupby(factor.column)[column].describe().reindex(values)
        low, middle, high = (summary[quartile].to_numpy() for quartile in ("25%", "50%", "75%"))
        x = np.arange(len(values)) + width * (place - (len(points) - 1) / 2)
        top = max([top, *high[np.isfinite(high)]])
        ax.vlines(x, low, high, color=color, lw=0.9)
        ax.plot(x, middle, ls="", color=color, **_marker(column, color))
    name_places(ax, values, names)
    ax.set(xlabel=factor.label, xlim=(-0.6, len(values) - 0.4))
    if top > HUGE:
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.margins(y=0.1)
        if of_kind[["median", "mean"]].to_numpy(float).min() >= 0:
            ax.set_ylim(bottom=0)
    return ax


def step_handles(groups: Groups | None) -> list[Artist]:
    """Legend entries of `step_losses`: the signs of median and mean, then the groups."""
    signs = [Line2D([], [], ls="", color=BLACK, label=f"{column} step", **_marker(column)) for column in STEP_MARKERS]
    return [*signs, *(Patch(fc=color, label=name) for name, color in (groups.palette if groups else {}).items())]


def _marker(column: str, color: str = BLACK) -> dict[str, Any]:
    """Look of a point: medians are filled."""
    return {"marker": STEP_MARKERS[column], "ms": 4, "mfc": color if column == "median" else "white"}


def contributions(ax: Axes, steps: pd.DataFrame, kinds: Sequence[str]) -> Axes:
    """Draw the contribution of each kind of step to the mean loss over epochs, medians over members.

    Args:
        ax: where to draw.
        steps: one row per member, epoch, world and kind, of one training.
        kinds: the kinds to draw, in this order.
    """
    total = steps.groupby(["member", "epoch"])["steps"].sum()
    sums = (steps["steps"] * steps["mean"]).groupby([steps["member"], steps["epoch"], steps["kind"]]).sum()
    share = sums.unstack("kind").div(total, axis=0)
    medians = share.groupby("epoch").median()
    for kind in kinds:
        ax.plot(medians.index, medians[kind], marker=".", ms=4, lw=1.2, color=KIND_COLORS[kind], label=kind)
    ax.plot(medians.index, share.sum(axis=1).groupby("epoch").median(), lw=1.2, ls=":", color="0.1", label="all")
    return _epochs(ax)


def _epochs(ax: Axes) -> Axes:
    """Label the x axis, with ticks at whole epochs only."""
    ax.set_xlabel("epoch")
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, steps=[1, 2, 5, 10]))
    return ax
