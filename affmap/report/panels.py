"""Drawing functions: data and Axes in, Axes out. They know colours and labels, and neither files nor figures.

Lengths are in u, the arena's lower left corner is the origin.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, to_hex
from matplotlib.patches import Circle as Disc
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator

from affmap.report import maps, statistics
from affmap.report.tables import PLANNERS, Exploration, Maps, Trajectories, World

PLANNER_COLORS = {"cem": "#0072B2", "gradient": "#E69F00"}  # Okabe and Ito: told apart by everybody, and in grey
EFFECT_COLORS = {"obstacle": "0.55", "fog": "#9ecae1", "force_up": "#a1d99b", "force_down": "#fdae6b", "none": "0.9"}
VEHICLE_COLOR, GOAL_COLOR = "#2ca02c", "#d62728"

NUM_DEVIATIONS = 3
"""Radius of the circles of predicted uncertainty, in standard deviations."""

LABELS = {
    "validation_nll": "validation NLL (nats)",
    "prediction_error": "prediction error (nats)",
    "mean_distance": "mean distance to the goal (u)",
    "steps_touching": "steps touching a surface",
}


def context_color(context_size: int) -> str:
    """The colour of a context size, the same in every report."""
    position = np.interp(context_size, [0, 1, 3, 5, 8, 16, 32], [0.0, 0.22, 0.45, 0.65, 0.82, 0.92, 1.0])
    return to_hex(mpl.colormaps["viridis"](position))


def learning_curves(ax: Axes, validation: pd.DataFrame, paper: tuple[float, float] | None = None) -> Axes:
    """Validation NLL over epochs, per context size: mean over members, and their standard deviation as a shade.

    Args:
        ax: where to draw.
        validation: one row per context size, member and epoch.
        paper: lowest and highest tick of the paper's axis, marked by dotted lines.
    """
    _mark(ax, paper)
    sizes = sorted(validation["context_size"].unique())
    num_epochs = validation["epoch"].nunique()
    sns.lineplot(
        validation,
        x="epoch",
        y="validation_nll",
        hue="context_size",
        palette={size: context_color(size) for size in sizes},
        errorbar="sd",
        err_kws={"alpha": 0.18, "lw": 0},
        lw=1.4,
        marker="o" if num_epochs < 10 else None,
        legend="full",
        ax=ax,
    )
    ax.set(xlabel="epoch", ylabel=LABELS["validation_nll"])
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    return _legend_above(ax)


def boxes(ax: Axes, runs: pd.DataFrame, metric: str, paper: tuple[float, float] | None = None) -> Axes:
    """Box plots of a metric of control by context size and planner, as the paper draws them.

    Boxes are quartiles, whiskers end at the last point within 1.5 interquartile ranges, points beyond are not drawn.

    Args:
        ax: where to draw.
        runs: one row per run.
        metric: a column of `runs`.
        paper: lowest and highest tick of the paper's axis, marked by dotted lines.
    """
    _mark(ax, paper)
    with warnings.catch_warnings():  # seaborn 0.13 hands matplotlib an argument that is going to be renamed
        warnings.filterwarnings("ignore", "vert: bool", DeprecationWarning)
        sns.boxplot(
            x=runs["context_size"],
            y=runs[metric],
            **_by_planner(runs),
            whis=1.5,
            showfliers=False,
            gap=0.1,
            linewidth=0.8,
            linecolor="black",
            medianprops={"linewidth": 1.6},
            ax=ax,
        )
    ax.set(xlabel="context size", ylabel=LABELS[metric])
    if runs[metric].min() >= 0:  # a length or a count: let its zero be seen
        ax.set_ylim(bottom=0)
    return _legend_above(ax)


def success_share(ax: Axes, runs: pd.DataFrame) -> Axes:
    """Share of runs that reached the goal, with 95 % bootstrap intervals over members where there are enough."""
    members = runs.groupby(["planner", "context_size", "member"])["reached"].mean().reset_index()
    sns.barplot(
        x=members["context_size"],
        y=members["reached"],
        **_by_planner(members),
        errorbar=_interval,
        err_kws={"color": "black", "linewidth": 1.2},
        edgecolor="black",
        linewidth=0.8,
        ax=ax,
    )
    ax.set(xlabel="context size", ylabel="share of runs that reached the goal", ylim=(0.0, 1.05))
    return _legend_above(ax)


def lookup_errors(ax: Axes, runs: pd.DataFrame, spacings: Sequence[float]) -> Axes:
    """How far the planner's context codes are from exact ones: mean and standard deviation over runs.

    Args:
        ax: where to draw.
        runs: one row per run.
        spacings: of the maps, u, in the order in which they are to be drawn; 0 is the exact look-up.
    """
    scores = runs.groupby("lookup_spacing")["lookup_error"].agg(["mean", "std"]).loc[list(spacings)]
    ax.errorbar(range(len(spacings)), scores["mean"], scores["std"], fmt="o", color="0.3", ms=3.5, capsize=2, lw=1)
    ax.set_ylim(bottom=0)
    return _spacing_axis(ax, spacings, "context codes", "mean absolute error")


def lookup_differences(ax: Axes, table: pd.DataFrame, spacings: Sequence[float]) -> Axes:
    """Differences of a metric to the first look-up with their 95 % intervals, and the margin as a band.

    Planners and context sizes stand side by side.

    Args:
        ax: where to draw.
        table: what `comparison.compare` returned, for one metric.
        spacings: of the maps, u, the first one being what the others are compared with; 0 is the exact look-up.
    """
    unit, margin = table["unit"].iloc[0], table["margin"].iloc[0]
    ax.axhspan(-margin, margin, color="0.92", lw=0)
    ax.axhline(0, color="0.6", lw=0.8)
    settings = list(table.groupby(["planner", "context_size"]))
    for number, ((short, size), group) in enumerate(settings):
        color = next(PLANNER_COLORS[key] for key, name in PLANNERS.items() if name == short)
        shift = 0.15 * (number - (len(settings) - 1) / 2)
        places = [spacings.index(value) + shift for value in group["b"]]
        reach = [group["difference"] - group["low"], group["high"] - group["difference"]]
        label = f"{short}, C = {size}"
        ax.errorbar(places, group["difference"], reach, fmt="o", color=color, ms=3.5, capsize=2, lw=1, label=label)
    if len(settings) > 1:
        ax.legend(fontsize=6)
    title = str(table["metric"].iloc[0]).replace("_", " ")
    return _spacing_axis(ax, spacings, title, f"difference ({unit})")


def _spacing_axis(ax: Axes, spacings: Sequence[float], title: str, label: str) -> Axes:
    ax.set_xticks(range(len(spacings)), [f"{spacing:g}" if spacing else "exact" for spacing in spacings], rotation=60)
    ax.set_title(title, loc="left")
    ax.set(xlabel="map spacing (u)", ylabel=label, xlim=(-0.5, len(spacings) - 0.5))
    return ax


def affordance_map(ax: Axes, arrays: Maps, index: int, world: World) -> Axes:
    """One member's map in the colours of its own principal components; obstacles outlined.

    Args:
        ax: where to draw.
        arrays: the maps of one context size.
        index: which of its M members.
        world: the layout the maps were built for.
    """
    fit = maps.reachable(arrays.nodes, world)
    half_x, half_y = (arrays.x[1] - arrays.x[0]) / 2, (arrays.y[1] - arrays.y[0]) / 2
    extent = (arrays.x[0] - half_x, arrays.x[-1] + half_x, arrays.y[0] - half_y, arrays.y[-1] + half_y)
    ax.imshow(maps.colors(arrays.codes[index], fit), origin="lower", extent=extent, interpolation="nearest")
    for circle in world.circles:
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, fill=False, ec="black", lw=0.5))
    return arena(ax, world)


def arena(ax: Axes, world: World) -> Axes:
    """Frame the arena to scale, borders drawn, with axes in u."""
    ax.spines[:].set(visible=True, linewidth=1.2)
    ax.set(xlim=(0, world.size[0]), ylim=(0, world.size[1]), aspect="equal")
    ax.set(xticks=np.arange(0, world.size[0] + 0.01, 1.0), yticks=np.arange(0, world.size[1] + 0.01, 1.0))
    ax.set(xlabel="x (u)", ylabel="y (u)")
    return ax


def circles(ax: Axes, world: World) -> Axes:
    """Fill the world's circles by their effect."""
    for circle in world.circles:
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, color=EFFECT_COLORS[circle.effect], lw=0, zorder=1))
    return ax


def world_map(ax: Axes, world: World) -> Axes:
    """The layout: circles, the four start squares, and the vehicle to scale in the middle of one of them."""
    circles(ax, world)
    near = world.start_margin
    far_x, far_y = (size - world.start_margin - world.start_side for size in world.size)
    for corner in ((near, near), (far_x, near), (near, far_y), (far_x, far_y)):
        ax.add_patch(Rectangle(corner, world.start_side, world.start_side, fill=False, ec=GOAL_COLOR, ls="--", lw=1.0))
    middle = near + world.start_side / 2
    ax.add_patch(Disc((middle, middle), world.vehicle_radius, color=VEHICLE_COLOR, lw=0, zorder=3))
    return arena(ax, world)


def visits(ax: Axes, exploration: Exploration, world: World) -> Axes:
    """Visit counts of exploration on a logarithmic scale; free cells never visited are red, others white."""
    counts = np.ma.masked_less(exploration.counts, 1)
    extent = (0.0, world.size[0], 0.0, world.size[1])
    unvisited = np.where(exploration.free & (exploration.counts == 0), 1.0, np.nan)
    ax.imshow(unvisited, origin="lower", extent=extent, cmap=mpl.colors.ListedColormap([GOAL_COLOR]))
    norm = LogNorm(vmin=1, vmax=max(2, int(exploration.counts.max())))
    image = ax.imshow(counts, origin="lower", extent=extent, norm=norm, cmap="viridis", interpolation="nearest")
    ax.figure.colorbar(image, ax=ax, label="visits per cell of 0.1 u (steps)", shrink=0.85)
    for circle in world.circles:
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, fill=False, ec="white", lw=1.2))
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, fill=False, ec="black", lw=0.6))
    return arena(ax, world)


def trajectory(ax: Axes, paths: Trajectories, index: int, step: int, world: World) -> Axes:
    """One moment of one run: past path, planned path with its uncertainty, obstacles, vehicle and goal.

    Args:
        ax: where to draw.
        paths: what control recorded.
        index: which of its B runs.
        step: the moment; the plan is the one made then.
        world: the layout.
    """
    circles(ax, world)
    past = paths.position[index, : step + 1]  # [step + 1, 2]
    plan = np.vstack([past[-1:], paths.planned_position[index, step]])  # [1 + H, 2]
    deviation = paths.planned_std[index, step]  # [H, 2]
    ax.plot(*past.T, color="black", lw=1.3, zorder=4, label="past path")
    ax.plot(*past[0], "s", color="black", ms=4, ls="", zorder=4, label="start")
    ax.plot(*plan.T, color=PLANNER_COLORS["cem"], lw=1.3, ls="-", marker=".", ms=3, zorder=5, label="planned path")
    for mean, (width, height) in zip(plan[1:], 2 * NUM_DEVIATIONS * deviation, strict=True):
        ax.add_patch(Ellipse(mean, width, height, fill=False, ec=PLANNER_COLORS["cem"], lw=0.6, alpha=0.6, zorder=3))
    ax.add_patch(Disc(past[-1], world.vehicle_radius, color=VEHICLE_COLOR, lw=0, zorder=6))
    ax.plot(*paths.goal[index], "x", color=GOAL_COLOR, ms=7, mew=2.0, ls="", zorder=7, label="goal")
    # Empty lines for the legend, where a patch would be a rectangle.
    ax.plot(
        [],
        [],
        "o",
        mfc="none",
        mec=PLANNER_COLORS["cem"],
        mew=0.6,
        label=f"uncertainty ({NUM_DEVIATIONS} sd)",
    )
    ax.plot([], [], "o", color=VEHICLE_COLOR, label="vehicle")
    return arena(ax, world)


def _mark(ax: Axes, paper: tuple[float, float] | None) -> None:
    for tick in paper or ():
        ax.axhline(tick, color="0.6", lw=0.8, ls=":", zorder=0)


def _legend_above(ax: Axes) -> Axes:
    """Put the legend to the right of the title, where no data can be."""
    style = {"frameon": False, "borderaxespad": 0.1, "handlelength": 0.9, "handletextpad": 0.4, "columnspacing": 0.7}
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=8, **style)
    return ax


def _interval(shares: "pd.Series[float]") -> tuple[float, float]:
    return statistics.interval(shares) if len(shares) >= statistics.MIN_MEMBERS else (np.nan, np.nan)


def _by_planner(table: pd.DataFrame) -> dict[str, Any]:
    """Seaborn's arguments that tell the planners of `table` apart, in the paper's names."""
    names = [name for planner, name in PLANNERS.items() if planner in set(table["planner"])]
    palette = {PLANNERS[planner]: color for planner, color in PLANNER_COLORS.items()}
    return {"hue": table["planner"].map(PLANNERS), "hue_order": names, "palette": palette, "saturation": 1.0}
