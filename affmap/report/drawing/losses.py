"""Drawing functions for losses: they take tables and Axes and return the Axes."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from affmap.report.drawing.colors import x_colors
from affmap.report.drawing.numbers import HUGE, LINEAR, Span, legend_above, mark, name_places
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import CONTEXT_SIZE, Factor, Value

KIND_COLORS = {
    "free": "#332288",
    "touching": "#8c8c8c",
    "entering": "#CC6677",
    "inside": "#88CCEE",
    "leaving": "#DDCC77",
}
"""Kind of step -> colour (Tol)."""

NOTE = 0.13
"""Room for a line of words above the curves, as a share of their height."""


def learning_curves(
    ax: Axes,
    validation: pd.DataFrame,
    paper: Span = None,
    factor: Factor = CONTEXT_SIZE,
    names: Mapping[Value, str] = MappingProxyType({}),
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
    values = [value for value in names if value in set(validation[factor.column])]
    values = values or sorted(validation[factor.column].unique())
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
    ax.set(xlabel="epoch", ylabel=METRICS["validation_nll"].label)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True, steps=[1, 2, 5, 10]))
    texts = {str(value): name for value, name in names.items()}
    for line in ax.get_lines():
        line.set_label(texts.get(str(line.get_label()), line.get_label()))
    if factor == CONTEXT_SIZE:
        _focus(ax, validation, paper)
    return legend_above(ax, 8 if len(values) <= 5 else 4)


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


def step_losses(ax: Axes, steps: pd.DataFrame, kind: str, factor: Factor = CONTEXT_SIZE) -> Axes:
    """Draw losses of one kind of step: medians and means over steps, by the factor that distinguishes trainings.

    Points are medians over members, lines their quartiles. The axis is logarithmic for very large losses.

    Args:
        ax: where to draw.
        steps: one row per training and member, with `kind`, `median` and `mean` (nats).
        kind: one of the kinds of step.
        factor: on the x axis.
    """
    of_kind = steps[steps["kind"] == kind]
    values = list(dict.fromkeys(steps[factor.column]))
    for column, marker, face in (("median", "o", "0.15"), ("mean", "D", "white")):
        summary = of_kind.groupby(factor.column)[column].describe().reindex(values)
        low, middle, high = (summary[quartile].to_numpy() for quartile in ("25%", "50%", "75%"))
        place = np.arange(len(values)) + (0.12 if column == "mean" else -0.12)
        ax.vlines(place, low, high, color="0.15", lw=0.9)
        ax.plot(place, middle, ls="", ms=4, color="0.15", label=f"{column} step", marker=marker, mfc=face)
    name_places(ax, values)
    ax.set(xlabel=factor.label, xlim=(-0.6, len(values) - 0.4))
    if of_kind["mean"].max() > HUGE:
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.margins(y=0.1)
        if of_kind[["median", "mean"]].to_numpy(float).min() >= 0:
            ax.set_ylim(bottom=0)
    return ax


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
    ax.set(xlabel="epoch")
    return ax
