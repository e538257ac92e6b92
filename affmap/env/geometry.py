"""Geometry of layouts: distances to borders and circles, reachable places, and whether there is a way."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from affmap.env.body import Vehicle
from affmap.env.effects import EFFECTS, SOLID, force_at
from affmap.env.layout import Circle, Layout
from affmap.view import EXTENT

Floats = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

BESIDE = 0.04
"""u; nodes where the vehicle's rim is at most this far from a surface count as beside it."""

EPSILON = 1e-6  # u; nodes are float sums of a spacing, comparisons with borders must not hang on the last bit

DIRECTIONS: dict[str, tuple[int, float]] = {"left": (0, -1.0), "right": (0, 1.0), "lower": (1, -1.0), "upper": (1, 1.0)}
"""Side -> its axis and the sign of its outward direction, seen from the centre of a circle or of the arena."""

CELL = 0.1
"""Side of the cells in which visits are counted, u."""

STEP = 0.01
"""Spacing of the grid on which a way is searched, u."""

WAY_STEP = 0.05
"""Spacing of the grid on which the shortest way is measured, u."""


def crossable(layout: Layout, vehicle: Vehicle, start: np.ndarray, goal: np.ndarray) -> bool:
    """Whether the vehicle can get from `start` to `goal` `[2]` (u) steering freely all the way, if need be over a key.

    It must touch no obstacle and no border, stay out of fog, and pass only places where two throttles can push against
    the force fields that act there. That is sufficient, up to the grid, on which start and goal move to their nearest
    points; it is not necessary: a vehicle may also be carried through a field, or find its way in fog.
    """
    areas = _passable_areas(layout, vehicle)
    there = _area(areas, start)
    if there and there == _area(areas, goal):
        return True
    opens = any(there and there == _area(areas, np.array([x, y])) for x, y, _ in layout.map.keys)
    return opens and crossable(layout.opened, vehicle, start, goal)


def _area(areas: NDArray[np.integer[Any]], place: np.ndarray) -> int:
    """Number of the area around the point of the grid nearest to a place `[2]` (u); 0 for none."""
    column, row = np.clip(np.round(place / STEP).astype(int), 0, np.array(areas.shape) - 1)
    return int(areas[column, row])


def _passable_areas(layout: Layout, vehicle: Vehicle) -> NDArray[np.integer[Any]]:
    """Numbers of the connected areas of a grid `[X, Y]` in which the vehicle steers freely, from 1; 0 elsewhere."""
    from scipy import ndimage  # takes a tenth of a second to import

    x, y = (np.arange(round(side / STEP) + 1) * STEP for side in layout.size)
    inside_x, inside_y = (
        (axis >= vehicle.radius) & (axis <= side - vehicle.radius)
        for axis, side in zip((x, y), layout.size, strict=True)
    )
    passable = np.logical_and.outer(inside_x, inside_y)
    pull = np.zeros((*passable.shape, 2))  # N
    for circle in layout.circles:
        center_x, center_y = circle.center
        limit = circle.radius + layout.reach(circle, vehicle.radius)
        affected = np.hypot.outer(x - center_x, y - center_y) < limit
        if circle.effect == "fog" or circle.effect in SOLID:
            passable &= ~affected
        elif (effect := EFFECTS[circle.effect]).pull:
            pull += affected[..., None] * vehicle.force * np.array(effect.pull)
        elif effect.force:
            ways = np.stack(np.broadcast_arrays((x - center_x)[:, None], y - center_y), axis=-1)[affected]
            pull[affected] += force_at(circle.effect, effect.force, ways, np.zeros_like(ways))
    passable &= np.linalg.norm(pull, axis=-1) <= math.sqrt(2) * vehicle.thrust
    areas: NDArray[np.integer[Any]] = ndimage.label(passable)[0]  # by sides only: no squeezing through diagonally
    return areas


def way_length(layout: Layout, radius: float, start: np.ndarray, goal: np.ndarray) -> float:
    """Length of the shortest way around obstacles from `start` to `goal` `[2]` (u), infinite if there is none, u.

    Distances are sums along both axes: a vehicle is fastest along one of them, where two throttles push, so that this
    length divided by its top speed is the least number of steps in a world of obstacles, up to the grid. The way may
    lead over a key, and then through doors.
    """
    x, y = (np.arange(round(side / WAY_STEP) + 1) * WAY_STEP for side in layout.size)
    nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    steps, ways = _grid_steps(layout, radius, nodes, start, goal)
    if layout.opened is not layout:
        from_goal, _ = _grid_steps(layout.opened, radius, nodes, goal, start)
        over_keys = (steps + from_goal)[layout.map.at_key(nodes)]
        ways = min(ways, over_keys.min(initial=math.inf))
    return float(ways * WAY_STEP)


def _grid_steps(
    layout: Layout, radius: float, nodes: Floats, start: np.ndarray, goal: np.ndarray
) -> tuple[Floats, float]:
    """Steps along a grid of nodes `[X, Y, 2]` from that nearest to `start` `[2]`: to all `[X, Y]`, and to `goal`."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra  # takes a tenth of a second to import

    free = reachable(nodes, layout, radius)
    indices = np.arange(free.size).reshape(free.shape)
    right, up = free[:-1] & free[1:], free[:, :-1] & free[:, 1:]
    begins = np.concatenate([indices[:-1][right], indices[:, :-1][up]])
    ends = np.concatenate([indices[1:][right], indices[:, 1:][up]])
    graph = csr_matrix((np.ones(len(begins)), (begins, ends)), shape=(free.size, free.size))
    offsets = np.abs(nodes[free] - np.stack([start, goal])[:, None]).sum(-1)  # [2, nodes that are free]
    first, last = indices[free][offsets.argmin(1)]
    steps: Floats = dijkstra(graph, directed=False, indices=first, unweighted=True)
    return steps.reshape(free.shape), float(steps[last])


def surface_distance(nodes: Floats, layout: Layout) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to the nearest obstacle or border; negative inside or outside."""
    distances = [border_distance(nodes, layout, side) for side in DIRECTIONS]
    distances += [circle_distance(nodes, circle) for circle in layout.obstacles]
    return np.min(distances, axis=0)


def border_distance(nodes: Floats, layout: Layout, side: str) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to a side of the border; negative outside."""
    axis, sign = DIRECTIONS[side]
    return layout.size[axis] - nodes[..., axis] if sign > 0 else nodes[..., axis]


def circle_distance(nodes: Floats, circle: Circle) -> Floats:
    """Distance `[...]` (u) of positions `[..., 2]` to the rim of a circle; negative inside."""
    return np.linalg.norm(nodes - (circle.x, circle.y), axis=-1) - circle.radius


def affected(nodes: Floats, layout: Layout, circle: Circle, radius: float) -> Mask:
    """Whether a circle of a layout acts on a vehicle of `radius` (u) at the positions `[..., 2]`: `[...]`."""
    return circle_distance(nodes, circle) < layout.reach(circle, radius)


def reachable(nodes: Floats, layout: Layout, radius: float) -> Mask:
    """Whether the centre of a vehicle of `radius` (u) can be at the positions `[..., 2]`: `[...]`."""
    return surface_distance(nodes, layout) >= radius - EPSILON


def beside(distance: Floats, radius: float) -> Mask:
    """Whether the rim of a vehicle of `radius` (u) is beside a surface, `distance` `[...]` (u) from its centre."""
    return distance <= radius + BESIDE + EPSILON


def sees_only(nodes: Floats, layout: Layout, things: Sequence[str | Circle]) -> Mask:
    """Whether the view at the positions `[..., 2]` shows none of the border sides and circles but `things`: `[...]`."""
    half = EXTENT / 2
    clear = np.ones(nodes.shape[:-1], dtype=bool)
    for side in DIRECTIONS:
        if side not in things:
            clear &= border_distance(nodes, layout, side) >= half - EPSILON
    for circle in layout.circles:
        if circle not in things:
            beyond = np.maximum(np.abs(nodes - (circle.x, circle.y)) - half, 0.0)  # from the square to the centre
            clear &= np.linalg.norm(beyond, axis=-1) >= circle.radius - EPSILON
    return clear
