"""Drawing functions for what happens in the arena: data and Axes in, Axes out.

Lengths are in u, the arena's lower left corner is the origin. They know colours and labels, and neither files nor
figures.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Disc
from matplotlib.patches import Ellipse, Patch, Polygon, Rectangle
from matplotlib.path import Path

from affmap.env.effects import EFFECTS
from affmap.env.geometry import CELL, reachable
from affmap.env.layout import Layout
from affmap.env.scene import LAYERS, Mark, Scene, circle_marks, rims
from affmap.model.palette import Palette
from affmap.results.files import Floats, Maps
from affmap.view import VisibleLayout

FEW = 50
"""Fewer positions than this are drawn one by one instead of as a heat map."""


VISITS = f"visits per cell of {CELL} u (steps)"
"""Label of visit counts."""

FAR = 1e3
"""Shapes are drawn up to this far away and this large, u: Agg takes minutes for the outlines of larger ones."""


def paint(parts: Sequence[tuple[Maps, Layout]], radius: float, index: int) -> list[Floats]:
    """Colour maps of one member in a common basis, fitted to all of them: `[Y, X, 3]` each.

    Args:
        parts: maps of the same models with their layouts, or of the same layout at several epochs.
        radius: of the vehicle, u.
        index: place of the member among the M.
    """
    codes = [arrays.codes[index] for arrays, _ in parts]  # [Y, X, C] each
    fit = [reachable(arrays.nodes, world, radius) for arrays, world in parts]
    palette = Palette.fit(np.concatenate([part[mask] for part, mask in zip(codes, fit, strict=True)]))
    return [palette(part) for part in codes]


def affordance_map(ax: Axes, colors: Floats, x: Floats, y: Floats, world: VisibleLayout) -> Axes:
    """Draw a coloured map with the circles outlined.

    Args:
        ax: where to draw.
        colors: `[Y, X, 3]`, such as those of `paint`.
        x: `[X]`, of the nodes, u.
        y: `[Y]`, of the nodes, u.
        world: the visible layout.
    """
    half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    extent = (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)
    ax.imshow(colors, origin="lower", extent=extent, interpolation="nearest")
    for center_x, center_y, radius, _ in world.circles:
        ax.add_patch(Disc((center_x, center_y), radius, fill=False, ec="black", lw=0.5))
    return arena(ax, world)


def lock(ax: Axes, world: VisibleLayout) -> Axes:
    """Outline the keys and the doors of a visible layout in their colours."""
    doors = [(x, y, radius) for x, y, radius, _ in set(world.circles) - set((world.opened or world).circles)]
    paint_marks(ax, [*rims("key", world.keys), *rims("door", sorted(doors))])
    return ax


def arena(ax: Axes, world: Layout | VisibleLayout) -> Axes:
    """Frame the arena to scale, borders drawn, with axes in u."""
    ax.spines[:].set(visible=True, linewidth=1.2)
    ax.set(xlim=(0, world.size[0]), ylim=(0, world.size[1]), aspect="equal")
    ax.set(xticks=np.arange(0, world.size[0] + 0.01, 1.0), yticks=np.arange(0, world.size[1] + 0.01, 1.0))
    ax.set(xlabel="x (u)", ylabel="y (u)")
    return ax


def times_to_go(ax: Axes, steps: Floats, x: Floats, y: Floats, levels: Floats) -> Axes:
    """Draw lines of equal times to go, every other one with its number.

    Args:
        ax: where to draw.
        steps: `[Y, X]`, steps from each node to the goal; masked where there is no way.
        x: `[X]`, of the nodes, u.
        y: `[Y]`, of the nodes, u.
        levels: steps of the lines, ascending.
    """
    if min(steps.shape) > 1:
        lines = ax.contour(x, y, steps, levels=levels, colors="black", linewidths=0.7)
        lines.set_paths([_without_scraps(path, 2 * (x[1] - x[0])) for path in lines.get_paths()])
        ax.clabel(lines, levels[1::2], fmt="%g", fontsize=5.5, colors="black")
    return ax


def _without_scraps(lines: Path, shortest: float) -> Path:
    """Lines without those shorter than `shortest` (u), which the masked nodes beside walls tear off."""
    kept = [
        Path(part)
        for part in lines.to_polygons(closed_only=False)
        if np.linalg.norm(np.diff(part, axis=0), axis=1).sum() >= shortest
    ]
    return Path.make_compound_path(*kept)


def label_outer(grid: "np.ndarray[Any, Any]", count: int) -> None:
    """Label the axes of arenas at the left of a grid and at the foot of each column; others share these.

    Args:
        grid: `[rows, columns]` of Axes, filled row by row.
        count: number of the arenas; the places after them stay empty.
    """
    for place, ax in enumerate(grid.flat):
        if place >= count:
            ax.set_axis_off()
            continue
        name = ax.get_xlabel()
        ax.label_outer()
        if place + grid.shape[1] >= count:  # nothing is below it
            ax.set_xlabel(name)
            ax.tick_params(labelbottom=True)


def scene(ax: Axes, moment: Scene) -> Axes:
    """Draw a moment of a flight, in the framed arena."""
    paint_marks(ax, moment.marks())
    return arena(ax, moment.layout)


def paint_marks(ax: Axes, marks: Iterable[Mark]) -> None:
    """Draw shapes from the lowest to the highest."""
    for layer, points, radii in marks:
        look: dict[str, Any] = {"alpha": layer.opacity, "lw": layer.width, "color": layer.color, "zorder": 2}
        if radii is None and layer.width:
            ax.plot(*points.T, **look)
            continue
        points, radii = np.clip(points, -FAR, FAR), None if radii is None else np.minimum(radii, FAR)
        shape = Polygon(points) if radii is None else Ellipse(points[0], *(2 * radii))
        shape.set(fill=not layer.width, **look)
        ax.add_patch(shape)


SIGNS: dict[str, dict[str, Any]] = {
    "line": {"ls": "-"},
    "disc": {"marker": "o"},
    "ring": {"marker": "o", "mfc": "none", "mew": 0.6},
    "cross": {"marker": "x", "mew": 2.0},
    "square": {"marker": "s"},
}


def handles(scenes: Sequence[Scene]) -> list[Line2D | Patch]:
    """Legend entries for everything in `scenes`."""
    layers = {mark.layer for scene in scenes for mark in scene.marks() if mark.layer.label}
    signs = [
        Line2D([], [], **{"ls": "", "color": layer.color, "label": layer.label, **SIGNS[layer.sign]})
        for layer in reversed(LAYERS.values())
        if layer in layers
    ]
    return signs + effect_handles(scene.layout for scene in scenes)


def effect_handles(worlds: Iterable[Layout]) -> list[Patch]:
    """Legend entries for the effects in `worlds`; none for obstacles only."""
    present = {circle.effect for world in worlds for circle in world.circles}
    if present <= {"obstacle"}:
        return []
    return [
        Patch(fc=effect.color, ec="none", label=effect.label) for name, effect in EFFECTS.items() if name in present
    ]


def world_map(ax: Axes, world: Layout, radius: float) -> Axes:
    """Draw a layout: circles, the four start squares, and the vehicle to scale in the middle of one of them."""
    paint_marks(ax, circle_marks(world))
    near = world.start_margin
    far_x, far_y = (size - world.start_margin - world.start_side for size in world.size)
    for corner in ((near, near), (far_x, near), (near, far_y), (far_x, far_y)):
        ax.add_patch(
            Rectangle(corner, world.start_side, world.start_side, fill=False, ec=LAYERS["goal"].color, ls="--", lw=1.0)
        )
    middle = near + world.start_side / 2
    ax.add_patch(Disc((middle, middle), radius, color=LAYERS["vehicle"].color, lw=0, zorder=3))
    return arena(ax, world)


def visits(ax: Axes, counts: Floats, free: Floats, world: Layout) -> Axes:
    """Draw visit counts of exploration on a logarithmic scale; unvisited free cells are red, others white.

    Args:
        ax: where to draw.
        counts: `[Y, X]` recorded steps in each cell of 0.1 u.
        free: `[Y, X]`, whether the vehicle's centre can be at the cell's centre.
        world: the layout.
    """
    image = visit_image(ax, counts, free, world, max(2, int(counts.max())))
    ax.figure.colorbar(image, ax=ax, label=VISITS, shrink=0.85)
    return ax


def visit_image(ax: Axes, counts: Floats, free: Floats, world: Layout, most: int) -> AxesImage:
    """Draw visit counts as `visits` does, without a colour bar; `most` is the end of their scale.

    Returns:
        The image, for a colour bar that several panels share.
    """
    extent = (0.0, world.size[0], 0.0, world.size[1])
    unvisited = np.where((free > 0) & (counts == 0), 1.0, np.nan)
    ax.imshow(unvisited, origin="lower", extent=extent, cmap=mpl.colors.ListedColormap([LAYERS["goal"].color]))
    visited = np.ma.masked_less(counts, 1)
    norm = LogNorm(vmin=1, vmax=most)
    image = ax.imshow(visited, origin="lower", extent=extent, norm=norm, cmap="viridis", interpolation="nearest")
    _outlines(ax, world)
    arena(ax, world)
    return image


def heat(ax: Axes, positions: Floats, world: Layout) -> Axes:
    """Draw the number of positions `[N, 2]` (u) in each cell of a layout; few positions are drawn one by one."""
    _outlines(ax, world)
    if not len(positions):
        style: dict[str, Any] = {"ha": "center", "va": "center", "bbox": {"fc": "white", "ec": "none", "pad": 1.0}}
        ax.text(world.size[0] / 2, world.size[1] / 2, "no run", **style)
        return arena(ax, world)
    if len(positions) < FEW:
        ax.plot(*positions.T, "o", ms=3, mfc="none", mec="black")
        return arena(ax, world)
    bins = [np.linspace(0, side, round(side / CELL) + 1) for side in world.size]
    counts, _ = np.histogramdd(positions, bins=bins)  # [X, Y]
    extent = (0.0, world.size[0], 0.0, world.size[1])
    occupied = np.ma.masked_less(counts.T, 1)
    image = ax.imshow(occupied, origin="lower", extent=extent, cmap="viridis_r", vmin=1, interpolation="nearest")
    bar = ax.figure.colorbar(image, ax=ax, shrink=0.6, label="runs")
    bar.locator = mpl.ticker.MaxNLocator(nbins=4, integer=True)
    bar.update_ticks()
    return arena(ax, world)


def _outlines(ax: Axes, world: Layout) -> None:
    for circle in world.circles:
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, fill=False, ec="white", lw=1.2))
        ax.add_patch(Disc((circle.x, circle.y), circle.radius, fill=False, ec="black", lw=0.6))
