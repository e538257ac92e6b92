"""One agent, step by step: against the same agent among many runs at once."""

from typing import Any

import gymnasium
import numpy as np
import pytest

import affmap
from affmap.control.episodes import control
from affmap.control.oracle import Oracle
from affmap.control.pilot import Pilot
from affmap.env.body import Vehicle
from affmap.random import integer

LAYOUT = affmap.Layout.load("layout", "two_obstacles")


@pytest.mark.parametrize("planner", ["cem", "gradient"])
def test_a_pilot_flies_as_an_agent_among_others(planner: str) -> None:
    """`control` with the same seeds: actions and expected paths, through Gymnasium's own interface."""
    agent = affmap.load("exp1", members=(4,), planner=planner)
    settings = agent.settings.model_copy(update={"num_steps": 12})
    runs = control(agent.elsewhere([LAYOUT.map]), [LAYOUT], Vehicle.load("vehicle", "default"), settings, agent.seeds)
    env = gymnasium.make("affmap/Vehicle-v0", layout=LAYOUT)
    observation, _ = env.reset(seed=integer(4, "start and goal", 0), options={"corner": 0})
    pilot = Pilot(agent, LAYOUT, seed=4)
    for step in range(12):
        action = pilot(observation)
        np.testing.assert_allclose(action, runs.trajectories["action"][0, step], atol=1e-4)
        thought = pilot.thought
        np.testing.assert_allclose(thought.path, runs.trajectories["planned_position"][0, step], atol=1e-3)
        np.testing.assert_allclose(thought.std, runs.trajectories["planned_std"][0, step], rtol=1e-2)
        observation, *_ = env.step(action)


def test_the_candidates_are_those_of_the_last_iteration() -> None:
    """50 drawn and 2 kept; the best of them is the plan."""
    agent = affmap.load("exp1")
    env = affmap.VehicleEnv(LAYOUT)
    observation, _ = env.reset(seed=0)
    pilot = Pilot(agent, LAYOUT)
    with pytest.raises(ValueError, match="has not acted yet"):
        _ = pilot.thought
    pilot(observation)
    thought = pilot.thought
    assert thought.candidates.shape == (52, agent.planner.horizon, 2) and thought.costs.shape == (52,)
    np.testing.assert_allclose(thought.candidates[thought.costs.argmin()], thought.path, atol=1e-5)


def test_a_pilot_that_is_reset_flies_as_a_new_one() -> None:
    agent, env = affmap.load("exp1", planner="cem"), affmap.VehicleEnv(LAYOUT)
    observation, _ = env.reset(seed=0)
    pilot = Pilot(agent, LAYOUT)
    first = pilot(observation)
    assert not np.array_equal(pilot(observation), first)
    pilot.reset()
    np.testing.assert_array_equal(pilot(observation), first)


def test_considering_changes_nothing() -> None:
    """The next action's expected path is the one that was considered, but for the candidates that are drawn anew."""
    agent, env = affmap.load("exp1", planner="gradient"), affmap.VehicleEnv(LAYOUT)
    observation, _ = env.reset(seed=0)
    pilot = Pilot(agent, "two_obstacles")
    considered = [pilot.consider(observation).path for _ in range(2)]
    pilot(observation)
    np.testing.assert_array_equal(considered, [pilot.thought.path] * 2)


def test_a_pilot_is_one_member_and_sees_its_world() -> None:
    with pytest.raises(ValueError, match=r"this agent has \[0, 1\]"):
        Pilot(affmap.load("exp1", members=(0, 1)), LAYOUT)
    with pytest.raises(ValueError, match=r"the agent was trained with .*force_down"):
        Pilot(affmap.load("exp5"), LAYOUT)


def test_what_is_no_observation_of_one_vehicle_is_told() -> None:
    """Golden sentences; the state of the pilot stays as it was."""
    env, pilot, other = affmap.VehicleEnv(LAYOUT), *(Pilot(affmap.load("exp1"), LAYOUT) for _ in range(2))
    good, info = env.reset(seed=0)
    both = gymnasium.make_vec("affmap/Vehicle-v0", num_envs=3, layout=LAYOUT).reset(seed=0)[0]
    bad: list[tuple[Any, str]] = [
        (both, "the observation's position has the shape [3, 2]"),
        ({key: value for key, value in good.items() if key != "delta"}, "the observation has no delta"),
        (None, "the observation is None"),
        (good | {"position": [np.nan, 1.0]}, "the observation's position is [nan, 1.0]"),
        (good | {"goal": [1.0, -np.inf]}, "the observation's goal is [1.0, -inf]"),
        (good | {"goal": [1.0, 1e300]}, "the observation's goal is [1.0, 1e+300]"),
        (good | {"goal": ["1", "2"]}, "the observation's goal is ['1', '2']"),
        (good | {"goal": [1.0, 1j]}, "the observation's goal is [(1+0j), 1j]"),
        (good | {"delta": None}, "the observation's delta has the shape []"),
        (good | {"delta": [[1.0], [1.0, 2.0]]}, "the observation's delta is [[1.0], [1.0, 2.0]]"),
        (good | {"view": good["view"][0]}, "the observation's view has the shape [11, 11]"),
    ]
    expected = "position [2], delta [2], goal [2], view [1, 11, 11]"
    for observation, fault in bad:
        for call in (pilot, pilot.consider):
            with pytest.raises(ValueError, match="give a dictionary") as caught:
                call(observation)
            assert str(caught.value) == f"{fault}; give a dictionary of finite numbers for one vehicle: {expected}."
    with pytest.raises(ValueError, match=r"^the observation is \({'position': .*; give a dictionary"):
        pilot((good, info))  # type: ignore[arg-type]
    np.testing.assert_array_equal(pilot(good), other(good))


def test_a_pilot_goes_through_the_door_that_it_has_opened() -> None:
    """An oracle with a map of times to go: first to the key, then to the goal; its map is that of the present world."""
    layout = affmap.Layout.load("layout", "training_doors")
    settings = affmap.ControlSettings(guide="time_to_go")
    vehicle = Vehicle.load("vehicle", "default")
    pilot = Pilot(Oracle([layout], vehicle, affmap.CEMPlanner(), settings), layout)
    env = gymnasium.make("affmap/Vehicle-v0", layout=layout).unwrapped
    observation, _ = env.reset(seed=0, options={"position": [2.1, 1.0], "goal": [2.25, 1.5]})
    maps = []
    for _ in range(30):
        observation, *_, info = env.step(pilot(observation))
        maps.append(pilot.time_to_go)
        assert np.isfinite(pilot.thought.candidates).all()
    assert info["reached"], "the goal is inside a door"
    assert maps[0] is not None and maps[0].opened is maps[-1]
