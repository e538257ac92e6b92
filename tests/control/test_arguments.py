"""Arguments of flights: against what was asked for, `control` with the same numbers, and a vehicle told by hand."""

from typing import Any

import numpy as np
import pytest

import affmap
from affmap.control.agent import Agent
from affmap.control.episodes import bring, control
from affmap.control.oracle import Oracle
from affmap.env.vehicle import VehicleEnv
from affmap.settings import ConfigError

MEMBERS, T = (3, 5), 3
LAYOUT = affmap.Layout.load("layout", "original")
STRONG = affmap.Vehicle.load("vehicle", "default", thrust=2 * affmap.Vehicle.load("vehicle", "default").thrust)


@pytest.fixture(scope="module")
def agent() -> Agent:
    return affmap.load("exp1", context_size=1, members=MEMBERS)


@pytest.fixture
def strong(agent: Agent) -> Agent:
    """The agent as if it had been trained in another vehicle."""
    return Agent(agent.stack, agent.lookup, agent.planner, agent.settings, agent.channels, STRONG)


def same(one: affmap.control.Runs, other: affmap.control.Runs) -> bool:
    return all(np.array_equal(one.trajectories[key], other.trajectories[key], equal_nan=True) for key in ONE)


ONE = ("position", "goal", "action", "planned_position", "planned_std", "prediction_error", "member", "run")


def test_steps_and_runs_are_those_asked_for(agent: Agent) -> None:
    """The first runs and steps of a longer flight: members and runs do not depend on each other, to rounding."""
    longer = affmap.fly(agent, LAYOUT, steps=T + 2).trajectories
    runs = affmap.fly(agent, LAYOUT, steps=T, runs=1)
    assert runs.trajectories["action"].shape == (2, T, 4) and list(runs.table["member"]) == [*MEMBERS]
    np.testing.assert_allclose(runs.trajectories["position"], longer["position"][[0, 4], : T + 1], atol=1e-5)
    assert agent.settings.num_steps == 200


def test_an_agent_whose_settings_were_read_flies_the_same(agent: Agent) -> None:
    """Plain values are kept with the settings, and are none of their keys."""
    before = affmap.fly(agent, LAYOUT, steps=1)
    assert agent.settings.plain["beta"] == 1
    assert same(affmap.fly(agent, LAYOUT, steps=1), before)


def test_without_arguments_it_is_the_flight_of_control(agent: Agent) -> None:
    """The runs of reports, bit for bit; and seed 0 gives the same."""
    settings = agent.settings.model_copy(update={"num_steps": T})
    expected = control(bring(agent, LAYOUT), [LAYOUT], affmap.Vehicle.load("vehicle", "default"), settings, MEMBERS)
    assert same(affmap.fly(agent, LAYOUT, steps=T), expected)
    assert same(affmap.fly(agent, LAYOUT, steps=T, seed=0), expected)


def test_another_seed_gives_other_runs_from_the_same_corners(agent: Agent) -> None:
    first, *others = (affmap.fly(agent, LAYOUT, steps=T, seed=seed).trajectories for seed in (0, 1, 1, 2))
    for other in others:
        assert (
            not np.isclose(other["goal"], first["goal"]).any()
            and not np.isclose(other["action"], first["action"]).all((1, 2)).any()
        )
        assert (abs(other["position"][:, 0] - first["position"][:, 0]) < 0.2).all()
    np.testing.assert_array_equal(others[0]["position"], others[1]["position"])
    assert not np.isclose(others[1]["goal"], others[2]["goal"]).any()


@pytest.mark.parametrize(
    ("starts", "goals", "expected_starts", "expected_goals"),
    [
        ([0.2, 1.0], [[2.8, 1.0], [1.5, 1.0]], [[0.2, 1.0]] * 4, [[2.8, 1.0], [1.5, 1.0]] * 2),
        (
            np.array([[0.2, 1.0], [0.3, 1.0], [0.4, 1.0], [0.5, 1.0]]),
            None,
            [[0.2, 1.0], [0.3, 1.0], [0.4, 1.0], [0.5, 1.0]] * 2,
            None,
        ),
    ],
)
def test_runs_start_and_end_where_they_should(
    agent: Agent, starts: Any, goals: Any, expected_starts: Any, expected_goals: Any
) -> None:
    """Member-major; goals that are not given are those of reports."""
    flown = affmap.fly(agent, LAYOUT, steps=1, starts=starts, goals=goals).trajectories
    np.testing.assert_allclose(flown["position"][:, 0], expected_starts)
    default = affmap.fly(agent, LAYOUT, steps=1).trajectories["goal"]
    np.testing.assert_allclose(flown["goal"], default if expected_goals is None else expected_goals)


def test_places_of_all_members_may_be_given_at_once(agent: Agent) -> None:
    starts = [[0.2, 1.0], [0.3, 1.0], [0.4, 1.0], [0.5, 1.0]]
    flown = affmap.fly(agent, LAYOUT, steps=1, runs=2, starts=starts).trajectories
    np.testing.assert_allclose(flown["position"][:, 0], starts)
    assert flown["member"].tolist() == [3, 3, 5, 5]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"steps": 0}, r"^steps = 0 is not allowed; give a whole number, 1 or more\.$"),
        ({"runs": 1.5}, r"^runs = 1.5 is not allowed; give a whole number"),
        ({"seed": -1}, r"^seed = -1 is not allowed; give a whole number, 0 or more\.$"),
        ({"seed": "x"}, r"^seed = 'x' is not allowed"),
        ({"starts": [0.75, 0.5]}, r"^starts: \[0.75, 0.5\] is not allowed; .* of 'original', with room for a vehicle"),
        ({"starts": [[1, 1], [0.05, 1]]}, r"^starts: \[0.05, 1.0\] is not allowed; .* radius 0.06 u\.$"),
        ({"starts": [np.nan, 1]}, r"^starts: \[nan, 1.0\] is not allowed"),
        ({"goals": [[3.1, 1.0]]}, r"^goals: \[3.1, 1.0\] is not allowed; give a point of the arena \[3.0, 2.0\]"),
        ({"goals": [2.25, 1.5]}, r"^goals: \[2.25, 1.5\] is not allowed; .* outside of obstacles\.$"),
        ({"starts": [[1, 1]] * 3, "runs": 2}, r"^starts has the shape \[3, 2\]; .* \[2, 2\], or one for all, \[2\]\.$"),
        ({"starts": [[1, 1, 1]]}, r"^starts has the shape \[1, 3\]"),
        ({"starts": [[1, 1], [1]]}, r"^starts = \[\[1, 1\], \[1\]\] is not allowed; give points"),
        ({"starts": "corner"}, r"^starts = 'corner' is not allowed"),
        ({"starts": []}, r"^starts has the shape \[0\]"),
        ({"steps": 10**7}, r"^flight: num_steps = 10000000 is not allowed"),
        ({"vehicle": "boat"}, r"conf/vehicle/boat.yaml does not exist"),
        ({"vehicle": {"mas": 0.2}}, r"^vehicle: mas = 0.2 is not a known key; did you mean mass\?"),
        ({"vehicle": {"mass": -1}}, r"^vehicle: mass = -1 is not allowed: it should be greater than 0\.$"),
        ({"vehicle": 3}, r"^vehicle = 3 is not allowed: give some of its keys and values, such as \{'radius': 0\.06\}"),
    ],
)
def test_a_mistake_is_told(agent: Agent, arguments: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        affmap.fly(agent, LAYOUT, **arguments)


@pytest.mark.parametrize("given", ["exp1", 3, None, Agent])
def test_something_else_than_an_agent_is_told(given: Any) -> None:
    for use in (lambda: affmap.fly(given, LAYOUT), lambda: affmap.Pilot(given, LAYOUT)):
        with pytest.raises(
            ConfigError, match=r"^agent = .* is not allowed; give an agent, such as affmap\.load\('exp1'\)"
        ):
            use()


@pytest.mark.parametrize("given", ["cem", {"kind": "cem"}, 3, None, affmap.CEMPlanner])
def test_something_else_than_a_planner_is_told(agent: Agent, given: Any) -> None:
    with pytest.raises(
        ConfigError, match=r"^planner = .* is not allowed; .* initial and plan, such as affmap\.CEMPlanner"
    ):
        Agent(agent.stack, agent.lookup, given, agent.settings)


@pytest.mark.parametrize(("method", "missing"), [("initial", "plan"), ("plan", "initial")])
def test_the_method_that_a_planner_lacks_is_named(agent: Agent, method: str, missing: str) -> None:
    given = type("Half", (), {method: print, "horizon": 3})()
    for use in (
        lambda: Agent(agent.stack, agent.lookup, given, agent.settings),
        lambda: affmap.load("exp1", planner=given),
    ):
        with pytest.raises(ConfigError, match=rf"^planner = <.*Half object .*> has no method {missing}; a planner has"):
            use()


def end(vehicle: affmap.Vehicle, flown: dict[str, np.ndarray]) -> np.ndarray:
    """The last positions of recorded actions, flown anew in environments with a vehicle."""
    ends = []
    for start, actions in zip(flown["position"][:, 0], flown["action"], strict=True):
        env = VehicleEnv(LAYOUT, vehicle)
        env.reset(options={"position": start})
        ends.append([env.step(action)[4]["position"] for action in actions][-1])
    return np.array(ends)


def test_an_agent_flies_the_vehicle_that_it_has_learned(strong: Agent) -> None:
    """Its actions, replayed: the strong vehicle ends where it did, that of the paper does not."""
    flown = affmap.fly(strong, LAYOUT, steps=T).trajectories
    np.testing.assert_allclose(end(STRONG, flown), flown["position"][:, -1], atol=1e-5)
    assert (abs(end(affmap.Vehicle.load("vehicle", "default"), flown) - flown["position"][:, -1]).max(1) > 1e-3).all()


def test_another_vehicle_is_warned_of(strong: Agent, agent: Agent) -> None:
    """It flies all the same; the learned one given again is no other; one without knowledge is not warned."""
    default = affmap.Vehicle.load("vehicle", "default")
    told = rf"so its predictions may be wrong: thrust = {default.thrust} instead of {STRONG.thrust}\."
    with pytest.warns(UserWarning, match=told) as warned:
        runs = affmap.fly(strong, LAYOUT, steps=T, vehicle="default")
    assert [each.filename for each in warned] == [__file__]
    assert same(runs, affmap.fly(agent, LAYOUT, steps=T))
    affmap.fly(strong, LAYOUT, steps=1, vehicle=STRONG.plain)
    affmap.fly(Agent(agent.stack, agent.lookup, agent.planner, agent.settings), LAYOUT, steps=1, vehicle=STRONG)


def test_a_vehicle_may_be_given_in_part(agent: Agent) -> None:
    """Missing keys are those of `conf/vehicle/default.yaml`, wherever a vehicle is taken."""
    with pytest.warns(UserWarning, match=rf"wrong: thrust = {STRONG.thrust} instead of"):
        flown = affmap.fly(agent, LAYOUT, steps=T, vehicle={"thrust": STRONG.thrust})
    assert flown.vehicle == STRONG == VehicleEnv(LAYOUT, {"thrust": STRONG.thrust}).vehicle
    assert affmap.fly(agent, LAYOUT, steps=1).vehicle == agent.vehicle


def test_an_oracle_flies_the_vehicle_that_it_knows() -> None:
    """What it predicts of a step is what happens, to rounding."""
    planner = affmap.CEMPlanner.load("planner", "cem", num_candidates=8, num_iterations=1)
    settings = affmap.control.ControlSettings.load("control", "default", num_steps=T)
    flown = affmap.fly(Oracle([LAYOUT], STRONG, planner, settings), LAYOUT).trajectories
    np.testing.assert_allclose(end(STRONG, flown), flown["position"][:, -1], atol=1e-5)


def test_agents_of_reports_know_their_vehicle(agent: Agent) -> None:
    """As the stage's configuration says it."""
    assert agent.vehicle == affmap.Vehicle.load("vehicle", "default")
    assert agent.elsewhere([LAYOUT.map]).vehicle == agent.vehicle
