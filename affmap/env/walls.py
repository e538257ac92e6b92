"""Layouts with walls that are drawn at random, for ways that are longer than a look ahead.

A wall is a row of overlapping obstacles along straight lines. In a draw, all corners of walls with the same x move to
the side together, and all with the same y up or down together, so that joints stay joints; those on the border stay.
Then the world may be mirrored. A file's walls keep their ways open as long as they move by less than `shift`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from affmap.env.layout import MAX_CIRCLES, Arena, Circle, Layout
from affmap.env.rules import Rules
from affmap.settings import Length, Line, NonNegative, Number

Corner = tuple[Number, Number]
"""x, y in u."""


class Walls(Rules):
    """Rules for random worlds of walls (`conf/layout/trap.yaml` and others); `draw` makes one."""

    walls: tuple[Annotated[tuple[Corner, ...], Field(min_length=2)], ...] = Field(min_length=1)
    """Corners of each wall, in order, u."""
    radius: Length
    """Radius of its circles, half of its thickness, u."""
    shift: NonNegative
    """Largest distance by which corners move along either axis, u."""
    channel: Line
    """Name of the channel of the view that walls are painted in."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.channel not in self.channels:
            raise ValueError(f"channel = {self.channel!r} is not one of channels {list(self.channels)}.")
        for index, (x, y) in enumerate(corner for wall in self.walls for corner in wall):
            for value, side in ((x, self.size[0]), (y, self.size[1])):
                if value not in (0, side) and not self.shift <= value <= side - self.shift:
                    raise ValueError(
                        f"walls has the corner {[x, y]} (number {index}), which leaves the arena of size "
                        f"{list(self.size)} when it moves by shift = {self.shift}; put it on a border, or further "
                        "inside."
                    )
        length = sum(math.dist(*line) + 4 * self.shift for wall in self.walls for line in pairwise(wall))
        if length / self.radius > MAX_CIRCLES / 2:
            raise ValueError(
                f"radius = {self.radius} is too small for walls of {length:.3g} u in all; there must be at most "
                f"{MAX_CIRCLES} circles."
            )
        return self

    @property
    def _contents(self) -> str:
        return f"walls: {len(self.walls)}, {2 * self.radius:g} u thick"

    @property
    def effects(self) -> Sequence[str]:
        """Effects that circles may have."""
        return ["obstacle"]

    def draw(self, rng: np.random.Generator) -> Layout:
        """Draw a layout."""
        moves = [self._moves(axis, rng) for axis in (0, 1)]
        mirrored = rng.random(2) < 0.5
        places: dict[tuple[float, float], None] = {}  # in order; walls may share corners
        for wall in self.walls:
            points = np.array([[move[value] for move, value in zip(moves, corner, strict=True)] for corner in wall])
            points = np.where(mirrored, np.array(self.size) - points, points)
            for begin, end in pairwise(points):
                number = max(1, math.ceil(math.dist(begin, end) / self.radius))
                places |= dict.fromkeys((float(x), float(y)) for x, y in np.linspace(begin, end, number + 1))
        circles = tuple(
            Circle(center=place, radius=self.radius, effect="obstacle", channel=self.channel) for place in places
        )
        return Layout(circles=circles, **{key: getattr(self, key) for key in Arena.model_fields})

    def _moves(self, axis: int, rng: np.random.Generator) -> dict[float, float]:
        """Coordinate of corners along an axis -> where it is drawn, u."""
        values = sorted({corner[axis] for wall in self.walls for corner in wall})
        drawn = [value + rng.uniform(-self.shift, self.shift) for value in values]
        borders = 0, self.size[axis]
        return {value: value if value in borders else new for value, new in zip(values, drawn, strict=True)}
