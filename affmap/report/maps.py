"""What an affordance map encodes: its colours (principal components) and the two scores of claim I-8.

Pure functions of codes, nodes and the world. Axes: M members, Y and X rows and columns of nodes, C context code.
Codes of different members mean different things, so each member has its own basis and its own scale.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from affmap.report.tables import Circle, Floats, Maps, World

Mask = NDArray[np.bool_]

BESIDE = 0.04
"""u; nodes where the vehicle's rim is at most this far from a surface count as beside it."""

VIEW_SIDE = 0.5
"""u; side of the square that a view shows."""

PERCENTILES = (1.0, 99.0)
"""Of a principal component over the reachable nodes; they become the darkest and the brightest value of a channel."""

_EPSILON = 1e-6  # u; nodes are float sums of a spacing, comparisons with borders must not hang on the last bit

DIRECTIONS: dict[str, tuple[int, float]] = {"left": (0, -1.0), "right": (0, 1.0), "lower": (1, -1.0), "upper": (1, 1.0)}
"""Side -> its axis and the sign of its outward direction, seen from the centre of a circle or of the arena."""

OPPOSITE = {"left": "right", "right": "left", "lower": "upper", "upper": "lower"}


def surface_distance(nodes: Floats, world: World) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to the nearest obstacle or border; negative inside or outside."""
    distances = [_border_distance(nodes, world, side) for side in DIRECTIONS]
    distances += [_circle_distance(nodes, circle) for circle in world.obstacles]
    return np.min(distances, axis=0)


def reachable(nodes: Floats, world: World) -> Mask:
    """Can the vehicle's centre be at the positions `[..., 2]`? -> `[...]`."""
    return surface_distance(nodes, world) >= world.vehicle_radius - _EPSILON


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


def obstacle_contrast(maps: Maps, world: World) -> tuple[Floats, Floats]:
    """Distances to the free-space code, everywhere else and beside a surface (I-8a).

    The free-space code is the mean over the nodes whose view shows nothing. A view that shows nothing is the same
    everywhere, so those codes do not differ among themselves; the claim that can fail is that codes beside a surface
    are farther from it than the rest of the reachable nodes, many of which see a surface from afar.

    Returns:
        `[M]` and `[M]`: mean distances in standard deviations of the member's own map; empty without such nodes.
    """
    nodes = maps.nodes
    distance = surface_distance(nodes, world)
    possible = reachable(nodes, world)
    beside = possible & (distance <= _touching(world))
    rest = possible & ~beside
    free = possible & _sees_only(nodes, world, ())
    if not (beside.any() and rest.any() and free.any()):
        return np.empty(0), np.empty(0)
    scale = _scale(maps.codes, possible)  # [M]
    center = maps.codes[:, free].astype(np.float64).mean(axis=1)  # [M, C]
    apart = np.linalg.norm(maps.codes - center[:, None, None], axis=-1)  # [M, Y, X]
    return apart[:, rest].mean(axis=1) / scale, apart[:, beside].mean(axis=1) / scale


def side_match(maps: Maps, world: World) -> tuple[Floats, Floats]:
    """Distances of codes beside obstacles to codes beside the matching border side and beside the others (I-8b).

    Left of an obstacle the way to the right is blocked, as it is at the right border: those two sides match.
    Only nodes whose view shows nothing but that obstacle, or that border side, are compared; of the obstacle's sides
    those on the axes through its centre.

    Returns:
        `[M]` and `[M]`: distance to the mean code of the matching border side, and the mean of the distances to
        those of the other sides; averaged over the nodes of a side, then over the sides; in standard deviations of
        the member's own map. Empty where fewer than two border sides or no obstacle side can be seen alone.
    """
    possible = reachable(maps.nodes, world)
    borders = {side: _beside_border(maps.nodes, world, side) & possible for side in DIRECTIONS}
    obstacles = {side: _beside_obstacles(maps, world, side) & possible for side in DIRECTIONS}
    centers = {s: maps.codes[:, mask].mean(axis=1, dtype=np.float64) for s, mask in borders.items() if mask.any()}
    sides = [side for side, mask in obstacles.items() if mask.any() and OPPOSITE[side] in centers]
    if len(centers) < 2 or not sides:
        return np.empty(0), np.empty(0)
    matching, others = [], []
    for side in sides:
        codes = maps.codes[:, obstacles[side]]  # [M, nodes, C]
        apart = {s: np.linalg.norm(codes - c[:, None], axis=-1).mean(axis=1) for s, c in centers.items()}  # [M] each
        matching.append(apart.pop(OPPOSITE[side]))
        others.append(np.mean(list(apart.values()), axis=0))
    scale = _scale(maps.codes, possible)
    return np.mean(matching, axis=0) / scale, np.mean(others, axis=0) / scale


def _touching(world: World) -> float:
    return world.vehicle_radius + BESIDE + _EPSILON


def _beside_border(nodes: Floats, world: World, side: str) -> Mask:
    return (_border_distance(nodes, world, side) <= _touching(world)) & _sees_only(nodes, world, (side,))


def _beside_obstacles(maps: Maps, world: World, side: str) -> Mask:
    """Nodes outward of an obstacle's centre along one axis, beside it, and seeing nothing but it."""
    axis, sign = DIRECTIONS[side]
    nodes, spacing = maps.nodes, float(maps.x[1] - maps.x[0])
    mask = np.zeros(nodes.shape[:-1], dtype=bool)
    for circle in world.obstacles:
        offset = nodes - (circle.x, circle.y)
        on_axis = (np.abs(offset[..., 1 - axis]) <= spacing / 2 + _EPSILON) & (sign * offset[..., axis] > 0)
        near = _circle_distance(nodes, circle) <= _touching(world)
        mask |= on_axis & near & _sees_only(nodes, world, (circle,))
    return mask


def _sees_only(nodes: Floats, world: World, things: Sequence[str | Circle]) -> Mask:
    """Where the view around a node shows none of the border sides and circles but `things`."""
    half = VIEW_SIDE / 2
    clear = np.ones(nodes.shape[:-1], dtype=bool)
    for side in DIRECTIONS:
        if side not in things:
            clear &= _border_distance(nodes, world, side) >= half - _EPSILON
    for circle in world.circles:
        if circle not in things:
            beyond = np.maximum(np.abs(nodes - (circle.x, circle.y)) - half, 0.0)  # from the square to the centre
            clear &= np.linalg.norm(beyond, axis=-1) >= circle.radius - _EPSILON
    return clear


def _border_distance(nodes: Floats, world: World, side: str) -> Floats:
    axis, sign = DIRECTIONS[side]
    return world.size[axis] - nodes[..., axis] if sign > 0 else nodes[..., axis]


def _circle_distance(nodes: Floats, circle: Circle) -> Floats:
    return np.linalg.norm(nodes - (circle.x, circle.y), axis=-1) - circle.radius


def _scale(codes: Floats, possible: Mask) -> Floats:
    """`[M]` standard deviation of each member's reachable codes (root mean square distance to their mean).

    A constant map has none; 1 keeps its distances of zero at zero.
    """
    sample = codes[:, possible].astype(np.float64)  # [M, nodes, C]
    spread = np.sqrt(sample.var(axis=1).sum(axis=-1))
    return np.where(spread > _noise(sample), spread, 1.0)


def _noise(values: Floats) -> float:
    """Differences below this are rounding of float32 codes."""
    return 1e-6 * max(1.0, float(np.abs(values).max()))
