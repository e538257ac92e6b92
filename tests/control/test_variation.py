"""Factors of variation: each against a closed form, by itself; home is no variation."""

import math
from typing import Any

import numpy as np
import pytest

from affmap.control.settings import ControlSettings
from affmap.control.variation import FACTORS, GAP, HOME, Task, Variation, load
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.physics import Physics
from affmap.env.vehicle import VehicleEnv
from affmap.random import generator
from affmap.settings import ConfigError
from affmap.view import view

TASK = Task(
    Layout.load("layout", "original"), Vehicle.load("vehicle", "default"), ControlSettings.load("control", "default")
)
LEVELS = {"number": 8, "place": 0.2, "look": 0.3, "contact": 6, "field": 0.2, "noise": 0.02, "size": 2, "goal": 1}
"""Factor -> another value than at home; others are doubled or, of obstacles' radius, 0.25."""

CONTENTS = {
    "layout": {"number", "radius", "place", "look", "size", "field"},
    "vehicle": {"mass", "thrust", "damping", "contact", "noise", "field", "step"},
    "settings": {"goal", "step"},
}
"""Part of a task -> the factors that change it."""


def level(factor: str) -> float:
    return LEVELS.get(factor, 0.25 if factor == "radius" else 2 * FACTORS[factor].home(TASK))


def varied(factor: str, value: float, seed: int = 0) -> Task:
    return Variation(factor=factor, value=value).vary(TASK, generator(seed, "variation", 0))


def flown(task: Task, action: list[float], steps: int = 1, start: tuple[float, float] = (0.3, 1.0)) -> np.ndarray:
    """Positions from a start at rest, `[T + 1, 2]` in u."""
    physics = Physics(task.layout, task.vehicle, np.array(start))
    path = [physics.position]
    for _ in range(steps):
        physics.step(np.array(action))
        path.append(physics.position)
    return np.array(path)


RIGHT = [1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("factor", FACTORS)
def test_the_value_at_home_is_no_variation(factor: str) -> None:
    """The very same objects, so that all that follows from them has the same bytes."""
    assert varied(factor, FACTORS[factor].home(TASK)) is TASK


@pytest.mark.parametrize("factor", FACTORS)
def test_a_factor_changes_its_own_parts_of_a_task_and_no_other(factor: str) -> None:
    task = varied(factor, level(factor))
    changed = {part for part in Task._fields if getattr(task, part) != getattr(TASK, part)}
    assert changed == {part for part, factors in CONTENTS.items() if factor in factors}


def test_values_at_home_are_those_of_the_files() -> None:
    """By hand; the distance of the goal is from the centre of a corner's square to that of the opposite one."""
    home = {name: factor.home(TASK) for name, factor in FACTORS.items()}
    assert home.pop("goal") == pytest.approx(math.hypot(2.6, 1.6))
    assert home == {
        "number": 6,
        "radius": 0.2,
        "place": 0,
        "look": 0.2,
        "mass": 0.1,
        "thrust": 1,
        "damping": 1.92,
        "contact": 12,
        "field": 0,
        "noise": 0,
        "size": 1,
        "step": pytest.approx(1000 / 30),
    }


def test_a_doubled_mass_halves_the_acceleration() -> None:
    """The first step from rest, F / m dt^2 (1 - damping dt)."""
    heavy, light = (flown(varied("mass", mass), RIGHT)[1, 0] - 0.3 for mass in (0.2, 0.05))
    assert light / heavy == pytest.approx(4, rel=1e-4)
    assert heavy == pytest.approx(math.sqrt(2) / 0.2 / 900 * (1 - 1.92 / 30), rel=1e-4)


def test_mass_and_thrust_are_one_factor_where_no_field_pulls() -> None:
    """A flight along an obstacle and a border: twice the mass is half the thrust; with a field it is not."""
    actions, start = [1.0, 0.0, 0.3, 0.9], (0.3, 0.62)
    heavy, weak = (flown(varied(*each), actions, 60, start) for each in (("mass", 0.2), ("thrust", 0.5)))
    assert np.abs(heavy - flown(TASK, actions, 60, start)).max() > 0.3
    np.testing.assert_allclose(heavy, weak, atol=1e-5)
    pulled = varied("field", 0.4)
    heavy, weak = (
        flown(pulled._replace(vehicle=pulled.vehicle.model_copy(update=each)), actions, 60, start)
        for each in ({"mass": 0.2}, {"thrust": 0.5})
    )
    assert np.abs(heavy - weak).max() > 0.1


def test_damping_sets_the_top_speed() -> None:
    """Its closed form, reached within twenty steps."""
    for damping in (7.68, 15.36):
        task = varied("damping", damping)
        x = flown(task, RIGHT, 20)[:, 0]
        assert np.diff(x)[-1] == pytest.approx(task.vehicle.top_speed, rel=0.01)


def test_contact_damping_acts_along_a_border() -> None:
    """The first step from rest, F / m dt^2 (1 - damping dt), and in free flight none of it."""
    for damping in (3.0, 24.0):
        task = varied("contact", damping)
        step = flown(task, RIGHT, start=(1.0, 0.06))[1, 0] - 1.0
        assert step == pytest.approx(math.sqrt(2) / 0.1 / 900 * (1 - damping / 30), rel=1e-4)
        np.testing.assert_array_equal(flown(task, RIGHT, 20), flown(TASK, RIGHT, 20))


def test_an_unseen_field_pulls_everywhere_and_is_in_no_view() -> None:
    """From rest, f / m dt^2 (1 - damping dt) upwards; in all corners of the arena, and in the same pictures as home."""
    task = varied("field", 0.3)
    for start in ((0.07, 0.07), (2.93, 1.0), (1.5, 1.0)):
        step = flown(task, [0.0] * 4, 1, start)[1] - start
        np.testing.assert_allclose(step, [0, 0.3 / 0.1 / 900 * (1 - 1.92 / 30)], atol=1e-5)
    places = np.random.default_rng(0).uniform(0, (3, 2), (50, 2))
    np.testing.assert_array_equal(view(task.layout.map, places), view(TASK.layout.map, places))


def test_fields_that_there_are_pull_with_another_force() -> None:
    """In the lower left circle of the map of Experiment V, from rest, f / m dt^2 (1 - damping dt) downwards."""
    task = TASK._replace(layout=Layout.load("layout", "four_properties"))
    stronger = Variation(factor="field", value=0.8).vary(task, generator(0, "variation", 0))
    assert FACTORS["field"].home(task) == task.vehicle.force == 0.5 and stronger.layout == task.layout
    step = flown(stronger, [0.0] * 4, 1, (0.9, 0.6))[1] - (0.9, 0.6)
    np.testing.assert_allclose(step, [0, -0.8 / 0.1 / 900 * (1 - 1.92 / 30)], atol=1e-5)


def test_looks_change_pictures_and_not_obstacles() -> None:
    """Pictures are those of a world whose obstacles have that radius; the vehicle stops where it does at home."""
    places = np.random.default_rng(0).uniform(0, (3, 2), (50, 2))
    for painted in (0.0, 0.1, 0.4):
        task = varied("look", painted)
        as_painted = [circle.model_copy(update={"radius": painted or 1e-6}) for circle in TASK.layout.circles]
        other = TASK.layout.model_copy(update={"circles": tuple(as_painted)})
        np.testing.assert_array_equal(view(task.layout.map, places), view(other.map, places))
        np.testing.assert_array_equal(flown(task, RIGHT, 30, (0.3, 0.5)), flown(TASK, RIGHT, 30, (0.3, 0.5)))


def test_radii_are_those_of_physics_and_pictures() -> None:
    """A vehicle that flies at an obstacle stops when it touches it: at its centre minus both radii."""
    for radius in (0.1, 0.3):
        task = varied("radius", radius)
        assert flown(task, RIGHT, 40, (0.3, 0.5))[-1, 0] == pytest.approx(0.75 - radius - 0.06, abs=0.006)
        assert {circle[2] for circle in task.layout.map.circles} == {radius}


@pytest.mark.parametrize(("factor", "value"), [("number", 8.0), ("number", 10.0), ("place", 0.1), ("place", 0.3)])
def test_obstacles_that_are_drawn_keep_their_gap(factor: str, value: float) -> None:
    """To all others, to borders, and to the squares where runs start; each world is another one."""
    worlds = [varied(factor, value, seed).layout for seed in range(20)]
    assert len(set(worlds)) == 20
    home = np.array([circle.center for circle in TASK.layout.circles])
    for world in worlds:
        centers = np.array([circle.center for circle in world.circles])
        gaps = np.linalg.norm(centers[:, None] - centers, axis=-1) + np.diag(np.full(len(centers), np.inf)) - 0.4
        assert gaps.min() >= GAP - 1e-9
        assert (centers - 0.2 >= GAP).all() and (centers + 0.2 <= np.array(world.size) - GAP).all()
        assert min(gap for *_, gap in world._corner_gaps) >= GAP - 1e-9
        moved = [
            np.linalg.norm(np.array(circle.center) - place) for circle, place in zip(world.circles, home, strict=False)
        ]
        np.testing.assert_allclose(moved, value if factor == "place" else 0, atol=1e-9)
        assert len(centers) == (value if factor == "number" else 6)


def test_fewer_obstacles_are_some_of_those_at_home() -> None:
    """All of the 15 pairs turn up."""
    pairs = {varied("number", 2.0, seed).layout.circles for seed in range(200)}
    assert len(pairs) == 15 and all(set(pair) < set(TASK.layout.circles) for pair in pairs)
    assert varied("number", 0.0).layout.circles == ()


def test_a_larger_arena_has_its_obstacles_farther_apart_and_no_larger() -> None:
    layout = varied("size", 2.0).layout
    assert layout.size == (6.0, 4.0)
    assert [circle.center for circle in layout.circles][:2] == [(1.5, 1.0), (1.5, 3.0)]
    assert {circle.radius for circle in layout.circles} == {0.2}


def test_runs_with_another_time_step_last_as_long() -> None:
    """200 steps of a thirtieth of a second."""
    for step, steps in ((8.33, 800), (66.7, 100)):
        task = varied("step", step)
        assert task.vehicle.time_step_s == pytest.approx(step / 1000) and task.settings.num_steps == steps


def test_an_environment_reports_with_the_noise_that_a_variation_asks_for() -> None:
    """Deviations of 400 reports from the truth."""
    task = varied("noise", 0.1)
    env = VehicleEnv(task.layout, task.vehicle)
    env.reset(seed=0)
    steps = [env.step(np.zeros(4)) for _ in range(200)]
    errors = [observation["position"] - info["position"] for observation, *_, info in steps]
    assert np.std(errors) == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("mass/0.2", {"factor": "mass", "value": 0.2}),
        ("number/2", {"factor": "number", "value": 2.0}),
        (HOME, None),
        (None, None),
        ({"factor": "size"}, {"factor": "size"}),
    ],
)
def test_a_variation_is_a_text(text: Any, read: Any) -> None:
    assert Variation.read(text) == read
    if isinstance(read, dict) and len(read) == 2:
        assert str(Variation(**read)) == text


@pytest.mark.parametrize("text", ["mass", "mass/", "mass/much", "moss/2", "/", "", "away", "mass/0.2/3"])
def test_other_texts_are_named_with_the_factors_there_are(text: str) -> None:
    with pytest.raises(ValueError, match=r"should be home, or a factor and its value, such as mass/0.2; .* number, "):
        Variation.read(text)


@pytest.mark.parametrize(
    ("given", "loaded"),
    [(None, None), (HOME, None), ("mass/0.2", "mass/0.2"), ({"factor": "size", "value": 2}, "size/2")],
)
def test_a_call_takes_a_variation_in_any_form(given: Any, loaded: str | None) -> None:
    assert (variation := load(given)) is loaded is None or str(variation) == loaded
    assert load(variation) is variation


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ("moss/2", r"^variation = 'moss/2' is not allowed: it should be home, or a factor and its value, such as mass"),
        (5, r"^variation = 5 is not allowed; give a factor and its value, such as 'mass/0\.2'\.$"),
        ({"factor": "moss", "value": 2}, "should be one of number, radius, place"),
        ({"factor": "mass"}, "value is missing"),
    ],
)
def test_a_variation_that_there_is_not_is_told(given: Any, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        load(given)


@pytest.mark.parametrize(
    ("factor", "value", "problem"),
    [
        ("number", 2.5, "2.5 is no number of obstacles"),
        ("number", -1.0, "-1 is no number of obstacles"),
        ("number", 50.0, "no room for an obstacle was found"),
        ("place", 2.0, "no room for an obstacle was found"),
        ("place", -0.1, "-0.1 is no distance; give a number from 0 up"),
        ("mass", -1.0, "mass = -1.0 is not allowed: it should be greater than 0"),
        ("radius", 0.5, "blocks the start corner"),
        ("contact", 30.0, "would stop the vehicle for good"),
        ("look", -1.0, "painted = -1.0 is not allowed"),
        ("size", 0.0, "size"),
        ("goal", 0.0, "goal_distance = 0.0 is not allowed"),
        ("goal", 0.1, "it puts goals 0.1 u away, and control.goal_radius = 0.1 would count runs as successes"),
        ("step", -1.0, "num_steps = 0 is not allowed"),
        ("noise", -1.0, "sensor_std = -1.0 is not allowed"),
    ],
)
def test_a_value_that_cannot_be_flown_is_named_with_its_reason(factor: str, value: float, problem: str) -> None:
    with pytest.raises(ConfigError, match=rf"variation = '{factor}/{value:g}' cannot be flown: .*{problem}"):
        varied(factor, value)
