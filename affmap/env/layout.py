"""Layouts: positions, effects and looks of the circles in an arena.

The effect of a circle and its look (its channel of the view) are separate. A layout knows nothing of physics;
`conf/layout` holds the fixed ones.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from affmap.env.effects import SOLID, check_effect
from affmap.lazy import notebook
from affmap.settings import ConfigError, Length, Line, Name, Neutral, NonNegative, Number, Settings, preset
from affmap.settings.messages import format_value
from affmap.view import VisibleLayout, view

EffectName = Annotated[str, AfterValidator(check_effect)]
"""A key of `affmap.env.effects.EFFECTS`."""

Acts = Literal["center", "rim"]
"""Whether fog and force fields act on a vehicle whose centre is inside, or on every one that overlaps them."""


class Circle(Settings):
    """A circle of a layout."""

    center: tuple[Number, Number]
    """x, y in u."""
    radius: Length
    """Radius, u."""
    effect: EffectName
    """Its effect on the vehicle: blocks it (for good, or until a key is visited), adds noise to its reported position,
    pulls it, or nothing."""
    channel: Line
    """Name of the channel of the view that it is painted in."""
    painted: Annotated[Annotated[NonNegative, Field(le=1000)] | None, Neutral(None)] = preset()
    """Radius that it is painted with, u, if views should show another than its own; 0 for not at all."""

    @property
    def x(self) -> float:
        """X of the center, u."""
        return self.center[0]

    @property
    def y(self) -> float:
        """Y of the center, u."""
        return self.center[1]


def is_rules(values: Mapping[str, Any]) -> bool:
    """Whether the keys and values of a file in `conf/layout` are rules for random layouts rather than a layout."""
    return "properties" in values or "walls" in values


MAX_CIRCLES = 1000
"""Most circles of a layout: a draw compares each with each, hundreds of times, and Box2D crashes beyond 10,000."""


class Arena(Settings):
    """The arena of a layout: borders, the squares in the corners where runs start and end, and channels of the view.

    Corners are numbered 0 lower left, 1 lower right, 2 upper left, 3 upper right; `3 - corner` is the opposite one.
    """

    name: Name
    """That of its file in `conf/layout`, if it has one."""
    size: tuple[Length, Length]
    """Width and height of the arena, u."""
    channels: tuple[Line, ...] = Field(min_length=1)
    """Names of the channels of the view, in order."""
    border_channel: Line
    """Channel that everything outside the arena is painted in."""
    start_margin: Length
    """Distance of the corner squares to the borders, u."""
    start_side: Length
    """Side of the corner squares, u."""
    acts: Annotated[Acts, Neutral("rim")] = preset()
    """When fog and force fields act; obstacles act by touch."""
    views_in_fog: Annotated[bool, Neutral(True)] = preset()
    """Whether the vehicle sees anything while its centre is in fog; otherwise its view is empty there."""

    @model_validator(mode="after")
    def _check_arena(self) -> Self:
        if len(set(self.channels)) < len(self.channels):
            raise ValueError(f"channels = {list(self.channels)} names a channel twice; give each its own name.")
        if self.border_channel not in self.channels:
            raise ValueError(f"border_channel = {self.border_channel!r} is not one of channels {list(self.channels)}.")
        if 2 * (self.start_margin + self.start_side) > min(self.size):
            raise ValueError(
                f"start_side = {self.start_side} with start_margin = {self.start_margin} does not fit an arena of size "
                f"{list(self.size)}; their sum must be at most {min(self.size) / 2}."
            )
        return self

    @classmethod
    def load(cls, group: str, name: str = "", /, **changes: Any) -> Self:
        """Read `conf/<group>/<name>.yaml`, see `Settings.load`.

        Raises:
            ConfigError: the file has another name than the layout in it, for which reports would mistake it.
        """
        loaded = super().load(group, name, **changes)
        if "name" not in changes and loaded.name != name:
            raise ConfigError(f"conf/{group}/{name}.yaml: name = {loaded.name!r} must be that of the file, {name!r}.")
        return loaded

    def __repr__(self) -> str:
        width, height = self.size
        return f"{type(self).__name__}({self.name!r}, {width:g} x {height:g} u, {self._contents})"

    @property
    @abstractmethod
    def _contents(self) -> str:
        """A short description of the circles."""

    @property
    @abstractmethod
    def effects(self) -> Sequence[str]:
        """Effects that circles have, or may have."""

    @property
    def shortest_way(self) -> float:
        """Smallest distance between a start and a goal, in the squares of opposite corners, u."""
        return math.hypot(*(side - 2 * (self.start_margin + self.start_side) for side in self.size))


def hidden_key(circles: Sequence[Circle]) -> tuple[int, int] | None:
    """Indices of a key that lies wholly inside something solid, and of that; None if there is none."""
    keys = [index for index, circle in enumerate(circles) if circle.effect == "key"]
    solids = [index for index, circle in enumerate(circles) if circle.effect in SOLID]
    for key, solid in product(keys, solids):
        inner, outer = circles[key], circles[solid]
        if math.dist(inner.center, outer.center) + inner.radius <= outer.radius:
            return key, solid
    return None


class Layout(Arena):
    """A layout: an arena and its circles. `Layout.load("layout", "fog")` reads that of `conf/layout/fog.yaml`."""

    circles: tuple[Circle, ...] = Field(max_length=MAX_CIRCLES)
    """Obstacles, doors and keys, force fields, fog, and circles without an effect; they may overlap."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_rules(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and is_rules(values) and "circles" not in values:
            raise ValueError(
                f"{format_value(values.get('name'))} holds rules for random layouts, not a layout: read it with "
                f"{'affmap.Procedural' if 'properties' in values else 'affmap.env.Walls'}, whose method draw makes "
                "layouts; affmap.fly and affmap.train take it by its name."
            )
        return values

    @model_validator(mode="after")
    def _check(self) -> Self:
        for index, circle in enumerate(self.circles):
            (x, y), (width, height) = circle.center, self.size
            if not (0 <= x <= width and 0 <= y <= height):
                raise ValueError(
                    f"circles[{index}].center = {[x, y]} is outside the arena of size {[width, height]}; "
                    f"x must be in [0, {width}] and y in [0, {height}]."
                )
            if circle.channel not in self.channels:
                raise ValueError(
                    f"circles[{index}].channel = {circle.channel!r} is not one of channels {list(self.channels)}."
                )
        if "door" in self.effects and "key" not in self.effects:  # an opened layout has keys and no doors
            number = [circle.effect for circle in self.circles].index("door")
            raise ValueError(
                f"circles[{number}] is a door, and there is no key; add a circle with the effect 'key', or give doors "
                "that never open the effect 'obstacle'."
            )
        if hidden := hidden_key(self.circles):
            key, solid = hidden
            raise ValueError(
                f"circles[{key}] is a key inside circles[{solid}], where no vehicle can visit it; move it out."
            )
        return self

    @property
    def _contents(self) -> str:
        effects = Counter(circle.effect for circle in self.circles)
        return f"circles: {', '.join(f'{effect} ({number})' for effect, number in effects.items()) or 'none'}"

    @property
    def effects(self) -> Sequence[str]:
        """Effects of the circles, once each."""
        return list(dict.fromkeys(circle.effect for circle in self.circles))

    @cached_property
    def map(self) -> VisibleLayout:
        """The visible part of this layout."""
        painted = [(each, each.radius if each.painted is None else each.painted) for each in self.circles]
        circles = tuple((*each.center, radius, self.channels.index(each.channel)) for each, radius in painted if radius)
        own = self.size, len(self.channels), self.channels.index(self.border_channel), circles
        hidden = () if self.views_in_fog else self._places_of("fog")
        if self._without_doors is None:
            return VisibleLayout(*own, hidden=hidden)
        return VisibleLayout(*own, self._places_of("key"), self._without_doors.map, hidden)

    def _places_of(self, effect: str) -> tuple[tuple[float, float, float], ...]:
        """Centre x, centre y and radius (u) of each circle of an effect."""
        return tuple((*circle.center, circle.radius) for circle in self.circles if circle.effect == effect)

    @property
    def opened(self) -> Layout:
        """The same layout without its doors: once the vehicle's centre has been inside a key. Itself if it has none."""
        return self._without_doors or self

    @cached_property
    def _without_doors(self) -> Layout | None:
        """The layout without its doors; None if it has none (equality of layouts would follow one to itself)."""
        circles = tuple(circle for circle in self.circles if circle.effect != "door")
        return None if len(circles) == len(self.circles) else self.model_copy(update={"circles": circles})

    def views(self, path: np.ndarray) -> np.ndarray:
        """Views at the positions `[T, 2]` (u) of a flight since its start, `[T, K, 11, 11]` bool: doors open on it."""
        pictures: np.ndarray = view(self.map, path)
        is_open = self.are_open(path)
        if is_open.any():
            pictures[is_open] = view(self.opened.map, path[is_open])
        return pictures

    def are_open(self, path: np.ndarray) -> np.ndarray:
        """Whether doors, if any, are open at each position `[..., T, 2]` (u) since a flight began: `[..., T]`."""
        return np.logical_or.accumulate(self.map.at_key(path), axis=-1)

    def _repr_html_(self) -> str:
        return notebook.layout(self)

    def corner(self, corner: int) -> np.ndarray:
        """Lower left and upper right point of a corner's square, `[2, 2]` in u."""
        low = np.array([self.start_margin, self.start_margin])
        if corner % 2:
            low[0] = self.size[0] - self.start_margin - self.start_side
        if corner // 2:
            low[1] = self.size[1] - self.start_margin - self.start_side
        return np.stack([low, low + self.start_side])

    def reach(self, circle: Circle, radius: float) -> float:
        """Distance between its rim and the centre of a vehicle of `radius` below which a circle acts, u."""
        return radius if circle.effect in SOLID or self.acts == "rim" else 0.0

    def is_free(self, positions: np.ndarray, radius: float) -> np.ndarray:
        """Whether a disc of `radius` (u) around each of `positions` `[..., 2]` meets nothing solid: `[...]`."""
        inside = (positions >= radius) & (positions <= np.array(self.size) - radius)
        free = np.asarray(inside.all(-1))
        for circle in self.obstacles:
            free &= np.linalg.norm(positions - np.array(circle.center), axis=-1) >= circle.radius + radius
        return free

    def in_fog(self, positions: np.ndarray, radius: float) -> np.ndarray:
        """Whether a vehicle of `radius` (u) at each of `positions` `[..., 2]` is in fog: `[...]`."""
        inside = np.zeros(positions.shape[:-1], bool)
        for circle in self.circles:
            if circle.effect == "fog":
                reach = circle.radius + self.reach(circle, radius)
                inside |= np.linalg.norm(positions - np.array(circle.center), axis=-1) < reach
        return inside

    def check_corners(self, radius: float) -> None:
        """Make sure that a vehicle of `radius` (u) can stand anywhere in the corner squares.

        Raises:
            ConfigError: an obstacle or a border reaches into one of them.
        """
        if self.start_margin < radius:
            raise ConfigError(
                f"layout {self.name!r}: start_margin = {self.start_margin} is too small for a vehicle of radius "
                f"{radius}; make it at least that."
            )
        for corner, index, gap in self._corner_gaps:
            if gap < radius:
                (low, high), circle = self.corner(corner), self.circles[index]
                raise ConfigError(
                    f"layout {self.name!r}: circles[{index}] (center {list(circle.center)}, radius {circle.radius}) "
                    f"blocks the start corner x {low[0]:g} to {high[0]:g}, y {low[1]:g} to {high[1]:g} "
                    f"(start_margin = {self.start_margin}, start_side = {self.start_side}, size = {list(self.size)}): "
                    f"an obstacle must stay at least {radius} away from it."
                )

    @cached_property
    def _corner_gaps(self) -> list[tuple[int, int, float]]:
        """Corner, index of an obstacle, and distance between the corner's square and that obstacle (u), for all."""
        obstacles = [(index, circle) for index, circle in enumerate(self.circles) if circle.effect in SOLID]
        gaps = []
        for corner, (index, circle) in product(range(4), obstacles):
            nearest = np.clip(circle.center, *self.corner(corner))
            gaps.append((corner, index, float(np.linalg.norm(circle.center - nearest)) - circle.radius))
        return gaps

    @property
    def obstacles(self) -> Sequence[Circle]:
        """The circles that block the way, doors among them."""
        return [circle for circle in self.circles if circle.effect in SOLID]
