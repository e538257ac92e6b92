"""The physics of many vehicles at once against Box2D: the same starts, the same actions, twenty steps."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from affmap.data.collect import free_position, random_actions
from affmap.data.settings import Exploration
from affmap.env.body import Vehicle
from affmap.env.layout import Acts, Layout
from affmap.env.physics import Physics
from affmap.env.procedural import load
from affmap.env.twin import Twin
from affmap.random import generator

VEHICLE = Vehicle.load("vehicle", "default")
EXPLORATION = Exploration.load("data", "default")
HORIZON, BEFORE, FLIGHTS = 20, 20, 150


@cache
def worlds(name: str, number: int = 5) -> list[Layout]:
    """The world of a file, or several that are drawn by its rules."""
    layout = load(name)
    return [layout] if isinstance(layout, Layout) else [layout.draw(generator(k, "world", 0)) for k in range(number)]


def world(*circles: tuple[float, float, float, str], acts: Acts = "rim") -> Layout:
    parts = [{"center": [x, y], "radius": r, "effect": effect, "channel": "solid"} for x, y, r, effect in circles]
    return Layout.load("layout", "original", circles=parts, acts=acts)


class Flights(NamedTuple):
    """P vehicles on their way, and what Box2D does with them."""

    world: np.ndarray
    """`[P]`."""
    position: np.ndarray
    velocity: np.ndarray
    """`[P, 2]`, u and u/step."""
    actions: np.ndarray
    """`[P, H, 4]`."""
    paths: np.ndarray
    """`[P, H, 2]`, u."""
    touching: np.ndarray
    in_fog: np.ndarray
    """`[P, H]`."""


def flown(layouts: Sequence[Layout], number: int = FLIGHTS) -> Flights:
    """Flights with the actions of exploration, after some steps of it."""
    rng = np.random.default_rng(0)
    actual = []
    for k in range(number):
        layout = layouts[k % len(layouts)]
        physics = Physics(layout, VEHICLE, free_position(layout, VEHICLE, rng))
        actions = random_actions(EXPLORATION, rng)[: BEFORE + HORIZON]
        for action in actions[:BEFORE]:
            physics.step(action)
        start = k % len(layouts), physics.position, physics.velocity, np.array(actions[BEFORE:])
        steps = []
        for action in actions[BEFORE:]:
            physics.step(action)
            steps.append((physics.position, physics.touching, physics.in_fog))
        actual.append((*start, *map(np.array, zip(*steps, strict=True))))
    return Flights(*map(np.array, zip(*actual, strict=True)))


FILES = ["original", "two_obstacles", "four_properties", "procedural_easy", "procedural_hard"]


@pytest.mark.parametrize("name", [*FILES, "procedural_crowded_hard"])
def test_it_flies_as_box2d_does(name: str) -> None:
    """Box2D itself: in free flight up to the rounding of its float32, in contact nearly always within 0.001 u.

    Where a vehicle touches several things at once, the order of impacts may differ, and so may the ways after it.
    """
    flights = flown(worlds(name))
    paths = Twin(worlds(name), VEHICLE).fly(flights.world, flights.position, flights.velocity, flights.actions)
    errors = np.linalg.norm(paths - flights.paths, axis=-1)
    touched = np.logical_or.accumulate(flights.touching, axis=1)
    assert 0.1 < touched.mean() < 0.9
    assert errors[~touched].max() < 1e-5
    assert np.median(errors[touched]) < 1e-5
    assert (errors[touched] < 1e-3).mean() >= 0.99
    assert np.linalg.norm(flights.paths[:, -1] - flights.position, axis=1).mean() > 0.2


@pytest.mark.parametrize("acts", ["center", "rim"])
def test_it_knows_the_same_fog(acts: Acts) -> None:
    """`Physics` along its own paths, step by step; in the paper's worlds and where fogs overlap."""
    fogs = world((0.8, 1.0, 0.5, "fog"), (1.3, 1.0, 0.4, "fog"), (2.2, 1.2, 0.6, "fog"), acts=acts)
    some = [fogs, *(layout.model_copy(update={"acts": acts}) for layout in worlds("procedural_hard"))]
    flights, twin = flown(some, 60), Twin(some, VEHICLE)
    for step in range(HORIZON):
        actual = twin.in_fog(flights.world, flights.paths[:, step])
        np.testing.assert_array_equal(actual, flights.in_fog[:, step])
    assert 0.05 < flights.in_fog.mean() < 0.95


@pytest.mark.parametrize(("acts", "limit"), [("center", 0.3), ("rim", 0.36)])
def test_circles_begin_to_act_where_they_do_in_box2d(acts: Acts, limit: float) -> None:
    """Closed form: a step from rest has the pull of a field and fog's noise, 0.0001 u inside of the limit, not outside.

    The first step from rest under a force F ends dt2 F / m (1 - dt d) from where it began.
    """
    layouts = [world((1.5, 1.0, 0.3, effect), acts=acts) for effect in ("force_up", "force_down", "fog")]
    number, inside = np.repeat(np.arange(3), 2), np.tile([True, False], 3)
    start = np.stack([1.5 + limit + np.where(inside, -0.0001, 0.0001), np.full(6, 1.0)], axis=1)
    twin, dt = Twin(layouts, VEHICLE), VEHICLE.time_step_s
    path = twin.fly(number, start, np.zeros((6, 2)), np.zeros((6, 1, 4)))[:, 0]
    moved = dt**2 * VEHICLE.force / VEHICLE.mass * (1 - dt * VEHICLE.damping)
    np.testing.assert_allclose(path - start, [[0, moved], [0, 0], [0, -moved], [0, 0], [0, 0], [0, 0]], atol=1e-12)
    assert twin.in_fog(number, start).tolist() == [False] * 4 + [True, False]


def test_as_seen_overlapping_fields_of_one_look_pull_as_one() -> None:
    """Closed form, as above; a place where two fields pull up and one of another look does, and one pulls down."""
    twice, down = ((1.5, 1.0, 0.3, "force_up"), (1.6, 1.0, 0.3, "force_up")), (1.5, 1.1, 0.3, "force_down")
    fields = [world(*twice), world(*twice, down), world(down, *twice, (1.55, 1.0, 0.2, "force_up")), world()]
    other = fields[0].circles[1].model_copy(update={"channel": "fog"})
    layouts = [
        *fields,
        fields[0].model_copy(update={"channels": ("solid", "fog"), "circles": (fields[0].circles[0], other)}),
    ]
    start, number, dt = np.tile([1.55, 1.0], (5, 1)), np.arange(5), VEHICLE.time_step_s
    unit = dt**2 * VEHICLE.force / VEHICLE.mass * (1 - dt * VEHICLE.damping)
    for as_seen, pulls in ((False, [2, 1, 2, 0, 2]), (True, [1, 0, 0, 0, 2])):
        path = Twin(layouts, VEHICLE, as_seen).fly(number, start, np.zeros((5, 2)), np.zeros((5, 1, 4)))[:, 0]
        np.testing.assert_allclose(path - start, [[0, pull * unit] for pull in pulls], atol=1e-12)


@pytest.mark.parametrize("name", ["original", "procedural_hard"])
def test_vehicles_side_by_side_are_vehicles_alone(name: str) -> None:
    """Bit for bit, each with a twin of its own world; starts and actions are left as they were."""
    flights = flown(worlds(name), 20)
    given = [part.copy() for part in flights]
    twin = Twin(worlds(name), VEHICLE)
    together = twin.fly(flights.world, flights.position, flights.velocity, flights.actions)
    for part, before in zip(flights, given, strict=True):
        np.testing.assert_array_equal(part, before)
    assert np.ptp(together[:, -1], axis=0).min() > 1
    for k in range(20):
        mine, alone = slice(k, k + 1), Twin([worlds(name)[flights.world[k]]], VEHICLE)
        none = np.zeros(1, int)
        path = alone.fly(none, flights.position[mine], flights.velocity[mine], flights.actions[mine])
        np.testing.assert_array_equal(together[k], path[0])
        assert alone.in_fog(none, flights.position[mine]) == twin.in_fog(flights.world, flights.position)[k]


def test_worlds_of_different_numbers_of_circles_can_be_in_one_twin() -> None:
    """Each world alone, bit for bit: without circles, with obstacles only, with fog only, with fields, with all."""
    layouts = [
        world(),
        world((1.0, 1.0, 0.3, "fog"), (1.5, 0.6, 0.2, "fog")),
        *(Layout.load("layout", name) for name in ("twelve_obstacles", "training_force_up", "four_properties")),
        world((1.5, 1.0, 0.9, "none")),
    ]
    rng = np.random.default_rng(1)
    starts = np.stack([free_position(layouts[k % 6], VEHICLE, rng) for k in range(60)])
    number, velocity = np.arange(60) % 6, rng.uniform(-0.1, 0.1, (60, 2))
    actions = rng.uniform(size=(60, HORIZON, 4)).round()
    together = Twin(layouts, VEHICLE)
    assert len(together) == 6
    paths, foggy = together.fly(number, starts, velocity, actions), together.in_fog(number, starts)
    for k, layout in enumerate(layouts):
        mine, alone = number == k, Twin([layout], VEHICLE)
        none = np.zeros(mine.sum(), int)
        np.testing.assert_array_equal(paths[mine], alone.fly(none, starts[mine], velocity[mine], actions[mine]))
        np.testing.assert_array_equal(foggy[mine], alone.in_fog(none, starts[mine]))
    assert np.isfinite(paths).all() and foggy[number == 1].any() and not foggy[number == 0].any()


def test_the_vehicle_s_numbers_are_those_of_its_file() -> None:
    """Box2D with another vehicle: free flight in a field and along a border, up to its rounding."""
    changes = {"radius": 0.1, "mass": 0.2, "thrust": 0.7, "force": 0.9, "damping": 3.0, "contact_damping": 9.0}
    vehicle = Vehicle.load("vehicle", "default", **changes, time_step_s=0.05)
    layout, rng = world((1.5, 1.0, 0.5, "force_up"), acts="center"), np.random.default_rng(2)
    for start in ([1.4, 0.8], [0.097, 0.3], [2.0, 0.098]):
        physics, actions = Physics(layout, vehicle, np.array(start)), rng.uniform(size=(8, 4))
        begin, expected = physics.position, []
        for action in actions:
            physics.step(action)
            expected.append(physics.position)
        path = Twin([layout], vehicle).fly(np.zeros(1, int), begin[None], np.zeros((1, 2)), actions[None])[0]
        np.testing.assert_allclose(path, expected, atol=1e-5)


def test_a_vehicle_exactly_on_a_border_or_a_centre_is_pushed_out() -> None:
    """By hand: there is no direction away there, but the path is finite and leads away; the border's one is across."""
    layout = world((0.75, 0.5, 0.2, "obstacle"))
    starts = np.array([[0.0, 1.0], [1.5, 2.0], [0.75, 0.5]])
    paths = Twin([layout], VEHICLE).fly(np.zeros(3, int), starts, np.zeros((3, 2)), np.zeros((3, HORIZON, 4)))
    assert np.isfinite(paths).all()
    moved = np.abs(paths[:, -1] - starts)
    assert (moved[[0, 1, 2], [0, 1, 0]] > 0.01).all() and (moved[[0, 1, 2], [1, 0, 1]] == 0).all()


def test_a_world_that_there_is_not_is_refused() -> None:
    twin = Twin([world()], VEHICLE)
    for number in (np.array([1]), np.array([0, -1])):
        rest = np.ones((len(number), 2)), np.zeros((len(number), 2)), np.zeros((len(number), 1, 4))
        with pytest.raises(IndexError, match="there are 1 worlds"):
            twin.fly(number, *rest)
        with pytest.raises(IndexError, match="there are 1 worlds"):
            twin.in_fog(number, rest[0])
