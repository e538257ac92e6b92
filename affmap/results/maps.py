"""An affordance map's colours, and what its nodes are in their world: reachable, beside, alone.

Pure functions of codes, nodes and the world. Axes: M members, Y and X rows and columns of nodes, C context code.
Codes of different members mean different things, so each member has its own basis and its own scale.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from affmap.model.palette import Palette, rounding
from affmap.results.files import Circle, Floats, World

Mask = NDArray[np.bool_]

BESIDE = 0.04
"""u; nodes where the vehicle's rim is at most this far from a surface count as beside it."""

VIEW_SIDE = 0.5
"""u; side of the square that a view shows."""

EPSILON = 1e-6  # u; nodes are float sums of a spacing, comparisons with borders must not hang on the last bit

DIRECTIONS: dict[str, tuple[int, float]] = {"left": (0, -1.0), "right": (0, 1.0), "lower": (1, -1.0), "upper": (1, 1.0)}
"""Side -> its axis and the sign of its outward direction, seen from the centre of a circle or of the arena."""


def surface_distance(nodes: Floats, world: World) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to the nearest obstacle or border; negative inside or outside."""
    distances = [border_distance(nodes, world, side) for side in DIRECTIONS]
    distances += [circle_distance(nodes, circle) for circle in world.obstacles]
    return np.min(distances, axis=0)


def reachable(nodes: Floats, world: World) -> Mask:
    """Can the vehicle's centre be at the positions `[..., 2]`? -> `[...]`."""
    return surface_distance(nodes, world) >= world.vehicle_radius - EPSILON


def colors(codes: Floats, fit: Mask) -> Floats:
    """Paint one member's map: principal components of its codes as red, green and blue (`affmap.model.palette`).

    Args:
        codes: `[Y, X, C]`.
        fit: `[Y, X]` the nodes that basis and scale are computed from.

    Returns:
        `[Y, X, 3]` in [0, 1].
    """
    return Palette.fit(codes[fit])(codes)


def beside(distance: Floats, world: World) -> Mask:
    """Is the vehicle's rim beside a surface, `distance` `[...]` (u) from its centre, or past it? -> `[...]`."""
    return distance <= world.vehicle_radius + BESIDE + EPSILON


def sees_only(nodes: Floats, world: World, things: Sequence[str | Circle]) -> Mask:
    """Where the view around a node shows none of the border sides and circles but `things`."""
    half = VIEW_SIDE / 2
    clear = np.ones(nodes.shape[:-1], dtype=bool)
    for side in DIRECTIONS:
        if side not in things:
            clear &= border_distance(nodes, world, side) >= half - EPSILON
    for circle in world.circles:
        if circle not in things:
            beyond = np.maximum(np.abs(nodes - (circle.x, circle.y)) - half, 0.0)  # from the square to the centre
            clear &= np.linalg.norm(beyond, axis=-1) >= circle.radius - EPSILON
    return clear


def border_distance(nodes: Floats, world: World, side: str) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to a side of the border; negative outside."""
    axis, sign = DIRECTIONS[side]
    return world.size[axis] - nodes[..., axis] if sign > 0 else nodes[..., axis]


def circle_distance(nodes: Floats, circle: Circle) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to the rim of a circle; negative inside."""
    return np.linalg.norm(nodes - (circle.x, circle.y), axis=-1) - circle.radius


def scale(codes: Floats, possible: Mask) -> Floats:
    """`[M]` standard deviation of each member's reachable codes (root mean square distance to their mean).

    A constant map has none; 1 keeps its distances of zero at zero.
    """
    sample = codes[:, possible].astype(np.float64)  # [M, nodes, C]
    spread = np.sqrt(sample.var(axis=1).sum(axis=-1))
    return np.where(spread > rounding(sample), spread, 1.0)
