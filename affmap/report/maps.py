"""An affordance map's colours (principal components), and what its nodes are in their world: reachable, beside, alone.

Pure functions of codes, nodes and the world. Axes: M members, Y and X rows and columns of nodes, C context code.
Codes of different members mean different things, so each member has its own basis and its own scale.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from affmap.report.records import Circle, Floats, World

Mask = NDArray[np.bool_]

BESIDE = 0.04
"""u; nodes where the vehicle's rim is at most this far from a surface count as beside it."""

VIEW_SIDE = 0.5
"""u; side of the square that a view shows."""

PERCENTILES = (1.0, 99.0)
"""Of a principal component over the reachable nodes; they become the darkest and the brightest value of a channel."""

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
    """Paint one member's map: principal components of its codes as red, green and blue.

    The components come from the covariance (float64, largest first); a component's sign is fixed so that its loading
    of largest magnitude is positive. Missing channels (C < 3) are a neutral 0.5.

    Args:
        codes: `[Y, X, C]`.
        fit: `[Y, X]` the nodes that basis and scale are computed from.

    Returns:
        `[Y, X, 3]` in [0, 1].
    """
    values = codes.astype(np.float64)
    sample = values[fit]  # [nodes, C]
    painted = np.full((*codes.shape[:2], 3), 0.5)
    num_components = min(3, codes.shape[-1])
    if num_components == 0 or len(sample) < 2:
        return painted
    basis = principal_components(sample)[:, :num_components]
    projected = (values - sample.mean(axis=0)) @ basis  # [Y, X, components]
    low, high = np.percentile(projected[fit], PERCENTILES, axis=0)
    varies = high - low > _noise(sample)
    scaled = (projected - low) / np.where(varies, high - low, 1.0)
    painted[..., :num_components] = np.where(varies, scaled.clip(0.0, 1.0), 0.5)
    return painted


def principal_components(sample: Floats) -> Floats:
    """`[C, C]` principal axes of `[nodes, C]` in columns, largest variance first, with fixed signs."""
    centered = sample - sample.mean(axis=0)
    _, vectors = np.linalg.eigh(centered.T @ centered / (len(sample) - 1))
    vectors = vectors[:, ::-1]
    largest = np.abs(vectors).argmax(axis=0)
    return vectors * np.sign(vectors[largest, np.arange(vectors.shape[1])])


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
    return np.where(spread > _noise(sample), spread, 1.0)


def _noise(values: Floats) -> float:
    """Differences below this are rounding of float32 codes."""
    return 1e-6 * max(1.0, float(np.abs(values).max()))
