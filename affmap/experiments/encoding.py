"""Scores of affordance maps, for the claims about the encoding of obstacles, borders, fog and force fields.

Pure functions of maps and their world. Axes: M members, Y and X rows and columns of nodes, C context code. A score has
one number per member, in standard deviations of the member's own map, so that members can be compared. Each
function documents the nodes that it compares; in a world without such nodes its score is empty.
"""

from collections.abc import Sequence

import numpy as np

from affmap.env.geometry import (
    DIRECTIONS,
    EPSILON,
    Mask,
    affected,
    beside,
    border_distance,
    circle_distance,
    reachable,
    sees_only,
    surface_distance,
)
from affmap.env.layout import Circle, Layout
from affmap.model.palette import rounding
from affmap.results.files import Floats, Maps

OPPOSITE = {"left": "right", "right": "left", "lower": "upper", "upper": "lower"}


def obstacle_contrast(maps: Maps, world: Layout, radius: float) -> tuple[Floats, Floats]:
    """Distances to the free-space code, beside a surface and everywhere else (I-8a).

    The free-space code is the mean over the nodes whose view shows nothing. A view that shows nothing is the same
    everywhere, so those codes do not differ among themselves; the claim that can fail is that codes beside a surface
    are farther from it than the rest of the reachable nodes, many of which see a surface from afar.

    Returns:
        `[M]` and `[M]`: mean distances in standard deviations of the member's own map; empty without such nodes.
    """
    possible = reachable(maps.nodes, world, radius)
    near = possible & beside(surface_distance(maps.nodes, world), radius)
    return _from_free_space(maps, world, radius, near, possible & ~near)


def meaningless_trace(maps: Maps, world: Layout, radius: float) -> tuple[Floats, Floats]:
    """Distances to the free-space code beside or in circles without effect, and beside obstacles (III-2).

    Both are means over the reachable nodes where the vehicle's rim is beside the circle, or overlaps it, and whose view
    shows that circle only: one rule for either kind. An obstacle keeps the vehicle out, so that of the other circles
    more is seen, up to the whole one: were both kinds encoded alike, the first distance would be about as large as
    the second, or larger. The comparison is therefore biased towards finding a trace.

    Returns:
        `[M]` and `[M]`: mean distances in standard deviations of the member's own map; empty without such nodes.
    """
    meaningless = [circle for circle in world.circles if circle.effect == "none"]
    near = [_beside_only(maps.nodes, world, radius, circles) for circles in (meaningless, world.obstacles)]
    return _from_free_space(maps, world, radius, *near)


def side_match(maps: Maps, world: Layout, radius: float) -> tuple[Floats, Floats]:
    """Distances of codes beside obstacles to codes beside the matching border side and beside the others (I-8b).

    Left of an obstacle the way to the right is blocked, as it is at the right border: those two sides match.
    Only nodes whose view shows nothing but that obstacle, or that border side, are compared; of the obstacle's sides
    those on the axes through its centre.

    Returns:
        `[M]` and `[M]`: distance to the mean code of the matching border side, and the mean of the distances to
        those of the other sides; averaged over the nodes of a side, then over the sides; in standard deviations of
        the member's own map. Empty where fewer than two border sides or no obstacle side can be seen alone.
    """
    possible = reachable(maps.nodes, world, radius)
    borders = {side: _beside_border(maps.nodes, world, radius, side) & possible for side in DIRECTIONS}
    obstacles = {side: _beside_obstacles(maps, world, radius, side) & possible for side in DIRECTIONS}
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
    sd = scale(maps.codes, possible)
    return np.mean(matching, axis=0) / sd, np.mean(others, axis=0) / sd


def look_difference(maps: Maps, world: Layout, radius: float) -> Floats:
    """Distance between codes beside a lower obstacle and, at the same offsets, beside the upper one above it (III-3).

    Lower and upper are the halves of the arena; a pair has the same x and radius. Compared are the offsets at which
    both nodes are reachable, the rim of the vehicle is beside the obstacle, and the view shows that obstacle only. The
    same offset is exact where the pair's distance is a multiple of the nodes' spacing, else up to half of it.

    Returns:
        `[M]`: mean distance in standard deviations of the member's own map; empty without such nodes.
    """
    nodes, num_rows, middle = maps.nodes, len(maps.y), world.size[1] / 2
    distances = []
    for below in (circle for circle in world.obstacles if circle.y < middle):
        for above in (circle for circle in world.obstacles if circle.y > middle):
            if max(abs(above.x - below.x), abs(above.radius - below.radius)) > EPSILON:
                continue
            shift = round((above.y - below.y) / float(maps.y[1] - maps.y[0]))  # rows
            start, end = slice(num_rows - shift), slice(shift, num_rows)
            both = _beside_only(nodes, world, radius, [below])[start] & _beside_only(nodes, world, radius, [above])[end]
            difference = maps.codes[:, end][:, both] - maps.codes[:, start][:, both]  # [M, nodes, C]
            distances.append(np.linalg.norm(difference, axis=-1))
    if not sum(distance.shape[1] for distance in distances):
        return np.empty(0)
    return np.concatenate(distances, axis=1).mean(axis=1) / scale(maps.codes, reachable(nodes, world, radius))


def separation(maps: Maps, world: Layout, radius: float, kind: str, others: Sequence[str]) -> tuple[Floats, Floats]:
    """Distance between two kinds of places, and scatter of their codes (IV-4, V-5).

    Of several other kinds, the one with the smallest distance beyond the scatter counts.

    Kinds are `free space` (the view shows nothing), the `border` (beside it) and circles by their effect (beside an
    obstacle, where any other acts); a view shows no other thing. Codes also say in which direction a thing is, so a
    kind consists of groups: the four sides of the border, the four sides of circles that a node may be on. A mean over
    all sides would say nothing: if the codes of opposite sides were opposite, it would be the free-space code. To be
    nearer to the mean of one's own kind than to another mean would say little, either: a mean is nearest to its own
    points by definition. So the distance between means has to be larger than the scatter.

    Returns:
        `[M]` and `[M]`: distance of a group's mean to the nearest one of the other kind, of the kind that is nearer to
        the other; and mean distance of a group's codes to the group's mean, of the kind that scatters more; averaged
        over the groups of a kind, in standard deviations of the member's own map. Empty where a kind has no node.
    """
    possible = reachable(maps.nodes, world, radius)
    masks = [[group & possible for group in _groups(maps.nodes, world, radius, name)] for name in (kind, *others)]
    one, *rest = ([maps.codes[:, group] for group in groups if group.any()] for groups in masks)
    if not one or not all(rest):
        return np.empty(0), np.empty(0)
    sd = scale(maps.codes, possible)
    apart = np.stack([np.minimum(_nearest(one, other), _nearest(other, one)) for other in rest])  # [others, M]
    scatter = np.stack([np.maximum(_scatter(one), _scatter(other)) for other in rest])
    least = (apart - scatter).argmin(axis=0), np.arange(len(sd))
    return apart[least] / sd, scatter[least] / sd


def _groups(nodes: Floats, world: Layout, radius: float, kind: str) -> list[Mask]:
    """Groups of nodes `[Y, X]` of a kind of place, reachable or not, some of them perhaps empty."""
    if kind == "free space":
        return [sees_only(nodes, world, ())]
    if kind == "border":
        return [_beside_border(nodes, world, radius, side) for side in DIRECTIONS]
    circles = [circle for circle in world.circles if circle.effect == kind]
    return [_any([_at(nodes, world, radius, circle, side) for circle in circles], nodes) for side in DIRECTIONS]


def _at(nodes: Floats, world: Layout, radius: float, circle: Circle, side: str) -> Mask:
    """Nodes in the quarter to one side of a circle's centre where the vehicle sees nothing else.

    The circle acts on it there, or it is beside it where that is an obstacle.
    """
    axis, sign = DIRECTIONS[side]
    offset = nodes - (circle.x, circle.y)
    quarter = sign * offset[..., axis] >= np.abs(offset[..., 1 - axis])
    if circle.effect == "obstacle":
        near = beside(circle_distance(nodes, circle), radius)
    else:
        near = affected(nodes, world, circle, radius)
    return quarter & near & sees_only(nodes, world, (circle,))


def _scatter(groups: Sequence[Floats]) -> Floats:
    """`[M]` mean distance of codes `[M, nodes, C]` to the mean of their group, averaged over the groups."""
    apart = [np.linalg.norm(codes - _center(codes)[:, None], axis=-1).mean(axis=1) for codes in groups]
    return np.mean(apart, axis=0)


def _nearest(groups: Sequence[Floats], others: Sequence[Floats]) -> Floats:
    """`[M]` distance of a group's mean to the nearest mean of the others, averaged over the groups."""
    centers = np.stack([_center(codes) for codes in others], axis=1)  # [M, groups, C]
    apart = [np.linalg.norm(_center(codes)[:, None] - centers, axis=-1).min(axis=1) for codes in groups]
    return np.mean(apart, axis=0)


def _center(codes: Floats) -> Floats:
    return codes.mean(axis=1, dtype=np.float64)


def _from_free_space(maps: Maps, world: Layout, radius: float, first: Mask, second: Mask) -> tuple[Floats, Floats]:
    """`[M]` and `[M]`: mean distances of the codes at either nodes to the mean code of those that see nothing."""
    possible = reachable(maps.nodes, world, radius)
    free = possible & sees_only(maps.nodes, world, ())
    if not (first.any() and second.any() and free.any()):
        return np.empty(0), np.empty(0)
    center = _center(maps.codes[:, free])
    apart = np.linalg.norm(maps.codes - center[:, None, None], axis=-1)  # [M, Y, X]
    sd = scale(maps.codes, possible)
    return apart[:, first].mean(axis=1) / sd, apart[:, second].mean(axis=1) / sd


def _beside_only(nodes: Floats, world: Layout, radius: float, circles: Sequence[Circle]) -> Mask:
    """Reachable nodes where the vehicle is beside one of `circles`, or overlaps it, and sees that one only."""
    near = [beside(circle_distance(nodes, circle), radius) & sees_only(nodes, world, (circle,)) for circle in circles]
    return reachable(nodes, world, radius) & _any(near, nodes)


def _any(masks: Sequence[Mask], nodes: Floats) -> Mask:
    return np.any([np.zeros(nodes.shape[:-1], dtype=bool), *masks], axis=0)


def _beside_border(nodes: Floats, world: Layout, radius: float, side: str) -> Mask:
    return beside(border_distance(nodes, world, side), radius) & sees_only(nodes, world, (side,))


def _beside_obstacles(maps: Maps, world: Layout, radius: float, side: str) -> Mask:
    """Nodes outward of an obstacle's centre along one axis, beside it, and seeing nothing but it."""
    axis, sign = DIRECTIONS[side]
    nodes, spacing = maps.nodes, float(maps.x[1] - maps.x[0])
    mask = np.zeros(nodes.shape[:-1], dtype=bool)
    for circle in world.obstacles:
        offset = nodes - (circle.x, circle.y)
        on_axis = (np.abs(offset[..., 1 - axis]) <= spacing / 2 + EPSILON) & (sign * offset[..., axis] > 0)
        near = beside(circle_distance(nodes, circle), radius)
        mask |= on_axis & near & sees_only(nodes, world, (circle,))
    return mask


def scale(codes: Floats, possible: Mask) -> Floats:
    """`[M]` standard deviation of each member's reachable codes (root mean square distance to their mean).

    A constant map has none; 1 keeps its distances of zero at zero.
    """
    sample = codes[:, possible].astype(np.float64)  # [M, nodes, C]
    spread = np.sqrt(sample.var(axis=1).sum(axis=-1))
    return np.where(spread > rounding(sample), spread, 1.0)
