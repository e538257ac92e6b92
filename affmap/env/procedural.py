"""Layouts drawn at random under the rules of Experiment V: number, size and distance of circles.

A draw begins as the paper describes it: numbers and radii uniform between their limits, every circle anywhere. Then
spaced circles that are too near to each other are pushed apart, round after round. Meanwhile all of them shrink in
proportion towards the smallest radius, and those above the smallest number are removed one by one, each at a time of
its own. The first round in which every rule holds ends the draw, so nothing gives way further than it must.

The effect on the distribution: where there is room, as for a few circles in a layout, most numbers are as drawn and
radii reach far up. Where there is not, as for 24 to 40 circles that all keep their gap, a layout has little more than
the smallest number, radii are uniform up to a limit that hardly exceeds the smallest, and places are spread evenly.
Circles that need not keep the gap are never pushed, shrunk or removed: they are as the paper draws them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from affmap.env.layout import MAX_CIRCLES, Arena, Circle, EffectName, Layout, hidden_key, is_rules
from affmap.env.rules import Rules
from affmap.env.walls import Walls
from affmap.random import generator
from affmap.settings import ConfigError, Count, Length, Line, NonNegative, Settings, read
from affmap.settings.messages import format_value

ROUNDS = 300
"""Rounds in which the circles shrink; as many again follow at the smallest radius."""
ATTEMPTS = 10
"""Draws before the settings count as impossible; nearly every first one succeeds if any does."""
SLACK = 0.03
"""Extra distance by which circles are pushed apart, in smallest radii: pushing converges without quite arriving."""

NumCircles = Annotated[Count, Field(le=MAX_CIRCLES)]
"""Number of circles."""


class Property(Settings):
    """A kind of circle."""

    effect: EffectName
    """Its effect on the vehicle."""
    channel: Line
    """Name of the channel of the view that it is painted in."""
    spaced: bool
    """Whether it keeps the gap to all other spaced circles; if not, it may overlap anything."""


class Procedural(Rules):
    """Rules for random layouts (`conf/layout/procedural_*.yaml`); `draw` makes one."""

    count: tuple[NumCircles, NumCircles]
    """Smallest and largest number of circles."""
    count_of: Literal["property", "world"]
    """Whether `count` is the number of each property's circles, or of all, each of a property drawn at random."""
    radius: tuple[Length, Length]
    """Smallest and largest radius, u."""
    gap: NonNegative
    """Smallest distance between spaced circles, and from any circle to the borders, u."""
    corner_side: Length
    """Side of the squares in the arena's corners that no circle reaches into, u."""
    properties: tuple[Property, ...] = Field(min_length=1)
    """Kinds of circles."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_layouts(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "circles" in values and not is_rules(values):
            name = format_value(values.get("name"))
            raise ValueError(f"{name} holds a layout, not rules for random ones: read it with affmap.Layout.")
        return values

    @model_validator(mode="after")
    def _check(self) -> Self:
        for index, kind in enumerate(self.properties):
            if kind.channel not in self.channels:
                raise ValueError(
                    f"properties[{index}].channel = {kind.channel!r} is not one of channels {list(self.channels)}."
                )
        if "door" in self.effects and ("key" not in self.effects or self.count_of != "property"):
            raise ValueError(
                f"properties {self.effects} with count_of = {self.count_of!r} allow worlds with a door and no key; add "
                "a property with the effect 'key', and make count_of = 'property'."
            )
        for key in ("count", "radius"):
            low, high = getattr(self, key)
            if low > high:
                raise ValueError(f"{key} = {[low, high]} is in the wrong order; write the smaller value first.")
        groups = len(self.properties) if self.count_of == "property" else 1
        if groups * self.count[1] > MAX_CIRCLES:
            raise ValueError(
                f"count = {list(self.count)} of each of {groups} properties makes up to {groups * self.count[1]} "
                f"circles; there must be at most {MAX_CIRCLES}."
            )
        if self.corner_side < self.start_margin + self.start_side - 1e-9:  # 0.1 + 0.2 > 0.3
            raise ValueError(
                f"corner_side = {self.corner_side} leaves a part of the start squares unprotected; it must be at least "
                f"start_margin + start_side = {self.start_margin + self.start_side:g}."
            )
        if 2 * self.corner_side > min(self.size):
            raise ValueError(
                f"corner_side = {self.corner_side} does not fit an arena of size {list(self.size)}; "
                f"it must be at most {min(self.size) / 2:g}."
            )
        # No place is farther from all borders and corner squares than the centre.
        to_corner = math.hypot(*(side / 2 - self.corner_side for side in self.size))
        room = min(min(self.size) / 2 - self.gap, to_corner)
        if self.radius[1] > room:
            raise ValueError(
                f"radius = {list(self.radius)} is too large for an arena of size {list(self.size)} with "
                f"gap = {self.gap} and corner_side = {self.corner_side}; the largest circle that fits has radius "
                f"{room:g}."
            )
        return self

    @property
    def _contents(self) -> str:
        (low, high), kinds = self.count, ", ".join(kind.effect for kind in self.properties)
        return f"circles: {low} to {high} {'of each' if self.count_of == 'property' else 'in all'} of {kinds}"

    @property
    def effects(self) -> Sequence[str]:
        """Effects that circles may have."""
        return [kind.effect for kind in self.properties]

    def draw(self, rng: np.random.Generator) -> Layout:
        """Draw a layout that obeys every rule.

        Raises:
            ValueError: none was found, because the circles are too many or too large.
        """
        for _ in range(ATTEMPTS if self._has_area() else 0):  # a vain draw of many circles takes minutes
            circles = self._attempt(rng)
            if circles is not None and not hidden_key(circles):
                return Layout(circles=circles, **{key: getattr(self, key) for key in Arena.model_fields})
        raise ValueError(
            f"layout {self.name!r}: no layout was found, not even with the smallest count and "
            f"radius; make count = {list(self.count)}, radius = {list(self.radius)}, gap = {self.gap} or "
            f"corner_side = {self.corner_side} smaller, or size = {list(self.size)} larger."
        )

    def _has_area(self) -> bool:
        """Whether the fewest and smallest circles, each with half of the gap around it, have less area than the arena.

        If the kinds of circles are drawn at random, it may be that none is spaced.
        """
        spaced = [kind.spaced for kind in self.properties]
        groups = sum(spaced) if self.count_of == "property" else all(spaced)
        return groups * self.count[0] * math.pi * (self.radius[0] + self.gap / 2) ** 2 < math.prod(self.size)

    def _attempt(self, rng: np.random.Generator) -> tuple[Circle, ...] | None:
        """Draw the circles of a layout; None if they do not fit."""
        fewest, most = self.count
        if self.count_of == "property":
            counts = rng.integers(fewest, most, len(self.properties), endpoint=True)
            kinds = np.repeat(np.arange(len(counts)), counts)
            extra = np.concatenate([np.arange(count) for count in counts]) >= fewest
        else:
            kinds = rng.integers(len(self.properties), size=rng.integers(fewest, most, endpoint=True))
            extra = np.arange(len(kinds)) >= fewest
        spaced = np.array([kind.spaced for kind in self.properties])[kinds]
        full = rng.uniform(*self.radius, len(kinds))  # radii before they shrink
        leaves = np.where(spaced & extra, rng.uniform(size=len(kinds)), math.inf)  # progress at which a circle leaves
        positions = self._scatter(full, rng)
        for progress in np.minimum(np.arange(2 * ROUNDS) / ROUNDS, 1.0):
            stays = leaves > progress
            positions, kinds, spaced, full, leaves = (
                array[stays] for array in (positions, kinds, spaced, full, leaves)
            )
            radii = np.where(spaced, full + progress * (self.radius[0] - full), full)
            new_positions = self._push(positions, radii, spaced)
            if new_positions is None:
                return tuple(
                    Circle(center=(float(x), float(y)), radius=float(radius), effect=kind.effect, channel=kind.channel)
                    for (x, y), radius, kind in zip(positions, radii, (self.properties[k] for k in kinds), strict=True)
                )
            positions = new_positions
        return None

    def _scatter(self, radii: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw places for circles of `radii` `[n]` (u), off borders and corner squares: `[n, 2]` in u.

        The first of 100 tries off the corners; if there is none, in an arena of little else, `_push` corrects it.
        """
        low = (self.gap + radii)[:, None]
        places = rng.uniform(low, np.array(self.size) - low, (100, len(radii), 2))
        first = (np.linalg.norm(self._beyond_corner(places), axis=-1) >= radii).argmax(0)
        return places[first, np.arange(len(radii))]

    def _push(self, positions: np.ndarray, radii: np.ndarray, spaced: np.ndarray) -> np.ndarray | None:
        """Push apart circles at `positions` `[n, 2]` that are too near to something: `[n, 2]`; None if none is."""
        slack = SLACK * self.radius[0]
        (x, y), reach = positions.T, np.where(spaced, radii + self.gap / 2, -math.inf)
        distances = np.hypot(x[:, None] - x, y[:, None] - y)
        lacks = reach[:, None] + reach - distances
        np.fill_diagonal(lacks, -math.inf)
        beyond = self._beyond_corner(positions)
        if lacks.max() <= 0 and (np.hypot(*beyond.T) >= radii).all():
            return None  # borders are kept at all times
        # Half of the missing distance, because the other circle moves as well.
        shares = np.maximum(lacks + slack, 0) / 2 / np.maximum(distances, slack)
        apart = shares.sum(1, keepdims=True) * positions - shares @ positions
        beyond = np.maximum(beyond, slack)  # never zero: even from inside a corner square there is a way out
        lengths = np.hypot(*beyond.T)
        out = (np.maximum(radii + slack - lengths, 0) / lengths)[:, None] * beyond
        positions = positions + apart + np.copysign(out, np.array(self.size) / 2 - positions)
        low = (self.gap + radii)[:, None]
        return np.clip(positions, low, np.array(self.size) - low)

    def _beyond_corner(self, positions: np.ndarray) -> np.ndarray:
        """Horizontal and vertical distance of `positions` `[..., 2]` to the nearest corner square, `[..., 2]` in u."""
        to_border = np.minimum(positions, np.array(self.size) - positions)
        return np.maximum(to_border - self.corner_side, 0)


def is_procedural(name: str) -> bool:
    """Whether `conf/layout/<name>.yaml` holds rules rather than a layout.

    Raises:
        ConfigError: there is no such file.
    """
    return is_rules(read("layout", name))


def kind(values: Mapping[str, Any]) -> type[Layout | Procedural | Walls]:
    """The class of the keys and values of a file in `conf/layout`: a layout, or rules for random ones."""
    return Procedural if "properties" in values else Walls if is_rules(values) else Layout


AnyLayout: TypeAlias = Layout | Rules | Mapping[str, Any] | str
"""A layout or rules for layouts; or the keys and values of either; or the name of their file in `conf/layout`."""


def first_layout(layout: AnyLayout, seed: int) -> Layout:
    """A layout, as `load` takes it; of rules, the first layout of member `seed`.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    rules = load(layout)
    return rules.draw(generator(seed, "world", 0)) if isinstance(rules, Rules) else rules


def load(layout: AnyLayout) -> Layout | Rules:
    """A layout or rules for layouts: as they are, from their keys and values, or by their name in `conf/layout`.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    if isinstance(layout, str):
        return kind(read("layout", layout)).load("layout", layout)
    if isinstance(layout, Mapping):
        return kind(layout).checked(layout, "layout")
    if not isinstance(layout, Layout | Rules):
        raise ConfigError(
            f"layout = {format_value(layout)} is not allowed: give the name of a file in conf/layout, or the keys and "
            "values of a layout."
        )
    return layout
