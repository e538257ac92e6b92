"""Time to go: from everywhere in an arena to a goal, along shortest paths of imagined steps.

An affordance map says what actions do at a place. Here a few imagined steps from each node of a grid become the edges
of a graph, and shortest paths make of it what actions do in the whole arena: a cognitive map, by which an agent finds a
way that is longer than its horizon. Nothing is learned for it. (The paper's agents are greedy; they have no such map.)
Where a key opens doors, there are two such maps, and a way from the first to the second leads over a key.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from affmap.control.controller import Observation
from affmap.control.settings import ControlSettings
from affmap.env.body import THROTTLES
from affmap.settings import ConfigError
from affmap.settings.messages import format_value

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from torch import Tensor

    from affmap.control.mpc import PlanningAgent
    from affmap.view import VisibleLayout

Floats = NDArray[np.floating]
Mask = NDArray[np.bool_]

DIRECTIONS = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)])
"""`[8, 2]`, from a node to its neighbours, in spacings."""

GOAL, DOOR = -1, -2
"""In place of a next node: the way ends at the goal, or goes on in the map of the opened world."""

NODES_AT_ONCE = 512
"""Nodes from which all agents imagine at once; more take much memory where runs are many."""


class TimeToGo:
    """Times from the nodes of a grid to the goals of B vehicles; `TimeToGo.imagine` makes one.

    Attributes:
        steps: `[B, Y, X]`, steps from each node to the goal, and what their uncertainty costs; infinite where no way
            is imagined. Row 0 has the smallest y.
        x: `[X]`, of the columns of nodes, u.
        y: `[Y]`, of the rows, u.
        goals: `[B, 2]`, u.
        opened: the map of the same worlds once their doors are open; None without doors.
    """

    def __init__(
        self,
        costs: Floats,
        x: Floats,
        y: Floats,
        goals: Floats,
        pace: float,
        opened: TimeToGo | None = None,
        keys: Mask | None = None,
    ) -> None:
        """Find the shortest paths from all nodes.

        Args:
            costs: `[B, 8, Y, X]`, from each node to its neighbours in the order of `DIRECTIONS`; infinite for none.
            x: `[X]`, see the class.
            y: `[Y]`, likewise.
            goals: `[B, 2]`, u.
            pace: cost of the way between a vehicle or a goal and the nodes near it, per u.
            opened: see the class.
            keys: `[B, Y, X]`, nodes from which it goes on in `opened`.
        """
        self.x, self.y, self.goals, self._pace, self.opened = x, y, goals, pace, opened
        self._spacing = float(max(np.diff(x).max(initial=0.0), np.diff(y).max(initial=0.0)))
        self._nodes = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)
        steps, self._next = self._search(costs, keys)
        self.steps = steps.reshape(len(goals), len(y), len(x))

    @classmethod
    def imagine(cls, agent: PlanningAgent, goals: ArrayLike, settings: ControlSettings | None = None) -> TimeToGo:
        """Imagine the steps of an agent everywhere in its world or worlds, and find the ways to goals.

        From rest at each node, each of eight directions of thrust is imagined. A neighbour is reached where one of
        these paths comes that far, within `guide_steps` per spacing, and no more than half a spacing beside it. This
        costs the steps until then and, per u of the standard deviation imagined there, `guide_uncertainty` steps.
        In worlds with doors this is done twice, with them and without. From the nodes in the inner half of a key, or
        else the nearest one in it, a way goes on in the second map at no cost, and not back.

        Args:
            agent: a learned agent, or one that knows the physics; each member has maps of its own.
            goals: `[B, 2]` in u, the same number for each member (member-major); or `[2]`, the same for all members.
            settings: those of the map, the keys `guide_...`; by default the agent's.

        Raises:
            ConfigError: the goals have another shape, or lie outside the arena.
        """
        settings = agent.settings if settings is None else settings
        points = _goals(goals, len(agent.seeds), agent.size)
        x, y = (_nodes(side, settings.guide_spacing) for side in agent.size)
        number, pace = len(points), settings.guide_steps / settings.guide_spacing
        costs = _costs(agent, number, x, y, settings)
        if not agent.has_doors:
            return cls(costs, x, y, points, pace)
        opened = cls(_costs(agent.now(np.ones(number, bool)), number, x, y, settings), x, y, points, pace)
        return cls(costs, x, y, points, pace, opened, _key_nodes(agent.worlds, number, x, y))

    def __repr__(self) -> str:
        number, height, width = self.steps.shape
        return f"TimeToGo({number} x {width} x {height} nodes {self._spacing:.3g} u apart)"

    def subgoals(self, positions: ArrayLike, distance: float, is_open: Mask | None = None) -> Floats:
        """Points at a `distance` (u) ahead of `positions` `[B, 2]` (u), along the shortest paths: `[B, 2]`, u.

        The goal itself, or the key that has to be visited first, where it is nearer than that; and the goal where no
        way is imagined. `is_open` `[B]` says whose doors are open already; by default nobody's.
        """
        points = np.asarray(positions, float)
        if self.opened and is_open is not None and is_open.any():
            ahead = self.opened.subgoals(points, distance)
            return np.where(is_open[:, None], ahead, self.subgoals(points, distance))
        rest, ends = np.full(len(points), float(distance)), self.goals.copy()
        for before, after, still in self._legs(points):
            length = np.linalg.norm(after - before, axis=-1)
            stops = still & (rest > 0) & (length >= rest)
            share = np.divide(rest, length, out=np.zeros_like(rest), where=length > 0)
            ends[stops] = (before + share[:, None] * (after - before))[stops]
            goes_on = still & (rest > 0) & ~stops
            ends[goes_on] = after[goes_on]
            rest = np.where(goes_on, rest - length, 0)
            if not (rest > 0).any():
                break
        return ends

    def paths(self, positions: ArrayLike, is_open: Mask | None = None) -> list[Floats]:
        """Shortest paths from `positions` `[B, 2]` or, for all B, `[2]` (u).

        A path may lead over a key and on through its door; `is_open` as in `subgoals`.

        Returns:
            B arrays `[points, 2]`, u; of one point where there is no way, nor where one begins inside a wall that cuts
            off the position.

        Raises:
            ConfigError: the positions have another shape, or lie outside the arena.
        """
        number = len(self.goals)
        points = _points("positions", positions, (self.x[[0, -1]].sum(), self.y[[0, -1]].sum()))  # equal margins
        points = np.broadcast_to(points, (number, 2)) if points.shape == (2,) else points
        if points.shape != (number, 2):
            raise ConfigError(
                f"positions has the shape {list(points.shape)}; give one for all, [2], or one for each of {number} "
                "goals, [B, 2]."
            )
        paths, cut_off = [[point] for point in points], self._cut_off(points)
        for _, after, still in self._legs(points):
            for path, point, goes_on in zip(paths, after, still & ~cut_off, strict=True):
                if goes_on:
                    path.append(point)
        made = [np.array(path) for path in paths]
        if self.opened is None:
            return made
        is_open = np.zeros(len(points), bool) if is_open is None else is_open
        at_key = [
            len(path) > 1 and not np.array_equal(path[-1], goal) for path, goal in zip(made, self.goals, strict=True)
        ]
        later = self.opened.paths(np.where(is_open[:, None], points, [path[-1] for path in made]))
        return [
            after if now else np.vstack([before, after[1:]]) if key else before
            for before, after, now, key in zip(made, later, is_open, at_key, strict=True)
        ]

    def clear(self, index: int = 0) -> np.ma.MaskedArray:
        """Steps of the map at `index`, `[Y, X]`, without nodes that are no place to be, for pictures.

        There is no way from these, or its first leg costs more than four times the median leg, beside a wall and in
        fog.
        """
        steps, following = self.steps[index].ravel(), self._next[index]
        leg, moves = np.full(len(steps), np.inf), following >= 0
        leg[moves] = steps[moves] - steps[following[moves]]
        leg[(steps == 0) | (following == DOOR)] = 0
        usual = np.median(leg[moves]) if moves.any() else 0
        return np.ma.masked_where(leg > 4 * usual, steps).reshape(self.steps[index].shape)

    def levels(self, index: int = 0) -> Floats:
        """About ten round numbers of steps, up to those of the farthest nodes of the map at `index` that are clear."""
        from matplotlib.ticker import MaxNLocator  # takes a tenth of a second to import

        known = self.clear(index).compressed()
        return np.asarray(MaxNLocator(10).tick_values(0, known.max(initial=0)))[1:]  # 0 is the goal itself

    def lines(self, index: int = 0) -> list[Floats]:
        """Lines of equal times to go, at `levels`, in the map at `index`: `[points, 2]` each, u."""
        from matplotlib.figure import Figure  # likewise

        steps = self.clear(index)
        if min(steps.shape) < 2:
            return []
        lines = Figure().subplots().contour(self.x, self.y, steps, self.levels(index)).allsegs
        return [line for level in lines for line in level if len(line) > 1]

    def _cut_off(self, positions: Floats) -> NDArray[np.bool_]:
        """Whether positions `[B, 2]` have no way but from a node inside a wall, from which models imagine a way out.

        That node is not `clear`, and others as near have no way. In fog, where no node is clear, those have.
        """
        near, total = self._near(positions)
        hidden = [np.ma.getmaskarray(self.clear(index)).ravel()[node] for index, node in enumerate(total.argmin(1))]
        cut_off: NDArray[np.bool_] = (near & np.isinf(total)).any(1) & np.array(hidden, bool)
        return cut_off

    def _near(self, positions: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """Whether nodes are near positions `[B, 2]`, and what the ways over these cost: `[B, N]`; infinite for none."""
        distance = np.linalg.norm(self._nodes - positions[:, None], axis=-1)
        near = distance < 1.5 * self._spacing
        return near, np.where(near, self.steps.reshape(near.shape) + self._pace * distance, np.inf)

    def _legs(self, positions: Floats) -> Iterator[tuple[Floats, Floats, NDArray[np.bool_]]]:
        """Legs of the paths from positions `[B, 2]`: begin and end `[B, 2]`, and which paths `[B]` still have one."""
        each, (_, total) = np.arange(len(positions)), self._near(positions)
        node, here = total.argmin(1), positions
        there, still = self._nodes[node], np.isfinite(total.min(1))
        while still.any():
            yield here, there, still
            here, before = there, node
            node = self._next[each, before]
            still = still & (before >= 0) & (node != DOOR)
            arrived = node < 0  # the last leg is to the goal
            node = np.where(arrived, GOAL, node)
            there = np.where(arrived[:, None], self.goals, self._nodes[node])

    def _search(self, costs: Floats, keys: Mask | None) -> tuple[Floats, NDArray[np.intp]]:
        """Costs of the shortest paths from all nodes `[B, N]`, and the next node on each, or `GOAL` or `DOOR`."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import dijkstra  # takes a tenth of a second to import

        number, _, height, width = costs.shape
        nodes = np.arange(number * height * width).reshape(number, height, width)
        begins, ends, lengths = [], [], []
        for (right, up), cost in zip(DIRECTIONS, np.moveaxis(costs, 1, 0), strict=True):
            rows, columns = slice(max(0, -up), height - max(0, up)), slice(max(0, -right), width - max(0, right))
            there = np.roll(nodes, (-up, -right), axis=(1, 2))[:, rows, columns]
            finite = np.isfinite(cost[:, rows, columns])
            begins.append(nodes[:, rows, columns][finite])
            ends.append(there[finite])
            lengths.append(cost[:, rows, columns][finite])
        distance = np.linalg.norm(self._nodes - self.goals[:, None], axis=-1)  # [B, N]
        sources = np.flatnonzero(distance <= np.maximum(distance.min(1, keepdims=True), self._spacing))
        size = nodes.size
        if self.opened and keys is not None:
            # One more node, as far from each key as the goal is from there once the doors are open.
            known = keys & np.isfinite(self.opened.steps)
            begins.append(nodes[known])
            ends.append(np.full(known.sum(), size))
            lengths.append(self.opened.steps[known])
            sources, size = np.append(sources, size), size + 1
        # Backwards, from the goals: all graphs are one, of B parts.
        edges = np.concatenate(lengths), (np.concatenate(ends), np.concatenate(begins))
        graph = coo_matrix(edges, shape=(size, size)).tocsr()
        steps, following, _ = dijkstra(graph, indices=sources, min_only=True, return_predecessors=True)
        through = following == nodes.size
        following = np.where(following < 0, GOAL, following % (height * width))
        following[through] = DOOR
        shape = number, height * width
        steps, following = steps[: nodes.size], following[: nodes.size]
        return steps.reshape(shape), following.astype(np.intp).reshape(shape)


def _goals(goals: ArrayLike, num_members: int, size: tuple[float, float]) -> Floats:
    """Goals as an array `[B, 2]`.

    Raises:
        ConfigError: see `TimeToGo.imagine`.
    """
    points = _points("goals", goals, size)
    points = np.broadcast_to(points, (num_members, 2)) if points.shape == (2,) else points
    if points.ndim != 2 or points.shape[1:] != (2,) or not len(points) or len(points) % num_members:
        raise ConfigError(
            f"goals has the shape {list(points.shape)}; give one for all, [2], or the same number for each of "
            f"{num_members} members, [B, 2]."
        )
    return points.copy()


def _key_nodes(worlds: Sequence[VisibleLayout], number: int, x: Floats, y: Floats) -> Mask:
    """Nodes in the inner half of a key of the worlds of B vehicles, or else the nearest one in it: `[B, Y, X]`."""
    nodes = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
    inside = np.zeros((len(worlds), len(y), len(x)), bool)
    for own, world in zip(inside, worlds, strict=True):
        for *center, radius in world.keys:
            distance = np.linalg.norm(nodes - center, axis=-1)
            own |= (distance <= max(radius / 2, distance.min())) & (distance < radius)
    return inside.repeat(number // len(worlds), axis=0)


def _points(name: str, given: ArrayLike, size: tuple[float, float]) -> Floats:
    """Points of an arena as an array, `[..., 2]` or of another shape.

    Raises:
        ConfigError: they are no numbers, or one lies outside the arena.
    """
    try:
        points = np.asarray(given, float)
    except (TypeError, ValueError):  # rows of several lengths, or no numbers
        raise ConfigError(
            f"{name} = {format_value(given)} is not allowed; give points, such as [[0.2, 0.2]]."
        ) from None
    if points.shape[-1:] == (2,):
        outside = ~((points >= 0) & (points <= np.array(size) + 1e-9)).all(-1)
        if outside.any():
            point = points.reshape(-1, 2)[outside.ravel()][0]
            raise ConfigError(
                f"{name}: {point.tolist()} is outside the arena {[round(float(side), 6) for side in size]} (u)."
            )
    return points


def _nodes(side: float, spacing: float) -> Floats:
    """Coordinates of nodes inside an arena, at most `spacing` apart and from the borders, u.

    Raises:
        ConfigError: there would be none between the borders.
    """
    parts = math.ceil(side / spacing - 1e-6)
    if parts < 2:
        raise ConfigError(
            f"guide_spacing = {format_value(spacing)} leaves no node between borders {side:g} u apart; make it "
            f"smaller, below {side:g}."
        )
    return np.linspace(0, side, parts + 1)[1:-1]


def _costs(agent: PlanningAgent, number: int, x: Floats, y: Floats, settings: ControlSettings) -> Floats:
    """Costs of the imagined ways from each node to its neighbours, for the worlds of B vehicles: `[B, 8, Y, X]`."""
    offsets = DIRECTIONS * (x[1] - x[0] if len(x) > 1 else 0.0, y[1] - y[0] if len(y) > 1 else 0.0)  # [8, 2], u
    lengths = np.linalg.norm(offsets, axis=1)
    most = [math.ceil(settings.guide_steps * length / settings.guide_spacing - 1e-6) for length in lengths]
    nodes = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)
    thrusts = torch.tensor(DIRECTIONS @ THROTTLES.T > 1e-6, dtype=torch.float32, device=settings.device)
    costs = []
    for some in np.split(nodes, range(NODES_AT_ONCE, len(nodes), NODES_AT_ONCE)):
        start = torch.tensor(np.tile(some, (number, 1)), dtype=torch.float32, device=settings.device)
        candidates = thrusts[:, None].expand(len(start), -1, max(most), -1)
        nothing = torch.zeros_like(start)
        with torch.no_grad():
            path = agent.imagine(Observation(start, nothing, nothing, nothing), candidates)
        moved, std = _array(path.mean - start[:, None, None]), _array(path.log_std.exp().amax(-1))  # [P, 8, H, 2]
        each = [
            _fastest(moved[..., :steps, :], std[..., :steps], offset, settings)
            for offset, steps in zip(offsets, most, strict=True)
        ]
        costs.append(np.stack(each).reshape(len(DIRECTIONS), number, -1))
    return np.moveaxis(np.concatenate(costs, axis=-1), 0, 1).reshape(number, len(DIRECTIONS), len(y), len(x))


def _fastest(moved: Floats, std: Floats, offset: Floats, settings: ControlSettings) -> Floats:
    """Cost of the best of A paths to a neighbour, `[P]`; infinite if none arrives.

    Args:
        moved: `[P, A, H, 2]`, distance from the node after each step, u.
        std: `[P, A, H]`, standard deviations there, u.
        offset: `[2]`, from the node to its neighbour, u.
        settings: those of the map.
    """
    length = float(np.linalg.norm(offset))
    if length == 0:
        return np.full(len(moved), np.inf)
    ahead, beside = (moved @ (axis / length) for axis in (offset, np.array([-offset[1], offset[0]])))
    start = [(0, 0)] * (ahead.ndim - 1) + [(1, 0)]  # a zero before the first step
    last_ahead, last_beside = (np.pad(each, start)[..., :-1] for each in (ahead, beside))
    gain = ahead - last_ahead
    share = np.clip(np.divide(length - last_ahead, gain, out=np.zeros_like(gain), where=gain > 0), 0, 1)
    crosses = (ahead >= length) & (last_ahead < length)
    hits = crosses & (np.abs(last_beside + share * (beside - last_beside)) <= settings.guide_spacing / 2)
    cost = np.arange(moved.shape[2]) + share + settings.guide_uncertainty * std
    result: Floats = np.where(hits, cost, np.inf).min(axis=(1, 2))
    return result


def _array(tensor: Tensor) -> Floats:
    array: Floats = tensor.cpu().numpy()
    return array
