"""Random worlds of walls: their rules, read back from drawn circles, and a way from each corner to the opposite one."""

import re
from typing import Any

import numpy as np
import pytest

from affmap.env.body import Vehicle
from affmap.env.geometry import crossable
from affmap.env.layout import Layout
from affmap.env.procedural import load
from affmap.env.vehicle import VehicleEnv
from affmap.env.walls import Walls
from affmap.random import generator
from affmap.settings import ConfigError, read

FILES = ("doors", "rooms", "spiral", "trap")
VEHICLE = Vehicle.load("vehicle", "default")
SEEDS = 12
LOCK: dict[str, Any] = {
    "doors": [[[2.0, 1.0], [2.0, 2.0]]],
    "keys": [[0.5, 0.5], [2.5, 1.5]],
    "key_radius": 0.15,
    "door_channel": "fog",
    "key_channel": "force_up",
}


def walls(**changes: Any) -> Walls:
    """An L of two lines on the lower border."""
    own = {"name": "mine", "walls": [[[1.0, 0.0], [1.0, 1.0], [2.0, 1.0]]], "radius": 0.1, "shift": 0.05}
    return Walls.checked(read("layout", "trap") | own | changes, "here")


@pytest.mark.parametrize("name", FILES)
def test_each_corner_has_a_way_to_the_opposite_one(name: str) -> None:
    """In every world that is drawn; the corners themselves are free."""
    rules = load(name)
    assert isinstance(rules, Walls)
    for seed in range(SEEDS):
        layout = rules.draw(generator(seed, "world", 0))
        layout.check_corners(VEHICLE.radius)
        for corner in (0, 1):
            start, goal = (layout.corner(index).mean(0) for index in (corner, 3 - corner))
            assert crossable(layout, VEHICLE, start, goal), (name, seed, corner)


def test_walls_are_rows_of_circles_without_a_gap() -> None:
    """Without a shift or mirrors, by hand: eleven circles up, ten more to the right, a radius apart."""
    drawn = {tuple(layout.circles) for layout in (walls(shift=0).draw(generator(s, "w")) for s in range(40))}
    assert len(drawn) == 4  # mirrored or not, along either axis
    expected = [(1.0, round(0.1 * k, 6)) for k in range(11)] + [(round(1 + 0.1 * k, 6), 1.0) for k in range(1, 11)]
    assert any([tuple(np.round(each.center, 6)) for each in circles] == expected for circles in drawn)
    assert {(each.radius, each.effect, each.channel) for circles in drawn for each in circles} == {
        (0.1, "obstacle", "solid")
    }


def test_joints_stay_joints_and_borders_borders() -> None:
    """In many draws: corners move within the shift, both lines end in one joint, and the first begins on a border."""
    places = []
    for seed in range(50):
        centers = np.array([circle.center for circle in walls().draw(generator(seed, "w")).circles])
        assert len({tuple(each) for each in centers}) == len(centers)
        assert np.linalg.norm(np.diff(centers, axis=0), axis=1).max() <= 0.1 + 1e-9
        assert centers[0, 1] in (0.0, 2.0)
        x = min(centers[0, 0], 3 - centers[0, 0])
        places.append(x)
        assert 0.95 <= x <= 1.05
    assert np.ptp(places) > 0.08


def test_doors_are_rows_that_end_in_walls_and_keys_move_with_them() -> None:
    """Without a shift, by hand: ten circles from the end of the wall up, that of the wall left out; then the keys."""
    made = walls(shift=0, lock=LOCK).draw(generator(0, "w")).circles
    mirrored = np.array([made[0].x != 1.0, made[0].y != 0.0])
    doors, keys = made[21:31], made[31:]
    for found, places in ((doors, [[2, 1 + 0.1 * k] for k in range(1, 11)]), (keys, LOCK["keys"])):
        expected = np.where(mirrored, np.subtract([3.0, 2.0], places), places)
        np.testing.assert_allclose([each.center for each in found], expected)
    assert {each.effect for each in made[:21]} == {"obstacle"}
    assert {(each.radius, each.effect, each.channel) for each in doors} == {(0.1, "door", "fog")}
    assert {(each.radius, each.effect, each.channel) for each in keys} == {(0.15, "key", "force_up")}
    moved = [walls(lock=LOCK).draw(generator(seed, "w")).circles[-2].center for seed in range(20)]
    assert np.ptp([min(x, 3 - x) for x, _ in moved]) > 0.03
    assert walls(lock=LOCK).effects == ["obstacle", "door", "key"] and "doors: 1, keys: 2" in repr(walls(lock=LOCK))


def test_keys_are_never_drawn_inside_walls() -> None:
    """A key as near to a door as is allowed, which moves a lot: in each of many draws its centre is outside."""
    rules = walls(lock=LOCK | {"keys": [[2.0 + 0.1 + 0.15 * 2**1.5, 1.5]]}, shift=0.15)
    for seed in range(50):
        *solid, key = rules.draw(generator(seed, "w")).circles
        assert min(np.hypot(*np.subtract(each.center, key.center)) for each in solid) > 0.1


def test_the_way_to_the_nearest_key_leads_away_from_the_goal() -> None:
    """In every draw of `doors`, from all corners; and no straight line to the goal comes near a key."""
    rules = load("doors")
    assert isinstance(rules, Walls)
    for seed in range(SEEDS):
        layout = rules.draw(generator(seed, "world", 0))
        keys = np.array([each.center for each in layout.circles if each.effect == "key"])
        solid = tuple(each.model_copy(update={"effect": "obstacle"}) for each in layout.obstacles)
        shut = layout.model_copy(update={"circles": solid})
        for corner in range(4):
            start, goal = (layout.corner(index).mean(0) for index in (corner, 3 - corner))
            assert not crossable(shut, VEHICLE, start, goal)
            nearest = keys[np.linalg.norm(keys - start, axis=1).argmin()]
            assert np.linalg.norm(nearest - goal) > np.linalg.norm(start - goal) + 0.1
            line = np.linspace(start, goal, 50)[:, None]
            assert np.linalg.norm(line - keys, axis=-1).min() > 0.4


def test_a_draw_depends_on_its_generator_alone() -> None:
    one, same, other = (walls().draw(generator(seed, "w")) for seed in (1, 1, 2))
    assert one == same != other


def test_an_environment_flies_in_them() -> None:
    """A new world each episode."""
    env = VehicleEnv("trap", VEHICLE)
    worlds = []
    for seed in (0, 1):
        env.reset(seed=seed)
        worlds.append(env.layout)
    assert worlds[0] != worlds[1] and all(isinstance(each, Layout) for each in worlds)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"channel": "moon"}, "channel = 'moon' is not one of channels"),
        ({"walls": [[[1.0, 0.01], [1.0, 1.0]]]}, "leaves the arena of size [3.0, 2.0] when it moves by shift = 0.05"),
        ({"walls": [[[1.0, 1.0]]]}, "walls[0]"),
        ({"walls": []}, "walls = []"),
        ({"radius": 0.001}, "radius = 0.001 is too small for walls of"),
        ({"radius": 0}, "greater than 0"),
        ({"shift": -1}, "greater than or equal to 0"),
        ({"lock": LOCK | {"door_channel": "moon"}}, "door_channel = 'moon' is not one of channels"),
        ({"lock": LOCK | {"key_channel": "moon"}}, "key_channel = 'moon' is not one of channels"),
        ({"lock": LOCK | {"keys": [[0.01, 1.0]]}}, "lock has the corner [0.01, 1.0]"),
        ({"lock": LOCK | {"keys": []}}, "lock.keys"),
        ({"lock": LOCK | {"keys": [[0.5, 0.5], [1.5, 1.0]]}}, "lock.keys[1] = [1.5, 1.0] is 0 u from the middle of a"),
        (
            {"lock": LOCK | {"keys": [[2.3, 1.4]]}, "shift": 0.15},
            "may be drawn inside; put it at least 0.524 u away",
        ),
        ({"lock": LOCK | {"key_radius": 0}}, "greater than 0"),
    ],
)
def test_bad_rules_are_named(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(problem)):
        walls(**changes)
