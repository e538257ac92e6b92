"""Layouts with walls that are drawn at random, for ways that are longer than a look ahead.

A wall is a row of overlapping obstacles along straight lines. In a draw, all corners of walls with the same x move to
the side together, and all with the same y up or down together, so that joints stay joints; those on the border stay.
Then the world may be mirrored. A file's walls keep their ways open as long as they move by less than `shift`.
Doors are walls that vanish when a key is visited; keys move as corners do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import chain, pairwise
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from affmap.env.layout import MAX_CIRCLES, Arena, Circle, Layout
from affmap.env.rules import Rules
from affmap.settings import Length, Line, Neutral, NonNegative, Number, Settings, preset

Floats = NDArray[np.floating[Any]]

Corner = tuple[Number, Number]
"""x, y in u."""

Row = Annotated[tuple[Corner, ...], Field(min_length=2)]
"""Corners of a wall, in order, u."""


class Lock(Settings):
    """Doors in gaps of walls, and the keys to them."""

    doors: tuple[Row, ...] = Field(min_length=1)
    """Corners of each row of door circles, which are as large as those of walls, in order, u."""
    keys: tuple[Corner, ...] = Field(min_length=1)
    """Centre of each key, u; a visit to one of them opens all doors."""
    key_radius: Length
    """Radius of keys, u."""
    door_channel: Line
    """Name of the channel of the view that doors are painted in."""
    key_channel: Line
    """Name of the channel of the view that keys are painted in."""


class Walls(Rules):
    """Rules for random worlds of walls (`conf/layout/trap.yaml` and others); `draw` makes one."""

    walls: tuple[Row, ...] = Field(min_length=1)
    """Corners of each wall, in order, u."""
    radius: Length
    """Radius of its circles, half of its thickness, u."""
    shift: NonNegative
    """Largest distance by which corners move along either axis, u."""
    channel: Line
    """Name of the channel of the view that walls are painted in."""
    lock: Annotated[Lock | None, Neutral(None)] = preset()
    """Doors and keys; None for none."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        own = {"door_channel": self.lock.door_channel, "key_channel": self.lock.key_channel} if self.lock else {}
        for key, channel in {"channel": self.channel, **own}.items():
            if channel not in self.channels:
                raise ValueError(f"{key} = {channel!r} is not one of channels {list(self.channels)}.")
        for number, (x, y) in enumerate(self._corners):
            name = "walls" if number < len([*chain(*self.walls)]) else "lock"
            for value, side in ((x, self.size[0]), (y, self.size[1])):
                if value not in (0, side) and not self.shift <= value <= side - self.shift:
                    raise ValueError(
                        f"{name} has the corner {[x, y]} (number {number}), which leaves the arena of size "
                        f"{list(self.size)} when it moves by shift = {self.shift}; put it on a border, or further "
                        "inside."
                    )
        # Ends and keys move by shift along both axes, perhaps towards each other.
        room = self.radius + 2 * math.sqrt(2) * self.shift
        for number, place in enumerate(self.lock.keys if self.lock else ()):
            gap = min(_gap(place, *line) for row in self._rows for line in pairwise(row))
            if gap < room:
                raise ValueError(
                    f"lock.keys[{number}] = {list(place)} is {gap:.3g} u from the middle of a wall or door and may be "
                    f"drawn inside; put it at least {room:.3g} u away (radius = {self.radius}, shift = {self.shift})."
                )
        length = sum(math.dist(*line) + 4 * self.shift for row in self._rows for line in pairwise(row))
        if length / self.radius > MAX_CIRCLES / 2:
            raise ValueError(
                f"radius = {self.radius} is too small for walls of {length:.3g} u in all; there must be at most "
                f"{MAX_CIRCLES} circles."
            )
        return self

    @property
    def _contents(self) -> str:
        doors = f", doors: {len(self.lock.doors)}, keys: {len(self.lock.keys)}" if self.lock else ""
        return f"walls: {len(self.walls)}, {2 * self.radius:g} u thick{doors}"

    @property
    def _rows(self) -> tuple[Row, ...]:
        """Corners of walls and doors."""
        return self.walls + (self.lock.doors if self.lock else ())

    @property
    def _corners(self) -> Sequence[Corner]:
        """All points that a draw moves."""
        return [*chain(*self._rows), *(self.lock.keys if self.lock else ())]

    @property
    def effects(self) -> Sequence[str]:
        """Effects that circles may have."""
        return ["obstacle", "door", "key"] if self.lock else ["obstacle"]

    def draw(self, rng: np.random.Generator) -> Layout:
        """Draw a layout."""
        moves = [self._moves(axis, rng) for axis in (0, 1)]
        mirrored = rng.random(2) < 0.5
        placed = partial(self._placed, moves, mirrored)
        places: dict[Corner, None] = {}  # in order; walls may share corners
        for wall in self.walls:
            places |= dict.fromkeys(self._row(placed(wall)))
        circles = [
            Circle(center=place, radius=self.radius, effect="obstacle", channel=self.channel) for place in places
        ]
        if lock := self.lock:
            ends = set(places)  # doors begin and end in walls, which stay
            circles += [
                Circle(center=place, radius=self.radius, effect="door", channel=lock.door_channel)
                for door in lock.doors
                for place in self._row(placed(door))
                if place not in ends
            ]
            circles += [
                Circle(center=(float(x), float(y)), radius=lock.key_radius, effect="key", channel=lock.key_channel)
                for x, y in placed(lock.keys)
            ]
        return Layout(circles=tuple(circles), **{key: getattr(self, key) for key in Arena.model_fields})

    def _placed(self, moves: Sequence[dict[float, float]], mirrored: np.ndarray, corners: Sequence[Corner]) -> Floats:
        """Corners of the file where they are drawn, `[N, 2]` in u."""
        points = np.array([[move[value] for move, value in zip(moves, corner, strict=True)] for corner in corners])
        return np.where(mirrored, np.array(self.size) - points, points)

    def _row(self, points: Floats) -> list[Corner]:
        """Centres of circles along the lines through some points `[N, 2]`."""
        row: list[Corner] = []
        for begin, end in pairwise(points):
            number = max(1, math.ceil(math.dist(begin, end) / self.radius))
            row += [(float(x), float(y)) for x, y in np.linspace(begin, end, number + 1)]
        return row

    def _moves(self, axis: int, rng: np.random.Generator) -> dict[float, float]:
        """Coordinate of corners along an axis -> where it is drawn, u."""
        values = sorted({corner[axis] for corner in self._corners})
        drawn = [value + rng.uniform(-self.shift, self.shift) for value in values]
        borders = 0, self.size[axis]
        return {value: value if value in borders else new for value, new in zip(values, drawn, strict=True)}


def _gap(point: Corner, begin: Corner, end: Corner) -> float:
    """Distance of a point to the line between two others, u."""
    start, along = np.array(begin), np.subtract(end, begin)
    share = np.clip((point - start) @ along / max(along @ along, 1e-12), 0, 1)
    return math.dist(point, start + share * along)
