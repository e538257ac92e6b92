"""Drawing functions for numbers: tables and Axes in, Axes out.

They know colours and labels, and neither files nor figures.
"""

import warnings
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from affmap.env.effects import EFFECTS
from affmap.report.drawing.colors import Groups, x_colors
from affmap.results import failures, statistics
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.scores import center
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Factor, Value

HUGE, LINEAR = 300, 20
"""nats; where boxes of errors reach beyond the first, the axis is linear up to the second only."""

KIND_COLORS = {
    "free": "#332288",
    "touching": "#8c8c8c",
    "entering": "#CC6677",
    "inside": "#88CCEE",
    "leaving": "#DDCC77",
}
"""Kind of step -> colour (Tol)."""

REASON_COLORS = {"fog": EFFECTS["fog"].color, "stuck": "#333333", "other": "#CC6677"}

LINE_STYLES = ((0, (5, 1.5)), (0, (1, 1)), (0, (3, 1, 1, 1)), (0, (7, 3)))
"""Of the lines of agents without a learned model, in their order."""

FAR = 0.15
"""A line this much above a panel, in its heights, is not drawn."""

LEGEND_WIDTH, TITLE_HEIGHT = 48, 0.2
"""Characters in a line of a legend above a panel, and inches that the panel's title takes."""

Span = tuple[float, float] | None
"""Lowest and highest tick of the paper's axis, marked by dotted lines; or None."""


def learning_curves(
    ax: Axes,
    validation: pd.DataFrame,
    paper: Span = None,
    factor: Factor = CONTEXT_SIZE,
    names: Mapping[Value, str] = MappingProxyType({}),
    colors: Mapping[Value, str] | None = None,
) -> Axes:
    """Validation NLL over epochs, a curve per value: mean over members, and their standard deviation as a shade.

    Args:
        ax: where to draw.
        validation: one row per value, member and epoch.
        paper: see `Span`.
        factor: which values curves tell apart.
        names: of the values, for readers, where they have any.
        colors: of the values; by default those of an axis.
    """
    _mark(ax, paper)
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
    return _legend_above(ax, 8 if len(values) <= 5 else 4)


def _focus(ax: Axes, validation: pd.DataFrame, paper: Span) -> None:
    """End the axis where curves with a context do, if one without rises far above them; say where that one ends."""
    losses = validation.pivot_table(index="epoch", columns="context_size", values="validation_nll", aggfunc="mean")
    spread = validation.pivot_table(index="epoch", columns="context_size", values="validation_nll", aggfunc="std")
    sizes = [size for size in sorted(validation["context_size"].unique()) if size > 0]
    if not sizes or 0 not in losses:
        return
    bands = [(losses[sizes] + sign * spread.reindex(columns=sizes).fillna(0.0)).to_numpy() for sign in (-1, 1)]
    low, high = min([np.quantile(bands[0], 0.01), *(paper or ())]), max([np.quantile(bands[1], 0.99), *(paper or ())])
    without = losses[0]
    if without.max() < high + (high - low) / 2:
        return
    margin = 0.05 * (high - low)
    ax.set_ylim(low - margin, high + margin)
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


def boxes(ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups, paper: Span = None) -> Axes:
    """Box plots of a metric of control by context size, or another factor, as the paper draws them.

    Boxes are quartiles, whiskers end at the last point within 1.5 interquartile ranges, points beyond are not drawn.
    Errors that reach far beyond the others have a logarithmic axis.

    Args:
        ax: where to draw.
        runs: one row per run.
        metric: a column of `runs`.
        groups: what colours tell apart.
        paper: see `Span`.
    """
    if runs[metric].isna().all():  # seaborn needs a number
        return _unpredicted(ax, METRICS[metric].name)
    _mark(ax, paper)
    with warnings.catch_warnings():  # seaborn 0.13 hands matplotlib an argument that is going to be renamed
        warnings.filterwarnings("ignore", "vert: bool", DeprecationWarning)
        sns.boxplot(
            x=groups.x_of(runs),
            y=runs[metric],
            **_by_group(runs, groups),
            whis=1.5,
            showfliers=False,
            gap=0.1,
            linewidth=0.8,
            linecolor="black",
            medianprops={"linewidth": 1.6},
            ax=ax,
        )
    ax.set(xlabel=groups.x.label, ylabel=METRICS[metric].label)
    if runs[metric].min() >= 0:  # a length or a count: let its zero be seen
        ax.set_ylim(bottom=0)
    elif ax.get_ylim()[1] > HUGE:  # a model that is surprised by all it meets: let the others be seen, too
        low = min([ax.dataLim.y0, *(paper or ())])
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.set_ylim(bottom=1.1 * low)
        ax.set_ylabel(f"{METRICS[metric].label[:-1]}, log beyond ±{LINEAR})")
    return _legend_above(ax)


def bars(
    ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups, paper: Span = None, intervals: bool = False
) -> Axes:
    """Mean over members of their shares of runs, as the paper draws them.

    Args:
        ax: where to draw.
        runs: one row per run.
        metric: a column of truth values of `runs`.
        groups: what colours tell apart.
        paper: see `Span`.
        intervals: black lines are 95 % bootstrap intervals, where there are enough members; else standard deviations
            over members.
    """
    _mark(ax, paper)
    keys = [groups.column, groups.x.column, "member"]
    members = runs.astype({metric: float}).groupby(keys, sort=False)[metric].mean().reset_index()
    sns.barplot(
        x=groups.x_of(members),
        y=members[metric],
        **_by_group(members, groups),
        errorbar=_interval if intervals else "sd",
        err_kws={"color": "black", "linewidth": 1.2},
        edgecolor="black",
        linewidth=0.8,
        gap=0.1,
        ax=ax,
    )
    ax.set(xlabel=groups.x.label, ylabel=METRICS[metric].label)
    ax.set_ylim(0.0, max(1.05, ax.get_ylim()[1]))
    ax.set_yticks(np.linspace(0, 1, 6))  # a standard deviation may reach beyond, a share cannot
    return _legend_above(ax)


def baselines(ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups) -> list[Artist]:
    """Lines for agents without a learned model: the middle of their runs, as the boxes or bars beside them have it.

    A line far above the others would make these small; its number is written at the top instead.

    Args:
        ax: a panel with boxes or bars of the same metric.
        runs: one row per run (`Results.baseline_runs`).
        metric: a column of `runs`.
        groups: what colours tell apart; where these are layouts, so do the lines.

    Returns:
        A line for each agent, with its name, for a legend.
    """
    handles: dict[str, Artist] = {}
    by_layout = groups.column == LAYOUT.column
    styles = dict(zip(runs[PLANNER.column].unique(), LINE_STYLES, strict=False))
    bottom, top = ax.get_ylim()
    height, lowest, highest = top - bottom, bottom, top
    beyond: dict[str, list[float]] = {}
    for (name, layout), of_agent in runs.groupby([PLANNER.column, LAYOUT.column], sort=False):
        agent = str(name)
        middle = center(of_agent[metric], metric)
        if np.isnan(middle):
            continue
        if middle > top + FAR * height:
            beyond.setdefault(agent, []).append(middle)
            continue
        color = groups.palette[groups.names[layout]] if by_layout and layout in groups.names else "0.25"
        ax.axhline(middle, color=color, lw=1.1, ls=styles.get(agent, "-"), zorder=3)
        lowest = lowest if bottom == 0 else min(lowest, middle - 0.04 * height)
        highest = max(highest, middle + 0.04 * height)
        handles.setdefault(agent, Line2D([], [], color="0.25", lw=1.1, ls=styles.get(agent, "-"), label=agent))
    ax.set_ylim(lowest, highest)
    if beyond:
        words = ", ".join(f"{agent} {number(max(values), 1)}" for agent, values in beyond.items())
        style: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7, "transform": ax.transAxes}
        ax.text(0.98, 0.99, f"beyond this axis: {words}", bbox={"fc": "white", "ec": "none", "pad": 1.0}, **style)
    return list(handles.values())


def reasons(ax: Axes, runs: pd.DataFrame, x: Factor = CONTEXT_SIZE) -> Axes:
    """Share of the runs that failed for each reason, by context size or another factor.

    Args:
        ax: where to draw.
        runs: one row per run, with the column `reason` (`failures.with_reasons`).
        x: the factor on the x axis.
    """
    shares = failures.shares(runs, "reason", failures.REASONS, x.column)
    return _stacked(ax, shares, failures.REASONS, REASON_COLORS, x)


def nearest(ax: Axes, runs: pd.DataFrame, x: Factor = CONTEXT_SIZE) -> Axes:
    """Share of the runs that never arrived, by the thing nearest to their end, and by context size or another factor.

    Args:
        ax: where to draw.
        runs: one row per run, see `failures.with_nearest`.
        x: the factor on the x axis.
    """
    things = {thing: f"nearest: {name}" for thing, name in failures.NEAREST.items() if (runs["nearest"] == thing).any()}
    colors = {failures.SURFACE: EFFECTS["obstacle"].color, **{name: each.color for name, each in EFFECTS.items()}}
    return _stacked(ax, failures.shares(runs, "nearest", things, x.column), things, colors, x)


def step_errors(ax: Axes, steps: pd.DataFrame, x: Factor = CONTEXT_SIZE) -> Axes:
    """Median prediction error of single steps over the number of circles that acted on the vehicle.

    Args:
        ax: where to draw.
        steps: one row per step, see `failures.step_errors`.
        x: the factor that curves tell apart.
    """
    medians = steps.groupby([x.column, "acting"], sort=False)["prediction_error"].median().sort_index(level=1)
    if len(medians) and medians.isna().all():
        return _unpredicted(ax, "step error")
    for value, color in x_colors(x, steps[x.column].unique()).items():
        curve = medians[value]
        ax.plot(curve.index, curve, marker=".", ms=4, lw=1, color=color, label=x.format(value))
    ax.set_xticks(range(failures.MANY + 1), [*map(str, range(failures.MANY)), f"{failures.MANY}+"])
    ax.set(xlabel="circles that act", ylabel="median step error (nats)")
    if medians.max() > LINEAR:
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.set_ylabel(f"median step error\n(nats, log beyond ±{LINEAR})")
        ax.margins(y=0.1)
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, handlelength=0.9, fontsize=6.5)
    return ax


def fog_distances(ax: Axes, ends: pd.DataFrame, values: Sequence[Value], x: Factor = CONTEXT_SIZE) -> Axes:
    """How far from fog runs ended that never arrived, a point each; dashed: the edge of fog.

    Args:
        ax: where to draw.
        ends: one row per run, see `failures.end_distances`.
        values: of the factor on the x axis, in their order.
        x: that factor.
    """
    places = ends[x.column].map({value: place for place, value in enumerate(values)}).to_numpy(float)
    # Points side by side, in a fixed order: runs that ended at about the same distance stay visible.
    spread = 0.6 * ((np.arange(len(ends)) * 0.618) % 1 - 0.5)
    ax.axhline(0, color=EFFECTS["fog"].color, lw=1.2, ls="--", zorder=0)
    ax.plot(places + spread, ends["distance"], ls="", marker="o", ms=2.5, mew=0, color="0.2", alpha=0.6)
    _name_places(ax, values)
    ax.set(xlabel=x.label, ylabel="distance (u)", xlim=(-0.6, len(values) - 0.4))
    return ax


def step_losses(ax: Axes, steps: pd.DataFrame, kind: str, factor: Factor = CONTEXT_SIZE) -> Axes:
    """Losses of one kind of step: medians and means over steps, over the factor that tells trainings apart.

    Points are medians over members, lines their quartiles. Very large losses have a logarithmic axis.

    Args:
        ax: where to draw.
        steps: one row per training and member, with `kind`, `median` and `mean` (nats).
        kind: one of the kinds of step.
        factor: on the x axis.
    """
    chosen = steps[steps["kind"] == kind]
    values = list(dict.fromkeys(steps[factor.column]))
    for column, marker, face in (("median", "o", "0.15"), ("mean", "D", "white")):
        found = chosen.groupby(factor.column)[column].describe().reindex(values)
        low, middle, high = (found[quartile].to_numpy() for quartile in ("25%", "50%", "75%"))
        place = np.arange(len(values)) + (0.12 if column == "mean" else -0.12)
        ax.vlines(place, low, high, color="0.15", lw=0.9)
        ax.plot(place, middle, ls="", ms=4, color="0.15", label=f"{column} step", marker=marker, mfc=face)
    _name_places(ax, values)
    ax.set(xlabel=factor.label, xlim=(-0.6, len(values) - 0.4))
    if chosen["mean"].max() > HUGE:
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.margins(y=0.1)
        if chosen[["median", "mean"]].to_numpy(float).min() >= 0:
            ax.set_ylim(bottom=0)
    return ax


def contributions(ax: Axes, steps: pd.DataFrame, kinds: Sequence[str]) -> Axes:
    """How much kinds of step add to the mean loss over the epochs, medians over members.

    Args:
        ax: where to draw.
        steps: one row per member, epoch, world and kind, of one training.
        kinds: to draw, in their order.
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


def _stacked(ax: Axes, table: pd.DataFrame, names: Mapping[str, str], colors: Mapping[str, str], x: Factor) -> Axes:
    """Stacked bars of shares of runs, by the factor on the x axis (rows) and kind (columns)."""
    bottom = np.zeros(len(table))
    for kind, name in names.items():
        heights = table[kind].to_numpy()
        ax.bar(range(len(table)), heights, 0.75, bottom, color=colors[kind], ec="black", lw=0.6, label=name)
        bottom += heights
    _name_places(ax, list(table.index))
    ax.set(xlabel=x.label, ylabel="share of runs", ylim=(0.0, 1.0))
    return ax


def _name_places(ax: Axes, values: Sequence[Any]) -> None:
    """Name the places 0, 1, ... on the x axis, so that many names stay apart in a narrow panel."""
    ax.set_xticks(range(len(values)), [str(value) for value in values], fontsize=6 if len(values) > 5 else None)


def _unpredicted(ax: Axes, name: str) -> Axes:
    """Say that a panel is empty because the agents predict nothing."""
    ax.text(0.5, 0.5, f"no {name}:\nnothing was predicted", ha="center", va="center", transform=ax.transAxes)
    ax.set(xticks=[], yticks=[])
    return ax


def _mark(ax: Axes, paper: Span) -> None:
    for tick in paper or ():
        ax.axhline(tick, color="0.6", lw=0.8, ls=":", zorder=0)


def _legend_above(ax: Axes, columns: int = 8) -> Axes:
    """Put the legend to the right of the title, where no data can be; one of several lines stands above the title."""
    names = ax.get_legend_handles_labels()[1]
    columns = max(1, min(columns, LEGEND_WIDTH // (max(map(len, names), default=0) + 4)))
    style = {"frameon": False, "borderaxespad": 0.1, "handlelength": 0.9, "handletextpad": 0.4, "columnspacing": 0.7}
    place, figure = ax.transAxes, ax.get_figure(root=True)
    assert figure is not None
    if len(names) > columns and sum(map(len, names)) > LEGEND_WIDTH:
        place = place + ScaledTranslation(0.0, TITLE_HEIGHT, figure.dpi_scale_trans)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), bbox_transform=place, ncols=columns, **style)
    return ax


def _interval(shares: "pd.Series[float]") -> tuple[float, float]:
    return statistics.interval(shares) if len(shares) >= statistics.MIN_MEMBERS else (np.nan, np.nan)


def _by_group(table: pd.DataFrame, groups: Groups) -> dict[str, Any]:
    """Seaborn's arguments that tell the groups of `table` apart, in the names that readers know."""
    shown = groups.of(table)
    names = [name for name in groups.names.values() if name in set(shown)]
    return {"hue": shown, "hue_order": names, "palette": groups.palette, "saturation": 1.0}
