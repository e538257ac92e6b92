"""A twin of `Physics` for many vehicles at once, without Box2D: the imagination of oracles.

The vehicle itself flies in Box2D; a test bounds the deviation of its twin (`tests/env/test_twin.py`).
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from affmap.compiled.physics import Body, Worlds, find_fog, fly
from affmap.env.body import THROTTLES, Vehicle
from affmap.env.effects import check_compiled, pulls
from affmap.env.layout import Layout
from affmap.env.physics import TOUCH


class Twin:
    """The physics of vehicles in one or several layouts."""

    def __init__(self, layouts: Sequence[Layout], vehicle: Vehicle, as_seen: bool = False) -> None:
        """Take W layouts, and the vehicle that flies in each of them.

        Args:
            layouts: W of them.
            vehicle: its physical constants.
            as_seen: whether overlapping fields of one look and effect pull as one, since a view shows no more of them.

        Raises:
            ConfigError: a circle has an effect that is a force in Python.
        """
        check_compiled(circle.effect for layout in layouts for circle in layout.circles)
        own = {key: getattr(vehicle, key) for key in Body._fields if key in Vehicle.model_fields}
        self._body = Body(time_step=vehicle.time_step_s, throttles=THROTTLES, **own)
        self._worlds = Worlds(
            _padded([_solids(layout, vehicle) for layout in layouts]),
            _padded([_fields(layout, vehicle, as_seen) for layout in layouts]),
        )
        self._fog = _padded([_terrains(layout, vehicle, {"fog": ()}) for layout in layouts])

    def __len__(self) -> int:
        """W, the number of layouts."""
        return len(self._worlds.solids)

    def fly(self, world: np.ndarray, position: np.ndarray, velocity: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Let P vehicles fly for H steps.

        Args:
            world: `[P]`, the index of each vehicle's layout.
            position: `[P, 2]`, u.
            velocity: `[P, 2]`, u/step.
            actions: `[P, H, 4]`.

        Returns:
            Positions after each step, `[P, H, 2]` in u.

        Raises:
            IndexError: there is no such layout.
        """
        self._check(world)
        paths = np.empty((*actions.shape[:2], 2))
        start = position.astype(float), velocity.astype(float)
        fly(self._body, self._worlds, world, *start, np.ascontiguousarray(actions), paths)
        return paths

    def in_fog(self, world: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Whether vehicles at `position` `[P, 2]` (u) are in fog, `[P]`; `world` as in `fly`.

        Raises:
            IndexError: there is no such layout.
        """
        self._check(world)
        result = np.empty(len(position), bool)
        find_fog(self._fog, world, position.astype(float), result)
        return result

    def _check(self, world: np.ndarray) -> None:
        """Check indices, because compiled loops would read beyond the last layout."""
        if len(world) and not 0 <= world.min() <= world.max() < len(self):
            raise IndexError(f"world has numbers from {world.min()} to {world.max()}; there are {len(self)} worlds.")


def _solids(layout: Layout, vehicle: Vehicle) -> np.ndarray:
    (width, height), radius = layout.size, vehicle.radius
    borders = [(0, 0, 1, 0, radius), (width, 0, 1, 0, radius), (0, 0, 0, 1, radius), (0, height, 0, 1, radius)]
    circles = [(*circle.center, 1, 1, circle.radius + radius) for circle in layout.obstacles]
    return np.array([*borders, *circles], float)


def _fields(layout: Layout, vehicle: Vehicle, as_seen: bool) -> np.ndarray:
    """Terrains that pull, and a number for each; as seen, one for all of a look and an effect."""
    rows = _terrains(layout, vehicle, pulls())
    looks = [(circle.effect, circle.channel) for circle in layout.circles if circle.effect in pulls()]
    numbers = [looks.index(look) for look in looks] if as_seen else range(len(rows))
    return np.column_stack([rows, np.array(numbers, float)])


def _terrains(layout: Layout, vehicle: Vehicle, effects: Mapping[str, tuple[float, ...]]) -> np.ndarray:
    """Centre, limit and values of the effect of each circle with one of some effects."""
    rows = [
        (*circle.center, circle.radius + layout.reach(circle, vehicle.radius) + TOUCH, *effects[circle.effect])
        for circle in layout.circles
        if circle.effect in effects
    ]
    width = 3 + len(next(iter(effects.values())))
    return np.array(rows, float).reshape(len(rows), width)


def _padded(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Stack tables of different lengths; they are padded with rows of -inf, limits that nothing is below."""
    rows = max(map(len, parts))
    return np.stack([np.vstack([part, np.full((rows - len(part), part.shape[1]), -math.inf)]) for part in parts])
