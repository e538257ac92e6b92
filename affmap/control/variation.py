"""Factors of variation: one property of the task at a time is set to another value than at home, where agents learned.

A factor is an entry of `FACTORS`: its name and unit for readers, its value at home, and a function that sets it. The
agent is not told: it keeps its model, and all that it knows of the vehicle. Oracles are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator

from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.effects import pulls
from affmap.env.layout import Circle, Layout
from affmap.random import generator
from affmap.settings import ConfigError, Number, Settings
from affmap.settings.messages import format_value

HOME = "home"
"""The value of the key `variation` where nothing is varied."""

GAP = 0.15
"""u; obstacles that are moved or added keep it to others, to borders and to corner squares, as in easy worlds of
Experiment V. The vehicle, 0.12 u wide, fits through."""

TRIES, DRAWS = 1000, 100
"""Places that are tried for an obstacle, and draws of all of them: the first ones may leave the last one no room."""


class Task(NamedTuple):
    """Everything about a flight but the agent."""

    layout: Layout
    vehicle: Vehicle
    settings: ControlSettings


@dataclass(frozen=True)
class Factor:
    """A factor of variation.

    Attributes:
        label: its name for readers.
        unit: of its values; empty for numbers and ratios.
        home: its value in a task that is not varied.
        vary: function of a task, a value and a generator that returns the task with this value.
        is_random: whether it draws, so that each run has a world of its own.
    """

    label: str
    unit: str
    home: Callable[[Task], float]
    vary: Callable[[Task, float, np.random.Generator], Task]
    is_random: bool = False


def _number(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Remove obstacles drawn at random, or add some of the same size at random places."""
    obstacles = list(task.layout.obstacles)
    if not value.is_integer() or value < 0:
        raise ConfigError(f"{value:g} is no number of obstacles; give a whole one, 0 or more.")
    if not obstacles:
        raise ConfigError(f"layout {task.layout.name!r} has no obstacle that others could be like; choose another.")
    kept = sorted(rng.permutation(len(obstacles))[: int(value)])

    def draw() -> list[Circle]:
        chosen = [obstacles[index] for index in kept]
        for _ in range(int(value) - len(chosen)):
            like = obstacles[rng.integers(len(obstacles))]
            places = rng.uniform((0, 0), task.layout.size, (TRIES, 2))
            chosen.append(_first_that_fits(task.layout, like, places, chosen))
        return chosen

    return _with_obstacles(task, _drawn(draw))


def _place(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Move each obstacle by a distance (u) in a direction of its own, one after the other."""
    if value < 0:
        raise ConfigError(f"{value:g} is no distance; give a number from 0 up.")

    def draw() -> list[Circle]:
        obstacles = list(task.layout.obstacles)
        for index in rng.permutation(len(obstacles)):
            angles = rng.uniform(0, 2 * math.pi, TRIES)
            places = obstacles[index].center + value * np.column_stack([np.cos(angles), np.sin(angles)])
            others = obstacles[:index] + obstacles[index + 1 :]
            obstacles[index] = _first_that_fits(task.layout, obstacles[index], places, others)
        return obstacles

    return _with_obstacles(task, _drawn(draw))


def _radius(task: Task, value: float, rng: np.random.Generator) -> Task:
    return _with_obstacles(task, [_changed(circle, radius=value) for circle in task.layout.obstacles])


def _look(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Paint obstacles larger or smaller than they are (u)."""
    return _with_obstacles(task, [_changed(circle, painted=value) for circle in task.layout.obstacles])


def _size(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Scale the arena and the places of circles, and not the circles themselves."""
    width, height = task.layout.size
    circles = [_changed(circle, center=(value * circle.x, value * circle.y)) for circle in task.layout.circles]
    update = {"size": (value * width, value * height), "circles": tuple(circles)}
    return task._replace(layout=task.layout.model_copy(update=update))


def _field(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Let force fields pull with another force (N); where there is none, one pulls up everywhere, in no view."""
    layout, reach = task.layout, math.hypot(*task.layout.size)
    if not _has_fields(task):
        field = Circle(center=(0.0, 0.0), radius=reach, effect="force_up", channel=layout.border_channel, painted=0.0)
        task = task._replace(layout=layout.model_copy(update={"circles": (*layout.circles, field)}))
    return _with_vehicle(task, "force", value)


def _has_fields(task: Task) -> bool:
    return not pulls().keys().isdisjoint(task.layout.effects)


def _goal(task: Task, value: float, rng: np.random.Generator) -> Task:
    settings = task.settings.model_copy(update={"goal_distance": value})
    if settings.goal_radius >= value:
        raise ConfigError(
            f"it puts goals {value:g} u away, and control.goal_radius = {settings.goal_radius} would count runs as "
            "successes where they start; make it smaller."
        )
    return task._replace(settings=settings)


def _step(task: Task, value: float, rng: np.random.Generator) -> Task:
    """Change the duration of a step (ms), in runs that last as long as before."""
    steps = round(task.settings.num_steps * _milliseconds(task) / value) if value > 0 else 0
    varied = task._replace(settings=task.settings.model_copy(update={"num_steps": steps}))
    return _with_vehicle(varied, "time_step_s", value / 1000)


def _milliseconds(task: Task) -> float:
    """Duration of a step, ms."""
    return 1000 * task.vehicle.time_step_s


def _with_vehicle(task: Task, key: str, value: float) -> Task:
    """The task with another value of a key of the vehicle."""
    return task._replace(vehicle=task.vehicle.model_copy(update={key: value}))


def _of_vehicle(key: str, label: str, unit: str) -> Factor:
    """The factor of a key of the vehicle."""
    return Factor(
        label,
        unit,
        lambda task: float(getattr(task.vehicle, key)),
        lambda task, value, rng: _with_vehicle(task, key, value),
    )


def _radius_of_all(task: Task) -> float:
    """The radius that all obstacles have, u; NaN if theirs differ or there is none."""
    return _common([circle.radius for circle in task.layout.obstacles])


def _painted_of_all(task: Task) -> float:
    """The radius that all obstacles are painted with, u; NaN likewise."""
    obstacles = task.layout.obstacles
    return _common([circle.radius if circle.painted is None else circle.painted for circle in obstacles])


def _common(values: Sequence[float]) -> float:
    return values[0] if len({*values}) == 1 else math.nan


def _from_corner_to_corner(task: Task) -> float:
    """Distance between the centres of the squares where runs start and end, u."""
    inset = 2 * task.layout.start_margin + task.layout.start_side
    return math.hypot(*(side - inset for side in task.layout.size))


FACTORS = {
    "number": Factor("number of obstacles", "", lambda task: len(task.layout.obstacles), _number, is_random=True),
    "radius": Factor("radius of obstacles", "u", _radius_of_all, _radius),
    "place": Factor("obstacles moved by", "u", lambda task: 0.0, _place, is_random=True),
    "look": Factor("painted radius", "u", _painted_of_all, _look),
    "mass": _of_vehicle("mass", "mass", "kg"),
    "thrust": _of_vehicle("thrust", "thrust", "N"),
    "damping": _of_vehicle("damping", "damping", "1/s"),
    "contact": _of_vehicle("contact_damping", "contact damping", "1/s"),
    "field": Factor("force field", "N", lambda task: task.vehicle.force if _has_fields(task) else 0.0, _field),
    "noise": _of_vehicle("sensor_std", "noise of the position", "u"),
    "size": Factor("size of the arena", "times", lambda task: 1.0, _size),
    "goal": Factor("distance of the goal", "u", _from_corner_to_corner, _goal),
    "step": Factor("time step", "ms", _milliseconds, _step),
}
"""Name in configurations -> factor."""


def _check_factor(name: str) -> str:
    if name not in FACTORS:
        raise ValueError(f"should be one of {', '.join(FACTORS)}")
    return name


class Variation(Settings):
    """A factor of variation and its value, in configurations as a text: `mass/0.2`."""

    factor: Annotated[str, AfterValidator(_check_factor)]
    """A key of `FACTORS`."""
    value: Number
    """Its value, in the factor's unit."""

    def __str__(self) -> str:
        return f"{self.factor}/{self.value:.12g}"

    @property
    def is_random(self) -> bool:
        """Whether each run has a world of its own."""
        return FACTORS[self.factor].is_random

    def vary(self, task: Task, rng: np.random.Generator) -> Task:
        """The task with this value; itself, if that is the value at home.

        Raises:
            ConfigError: the task cannot have this value.
        """
        factor = FACTORS[self.factor]
        if self.value == factor.home(task):
            return task
        try:
            varied = factor.vary(task, self.value, rng)
            varied.layout.check_corners(varied.vehicle.radius)
        except ConfigError as error:
            raise ConfigError(f"variation = '{self}' cannot be flown: {error}") from None
        return varied

    @classmethod
    def read(cls, given: Any) -> Any:
        """The keys and values of a text such as `mass/0.2`, or None for `home`; anything else is left as it is.

        Raises:
            ValueError: the text is neither.
        """
        if not isinstance(given, str) or given == HOME:
            return None if given == HOME else given
        factor, slash, value = given.partition("/")
        try:
            return {"factor": _check_factor(factor), "value": float(value if slash else "none")}
        except ValueError:
            raise ValueError(
                f"should be {HOME}, or a factor and its value, such as mass/0.2; factors are {', '.join(FACTORS)}"
            ) from None


AnyVariation = Variation | Mapping[str, Any] | str
"""A variation, its keys and values, or its text, such as `mass/0.2`."""


def load(given: AnyVariation | None) -> Variation | None:
    """A variation from its text, or from its keys and values; None for `home` and for None.

    Raises:
        ConfigError: there is no such factor, or its value is no number.
    """
    if given is None or isinstance(given, Variation):
        return given
    if not isinstance(given, str | Mapping):
        raise ConfigError(
            f"variation = {format_value(given)} is not allowed; give a factor and its value, such as 'mass/0.2'."
        )
    try:
        values = Variation.read(given)
    except ValueError as error:
        raise ConfigError(f"variation = {format_value(given)} is not allowed: it {error}.") from None
    return None if values is None else Variation.checked(values, "variation")


def make_tasks(
    variation: Variation | None,
    layouts: Sequence[Layout],
    vehicle: Vehicle,
    settings: ControlSettings,
    streams: Sequence[tuple[int, ...]],
) -> list[Task]:
    """The one task of B runs, or a task for each: where they have layouts of their own, or a factor draws some.

    Tasks differ in their layouts only.

    Args:
        variation: of all tasks, or None.
        layouts: the layout, or B of them (member-major).
        vehicle: the one at home.
        settings: those at home.
        streams: seed and keys of the random streams of the B runs.

    Raises:
        ConfigError: a task cannot be varied so.
    """
    if variation and variation.is_random and len(layouts) == 1:
        layouts = [*layouts] * len(streams)
    tasks = [Task(layout, vehicle, settings) for layout in layouts]
    if variation is None:
        return tasks
    generators = (generator(seed, "variation", *keys) for seed, *keys in streams)
    return [variation.vary(task, rng) for task, rng in zip(tasks, generators, strict=False)]


def _changed(circle: Circle, **update: Any) -> Circle:
    return circle.model_copy(update=update)


def _with_obstacles(task: Task, obstacles: list[Circle]) -> Task:
    """The task with other obstacles; circles of other effects stay."""
    solid = set(task.layout.obstacles)
    circles = (*obstacles, *(circle for circle in task.layout.circles if circle not in solid))
    return task._replace(layout=task.layout.model_copy(update={"circles": circles}))


def _drawn(draw: Callable[[], list[Circle]]) -> list[Circle]:
    """The first draw of obstacles that has room for all.

    Raises:
        ConfigError: there is none.
    """
    for _ in range(DRAWS - 1):
        try:
            return draw()
        except ConfigError:
            continue
    return draw()


def _first_that_fits(layout: Layout, circle: Circle, places: np.ndarray, others: list[Circle]) -> Circle:
    """A circle at the first of some places `[N, 2]` (u) that keeps `GAP` to others, borders and corner squares.

    Raises:
        ConfigError: there is none.
    """
    need = circle.radius + GAP
    fits = ((places >= need) & (places <= np.array(layout.size) - need)).all(1)
    for other in others:
        fits &= np.hypot(*(places - other.center).T) >= need + other.radius
    for corner in range(4):
        fits &= np.hypot(*(places - places.clip(*layout.corner(corner))).T) >= need
    if not fits.any():
        raise ConfigError(f"no room for an obstacle was found in {TRIES} places of layout {layout.name!r}.")
    x, y = places[fits.argmax()]
    return _changed(circle, center=(float(x), float(y)))
