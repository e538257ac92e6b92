"""Many vehicles in one process against Gymnasium's own vector of environments made one by one."""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from rollouts import actions

from affmap.env import VehicleEnv
from affmap.env.layout import Layout
from affmap.env.vector import VehicleVectorEnv

pytestmark = pytest.mark.usefixtures("loops")
NUM_ENVS = 3


def make(mode: str | None, name: str = "affmap/Vehicle-v0", **arguments: Any) -> VectorEnv:
    return gymnasium.make_vec(name, num_envs=NUM_ENVS, vectorization_mode=mode, **arguments)


def flight(envs: VectorEnv, num_steps: int, seed: Any, **options: Any) -> list[tuple[Any, ...]]:
    """All results of a reset and of steps, each environment with actions of its own."""
    rng = np.random.default_rng(0)
    steps: list[tuple[Any, ...]] = [envs.reset(seed=seed, options=options or None)]
    for action in actions(num_steps):
        steps.append(envs.step(rng.permuted(np.tile(action, (NUM_ENVS, 1)), axis=1)))
    return steps


def assert_equal(actual: Any, expected: Any) -> None:
    """Bit for bit, in the same types and shapes."""
    if isinstance(expected, dict):
        assert actual.keys() == expected.keys()
        for key in expected:
            assert_equal(actual[key], expected[key])
    else:
        assert type(actual) is type(expected) and actual.dtype == expected.dtype
        np.testing.assert_array_equal(actual, expected)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("affmap/Vehicle-v0", {}),
        ("affmap/Vehicle-v0", {"layout": "four_properties", "views": False, "goal_radius": 1.0}),
        ("affmap/Fog-v0", {}),
        ("affmap/ProceduralEasy-v0", {}),
    ],
)
@pytest.mark.parametrize("seed", [11, [5, 3, 8]])
def test_it_returns_all_that_gymnasium_s_own_vector_does(name: str, arguments: dict[str, Any], seed: Any) -> None:
    """Gymnasium's own: episodes of 7 steps, of which two end and are begun anew; worlds that are drawn are others."""
    own, reference = (make(mode, name, max_episode_steps=7, **arguments) for mode in (None, "sync"))
    assert isinstance(own, VehicleVectorEnv) and own.metadata == reference.metadata
    assert own.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    for space in ("observation_space", "single_observation_space", "action_space", "single_action_space"):
        assert getattr(own, space) == getattr(reference, space)
    own_steps, expected = flight(own, 20, seed), flight(reference, 20, seed)
    assert [bool(step[3].any()) for step in expected[1:]].count(True) == 2
    for one, other in zip(own_steps, expected, strict=True):
        assert own.observation_space.contains(one[0])
        for mine, its in zip(one, other, strict=True):
            assert_equal(mine, its)
    assert own.get_attr("goal_radius") == reference.get_attr("goal_radius")
    own.close()


def test_options_are_everybody_s() -> None:
    """Gymnasium's own."""
    options = {"position": [2.0, 1.0], "goal": [2.5, 1.0]}
    actual, expected = (flight(make(mode), 3, 0, **options) for mode in (None, "sync"))
    for one, other in zip(actual, expected, strict=True):
        for mine, its in zip(one, other, strict=True):
            assert_equal(mine, its)
    np.testing.assert_array_equal(actual[0][1]["position"], [[2.0, 1.0]] * NUM_ENVS)


def test_a_reset_begins_whole_episodes() -> None:
    """By hand: after a reset in the middle of an episode of 7 steps, the seventh step is the last one."""
    envs = make(None, max_episode_steps=7)
    for _ in range(2):
        assert [bool(step[3].all()) for step in flight(envs, 4, 0)[1:]] == [False] * 4
    assert [bool(step[3].all()) for step in flight(envs, 7, 0)[1:]] == [False] * 6 + [True]


@pytest.mark.parametrize("limit", [None, -1])
def test_without_a_limit_no_episode_ends(limit: int | None) -> None:
    envs = VehicleVectorEnv(NUM_ENVS, limit)
    assert not any(step[3].any() for step in flight(envs, 230, 0)[1:])


def test_a_copy_in_flight_flies_on_to_the_same_bits() -> None:
    """Copies and pickles, in fog, beyond the end of an episode; the original afterwards."""
    envs = make(None, "affmap/Fog-v0", max_episode_steps=7)
    flight(envs, 4, 3)
    copies = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs)), envs]
    flown = [[one.step(np.full((NUM_ENVS, 4), throttle)) for throttle in np.linspace(0, 1, 9)] for one in copies]
    for other in flown[:2]:
        for mine, its in zip(other, flown[2], strict=True):
            for one, expected in zip(mine, its, strict=True):
                assert_equal(one, expected)


def test_mistakes_are_named() -> None:
    """Golden parts of messages."""
    envs = VehicleVectorEnv(NUM_ENVS)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros((NUM_ENVS, 4)))
    with pytest.raises(ValueError, match="there are 2 seeds; give one, or 3"):
        envs.reset(seed=[1, 2])
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="give four numbers"):
        envs.step(np.full((NUM_ENVS, 4), 2.0))
    with pytest.raises(ValueError, match="shorter than"):
        envs.step(np.zeros((2, 4)))


def test_a_step_without_its_view_is_the_same_step() -> None:
    """`step`, from the same place."""
    seeing, other = VehicleEnv(), VehicleEnv()
    for env in (seeing, other):
        env.reset(seed=3)
    (seen, *rest), (felt, *others) = seeing.step(np.full(4, 0.3)), other.advance(np.full(4, 0.3))
    assert set(seen) - set(felt) == {"view"} and str(rest) == str(others)


def test_doors_open_for_each_vehicle_by_itself() -> None:
    """Views after one of them was at the key, against Gymnasium's own vector."""
    layout = Layout.load("layout", "training_doors")
    flights = []
    for mode in (None, "sync"):
        envs = make(mode, layout=layout)
        envs.reset(seed=0, options={"position": [1.6, 1.0]})
        push = np.zeros((NUM_ENVS, 4))
        push[0] = [1, 0, 0, 1]
        flights.append([envs.step(push) for _ in range(6)])
        inner = [env.unwrapped for env in envs.envs]
        assert [env.layout == layout.opened for env in inner] == [True, False, False]
    for own, expected in zip(*flights, strict=True):
        for part, reference in zip(own, expected, strict=True):
            assert_equal(part, reference)
