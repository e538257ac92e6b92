"""Times to go: shortest paths against relaxation by hand, edges against Box2D, and flights out of traps."""

import itertools
from typing import Any

import numpy as np
import pytest
import torch

import affmap
from affmap.control.agent import Agent, ControlSettings
from affmap.control.controller import Observation
from affmap.control.episodes import control
from affmap.control.oracle import Oracle
from affmap.control.time_to_go import DIRECTIONS, TimeToGo
from affmap.env.body import Vehicle
from affmap.env.geometry import surface_distance
from affmap.env.layout import Layout
from affmap.env.physics import Physics
from affmap.env.procedural import load
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import ModelSettings, Stack
from affmap.planning.cem import CEMPlanner
from affmap.random import generator
from affmap.settings import ConfigError

VEHICLE = Vehicle.load("vehicle", "default")
SETTINGS = ControlSettings.load("control", "default", guide="time_to_go", runs_per_member=4)
PLANNER = CEMPlanner.load("planner", "cem")
EMPTY = Layout.load("layout", "four_properties", name="empty", circles=())
RULES = {name: load(name) for name in ("trap", "rooms", "spiral", "doors")}


def draw(name: str, run: int) -> Layout:
    rules = RULES[name]
    assert not isinstance(rules, Layout)
    return rules.draw(generator(3, "world", run))


def oracle(*layouts: Layout, **changes: Any) -> Oracle:
    return Oracle(layouts, VEHICLE, PLANNER, SETTINGS.model_copy(update=changes))


def agent(layouts: list[Layout], *seeds: int) -> Agent:
    """Untrained, with a coarse map."""
    stack = Stack(ModelSettings.load("model", "default", context_size=3), 4, seeds)
    return Agent(stack, AffordanceMap.paint(stack, [each.map for each in layouts], 0.1), PLANNER, SETTINGS)


def relaxed(costs: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Bellman and Ford's algorithm on `[8, Y, X]`, in plain loops."""
    _, height, width = costs.shape
    steps = np.where(sources, 0.0, np.inf)
    for _ in range(height * width):
        for (x, y), (d, (right, up)) in itertools.product(np.ndindex(width, height), enumerate(DIRECTIONS)):
            if 0 <= x + right < width and 0 <= y + up < height:
                steps[y, x] = min(steps[y, x], costs[d, y, x] + steps[y + up, x + right])
    return steps


def test_shortest_paths_are_those_of_plain_relaxation() -> None:
    """Random costs in two worlds, a third of them infinite, and no path between the worlds."""
    rng = np.random.default_rng(0)
    costs = rng.uniform(1, 9, (2, 8, 4, 5))
    costs[rng.random(costs.shape) < 0.3] = np.inf
    x, y = np.arange(1, 6) / 10, np.arange(1, 5) / 10
    goals = np.array([[0.1, 0.1], [0.5, 0.3]])
    made = TimeToGo(costs, x, y, goals, 40.0)
    nodes = np.stack(np.meshgrid(x, y), -1)
    for steps, cost, goal in zip(made.steps, costs, goals, strict=True):
        expected = relaxed(cost, np.linalg.norm(nodes - goal, axis=-1) < 0.1 + 1e-9)
        np.testing.assert_allclose(steps, expected)


def test_an_edge_costs_the_steps_of_a_flight_from_rest() -> None:
    """Along a row of an empty arena, by Box2D: as often as a spacing is passed, and what the deviation costs."""
    physics, places = Physics(EMPTY, VEHICLE, np.array([1.0, 1.0])), [1.0]
    while places[-1] < 1.1:
        physics.step(np.array([1.0, 0, 0, 1.0]))  # the two throttles that push to the right
        places.append(physics.position[0])
    steps = len(places) - 2 + (1.1 - places[-2]) / (places[-1] - places[-2])
    std = 0.0005 * np.sqrt(len(places) - 1)
    made = TimeToGo.imagine(oracle(EMPTY), [2.8, 1.0])
    row = made.steps[0][np.isclose(made.y, 1.0)][0]
    far, near = (row[np.isclose(made.x, x)].item() for x in (0.5, 1.5))
    assert far - near == pytest.approx(10 * (steps + SETTINGS.guide_uncertainty * std), rel=1e-3)


@pytest.mark.parametrize("name", RULES)
def test_paths_lead_around_walls_to_the_goal(name: str) -> None:
    """By true physics: no node of a path lies where the vehicle cannot be, up to half a spacing."""
    layouts = [draw(name, run) for run in range(4)]
    starts, goals = (
        np.array([layout.corner(c).mean(0) for layout, c in zip(layouts, corners, strict=True)])
        for corners in ((0, 1, 2, 3), (3, 2, 1, 0))
    )
    made = TimeToGo.imagine(oracle(*layouts), goals)
    for path, layout, start, goal in zip(made.paths(starts), layouts, starts, goals, strict=True):
        np.testing.assert_allclose(path[[0, -1]], [start, goal])
        is_open = layout.are_open(path)
        assert surface_distance(path[is_open], layout.opened).min(initial=1) > VEHICLE.radius - made.x[0] / 2
        assert surface_distance(path[~is_open], layout).min(initial=1) > VEHICLE.radius - made.x[0] / 2
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.22


def test_fog_is_avoided_where_uncertainty_costs() -> None:
    """A band of fog between start and goal with a way beside it: straight through without a cost, else around."""
    fog = [{"center": (1.5, y), "radius": 0.2, "effect": "fog", "channel": "fog"} for y in np.arange(0.8, 2.01, 0.2)]
    layout = Layout.load("layout", "four_properties", name="band", circles=fog)
    start, goal = [[0.5, 1.5]], [2.5, 1.5]
    lowest = {}
    for cost in (0.0, 3000.0):
        made = TimeToGo.imagine(oracle(layout, guide_uncertainty=cost), goal)
        lowest[cost] = made.paths(start)[0][:, 1].min()
    assert lowest[0.0] > 1.4 and lowest[3000.0] < 0.6


def test_subgoals_lie_ahead_on_the_way() -> None:
    """In an empty arena: so far along the path, then the goal; and the goal where no way is imagined."""
    made = TimeToGo.imagine(oracle(EMPTY), [[2.8, 1.0]])
    position = np.array([[0.5, 1.0]])
    np.testing.assert_allclose(made.subgoals(position, 0.6), [[1.1, 1.0]], atol=1e-6)
    np.testing.assert_allclose(made.subgoals(position, 0.65), [[1.15, 1.0]], atol=1e-6)
    for place in ([2.5, 1.0], [2.8, 1.0], [2.85, 1.01]):
        np.testing.assert_allclose(made.subgoals([place], 0.6), [[2.8, 1.0]])
    blocked = TimeToGo(np.full((1, 8, len(made.y), len(made.x)), np.inf), made.x, made.y, made.goals, 40.0)
    np.testing.assert_allclose(blocked.subgoals(position, 0.6), made.goals)
    np.testing.assert_allclose(blocked.paths(position)[0], position)


def test_vehicles_have_maps_of_their_own() -> None:
    """Members and worlds together as each alone, learned and not."""
    layouts = [draw("trap", 0), draw("rooms", 0), draw("spiral", 0), draw("trap", 1)]
    goals = np.array([layout.corner(3 - run).mean(0) for run, layout in enumerate(layouts)])
    together = {"oracle": oracle(*layouts), "agent": agent(layouts, 4, 5)}
    for number, (layout, goal) in enumerate(zip(layouts, goals, strict=True)):
        alone = {"oracle": oracle(layout), "agent": agent([layout], 4 + number // 2)}
        for kind, one in alone.items():
            several = TimeToGo.imagine(together[kind], goals).steps[number]
            np.testing.assert_allclose(several, TimeToGo.imagine(one, goal).steps[0], rtol=1e-5, err_msg=kind)


def test_the_map_is_made_once_for_each_goal() -> None:
    """The state keeps it; without a guide there is none."""
    position, goal = torch.tensor([[0.2, 0.2]]), torch.tensor([[2.8, 1.8]])
    observation = Observation(position, torch.zeros(1, 2), torch.zeros(1, 4, 11, 11, dtype=torch.bool), goal)
    rngs = [np.random.default_rng(0)]
    made = oracle(EMPTY)
    states = [made.initial(1)]
    for one in (observation, observation, observation._replace(goal=goal - 1)):
        states.append(made.act(one, states[-1], rngs)[1])
    maps = [state.time_to_go for state in states]
    assert maps[0] is None and maps[1] is maps[2] is not None and maps[3] is not maps[2]
    greedy = oracle(EMPTY, guide="none")
    assert greedy.act(observation, greedy.initial(1), rngs)[1].time_to_go is None


@pytest.mark.parametrize("name", RULES)
def test_an_oracle_with_a_map_leaves_where_a_greedy_one_stays(name: str) -> None:
    """Four runs, from all corners, each in its own world."""
    layouts, successes = [draw(name, run) for run in range(4)], {}
    for guide in ("none", "time_to_go"):
        made = oracle(*layouts, guide=guide)
        successes[guide] = control(made, layouts, VEHICLE, made.settings, [3]).table["success"].mean()
    assert successes["time_to_go"] == 1.0 and successes["none"] <= 0.25


def test_goals_and_spacings_that_are_none_are_named() -> None:
    """One clear sentence each."""
    with pytest.raises(ConfigError, match=r"goals has the shape \[3\]; give one for all, \[2\]"):
        TimeToGo.imagine(oracle(EMPTY), [1, 2, 3])
    with pytest.raises(ConfigError, match=r"goals has the shape \[3, 2\]; .* for each of 2 members"):
        TimeToGo.imagine(agent([EMPTY], 4, 5), np.ones((3, 2)))
    with pytest.raises(ConfigError, match=r"goals: \[3.5, 1.0\] is outside the arena \[3.0, 2.0\]"):
        TimeToGo.imagine(oracle(EMPTY), [3.5, 1.0])
    with pytest.raises(ConfigError, match=r"guide_spacing = 2.0 leaves no node between borders 2 u apart"):
        TimeToGo.imagine(oracle(EMPTY, guide_spacing=2.0), [1.0, 1.0])


def test_positions_of_paths_are_checked_as_goals_are() -> None:
    """One for all is one for each."""
    made = TimeToGo.imagine(oracle(EMPTY), [[2.5, 1.5], [2.0, 1.0]])
    for one, each in zip(made.paths([0.3, 0.4]), made.paths([[0.3, 0.4]] * 2), strict=True):
        np.testing.assert_array_equal(one, each)
    with pytest.raises(ConfigError, match=r"positions: \[9.0, 9.0\] is outside the arena \[3.0, 2.0\] \(u\)"):
        made.paths([[9, 9], [1, 1]])
    with pytest.raises(ConfigError, match=r"positions has the shape \[3, 2\]; .* one for each of 2 goals"):
        made.paths([[1, 1]] * 3)
    for give in (made.paths, lambda given: TimeToGo.imagine(oracle(EMPTY), given)):
        with pytest.raises(ConfigError, match="'a' is not allowed; give points, such as"):
            give("a")


def test_it_says_its_size() -> None:
    assert repr(affmap.TimeToGo.imagine(oracle(EMPTY), [1, 1])) == "TimeToGo(1 x 29 x 19 nodes 0.1 u apart)"


def with_a_key(at: int) -> TimeToGo:
    """Eight nodes in a row, 0.1 u and two steps apart; a door on two of them; the goal, beyond the last one; a key."""
    opened = np.full((1, 8, 1, 8), np.inf)
    opened[:, [0, 4]] = 2.0  # to the right and to the left
    closed = opened.copy()
    closed[:, 0, :, 2:5] = closed[:, 4, :, 3:6] = np.inf
    x, y, goal = np.arange(1, 9) / 10, np.array([0.1]), np.array([[0.89, 0.1]])
    keys = np.zeros((1, 1, 8), bool)
    keys[..., at] = True
    return TimeToGo(closed, x, y, goal, 25.0, TimeToGo(opened, x, y, goal, 25.0), keys)


OPEN = np.array([True])
NONE = [np.inf] * 5


def test_ways_lead_over_the_key_and_back() -> None:
    """By hand: to the first node, and from there through the door. Once it is open, straight on."""
    made = with_a_key(0)
    assert made.opened is not None
    np.testing.assert_allclose(made.opened.steps[0, 0], [14, 12, 10, 8, 6, 4, 2, 0])
    np.testing.assert_allclose(made.steps[0, 0], [14, 16, 18, np.inf, np.inf, 4, 2, 0])
    (path,), (straight,) = made.paths([[0.3, 0.1]]), made.paths([[0.3, 0.1]], OPEN)
    on = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.89]
    np.testing.assert_allclose(path[:, 0], [0.3, 0.3, 0.2, 0.1, 0.1, 0.2, *on])
    np.testing.assert_allclose(straight[:, 0], [0.3, *on])
    assert made.clear().mask.tolist() == [[False, False, False, True, True, False, False, False]]


def test_a_key_is_a_sub_goal_until_it_is_visited() -> None:
    """By hand: two nodes back to the key, however far ahead the sub-goal would be; then ahead to the goal."""
    made = with_a_key(0)
    for distance, expected in ((0.1, 0.2), (0.15, 0.15), (0.2, 0.1), (0.9, 0.1)):
        np.testing.assert_allclose(made.subgoals([[0.3, 0.1]], distance), [[expected, 0.1]])
        ahead = made.subgoals([[0.3, 0.1]], distance, OPEN)
        np.testing.assert_allclose(ahead, [[min(0.3 + distance, 0.89), 0.1]])
    np.testing.assert_allclose(made.subgoals([[0.6, 0.1]], 0.1), [[0.7, 0.1]], err_msg="the goal is on this side")


def test_a_key_out_of_reach_opens_nothing() -> None:
    """Behind the door: no way from before it; and no detour where the goal is on this side."""
    made = with_a_key(6)
    np.testing.assert_allclose(made.steps[0, 0], [*NONE, 4, 2, 0])
    np.testing.assert_allclose(made.paths([[0.2, 0.1]])[0], [[0.2, 0.1]])
    np.testing.assert_allclose(made.subgoals([[0.2, 0.1]], 0.3), made.goals)


def test_no_way_begins_inside_a_wall() -> None:
    """From the fourth of the nodes, from where alone a way out is imagined, at great cost; in fog each has such one."""
    costs = np.full((1, 8, 1, 8), np.inf)
    costs[:, 0, :, 3:] = [40, 2, 2, 2, 2]
    x, y, goal = np.arange(1, 9) / 10, np.array([0.1]), np.array([[0.89, 0.1]])
    wall = TimeToGo(costs, x, y, goal, 25.0)
    for position in ([0.31, 0.1], [0.34, 0.1]):
        np.testing.assert_allclose(wall.paths(position)[0], [position])
    np.testing.assert_allclose(wall.paths([0.47, 0.1])[0][:, 0], [0.47, 0.5, 0.6, 0.7, 0.8, 0.89], err_msg="behind it")
    costs[:, 0, :, :4] = [2, 40, 40, 40]
    fog = TimeToGo(costs, x, y, goal, 25.0)
    assert fog.clear().mask[0, 1:4].all() and len(fog.paths([0.31, 0.1])[0]) > 5


def test_a_key_at_the_goal_costs_nothing_more() -> None:
    """An edge of no length: its node is a goal of both layers."""
    np.testing.assert_allclose(with_a_key(7).steps[0, 0], [*NONE, 4, 2, 0])


def test_layouts_without_doors_have_one_layer() -> None:
    """Also beside layouts with doors, where both of its layers are the same."""
    assert TimeToGo.imagine(oracle(EMPTY), [1.0, 1.0]).opened is None
    trap, doors = draw("trap", 0), draw("doors", 0)
    goals = np.array([trap.corner(3).mean(0), doors.corner(3).mean(0)])
    made = TimeToGo.imagine(oracle(trap, doors), goals)
    assert made.opened is not None
    np.testing.assert_array_equal(made.steps[0], made.opened.steps[0])
    np.testing.assert_array_equal(made.steps[0], TimeToGo.imagine(oracle(trap), goals[0]).steps[0])
    nodes = np.stack(np.meshgrid(made.x, made.y), -1)
    free = (surface_distance(nodes, doors) > VEHICLE.radius) & np.isfinite(made.opened.steps[1])
    detour = made.steps[1][free] - made.opened.steps[1][free]
    assert detour.min() > -1e-9 and detour.max() > 10
