"""Controllers without a model: straight lines in closed form, draws by hand, and one that is written here."""

from collections.abc import Sequence

import gymnasium
import numpy as np
import pandas as pd
import pytest
import torch
from torch import Tensor

import affmap
from affmap.control.agent import ControlSettings, prediction_error
from affmap.control.controller import Controller, Decision, Observation
from affmap.control.episodes import Runs, control, summarise
from affmap.control.random import RandomAgent
from affmap.control.straight import StraightAgent
from affmap.env.body import THROTTLES
from affmap.planning.planner import Generators
from affmap.random import generator
from affmap.settings import ConfigError

EMPTY = affmap.Layout.load("layout", "original", circles=[])
VEHICLE = affmap.Vehicle.load("vehicle", "default")
SETTINGS = ControlSettings.load("control", "default", num_steps=30)
RANDOM, STRAIGHT = RandomAgent.load("agent", "random"), StraightAgent.load("agent", "straight")


class Hover:
    """Remembers how often it was asked, and opens all throttles alike, which cancel out."""

    def initial(self, num_problems: int) -> int:
        return 0

    def act(self, observation: Observation, state: int, generators: Generators) -> tuple[Decision, int]:
        return Decision.without_prediction(torch.full((len(observation.goal), 4), state / 100)), state + 1


def fly(controller: Controller, seeds: Sequence[int] = (4, 5), layout: affmap.Layout = EMPTY) -> Runs:
    return control(controller, [layout], VEHICLE, SETTINGS, seeds)


def seen(position: Tensor, goal: Tensor, delta: Tensor | None = None) -> Observation:
    """Vehicles in front of nothing."""
    still = torch.zeros_like(position)
    return Observation(position, still if delta is None else delta, torch.zeros(len(goal), 1, 11, 11).bool(), goal)


def test_any_object_with_two_methods_is_flown_and_gives_all_tables() -> None:
    """The columns of an agent with a model; actions, and where they lead, by hand."""
    runs = fly(Hover())
    agent = affmap.load("exp1", members=(4, 5))
    flown = control(agent.elsewhere([EMPTY.map]), [EMPTY], VEHICLE, SETTINGS, agent.seeds)
    starts = ["member", "run", "start_x", "start_y", "goal_x", "goal_y"]
    pd.testing.assert_frame_equal(runs.table[starts], flown.table[starts], check_exact=True)
    assert list(runs.table.columns) == list(flown.table.columns) and set(runs.trajectories) == set(flown.trajectories)
    for t in range(SETTINGS.num_steps):
        np.testing.assert_allclose(runs.trajectories["action"][:, t], t / 100, atol=1e-7)
    assert not runs.table["reached"].any() and (runs.table["final_spread"] < 1e-6).all()


def test_who_predicts_nothing_has_no_prediction_error() -> None:
    """NaN in tables and trajectories, and no other column is."""
    runs = fly(Hover())
    assert runs.trajectories["planned_position"].shape == (8, SETTINGS.num_steps, 1, 2)
    for key in ("planned_position", "planned_std", "prediction_error"):
        assert np.isnan(runs.trajectories[key]).all()
    lacking = runs.table.columns[runs.table.isna().any()]
    assert list(lacking) == ["prediction_error", "steps_to_reach"]
    pd.testing.assert_frame_equal(runs.table, summarise(runs.trajectories))
    assert prediction_error(Decision.without_prediction(torch.zeros(3, 4)), torch.zeros(3, 2)).isnan().all()


@pytest.mark.parametrize("controller", [RANDOM, STRAIGHT], ids=lambda controller: controller.kind)
def test_members_together_are_each_alone_and_the_same_again(controller: Controller) -> None:
    """Two members and each alone, bit for bit; another member has other runs."""
    layout = affmap.Layout.load("layout", "original")
    together, again = fly(controller, (4, 5), layout), fly(controller, (4, 5), layout)
    alone = [fly(controller, (seed,), layout) for seed in (4, 5)]
    tables = pd.concat([runs.table for runs in alone], ignore_index=True)
    for table in (tables, again.table):
        pd.testing.assert_frame_equal(together.table, table, check_exact=True)
    for key, values in together.trajectories.items():
        np.testing.assert_array_equal(values, again.trajectories[key])
        np.testing.assert_array_equal(values, np.concatenate([runs.trajectories[key] for runs in alone]))
    assert (together.table["mean_distance"][:4].to_numpy() != together.table["mean_distance"][4:].to_numpy()).all()


def test_random_throttles_are_the_next_draws_of_each_vehicle_s_own_generator() -> None:
    """NumPy's draws, one run after the other; uniform by their moments (2,400 numbers, five standard errors)."""
    runs = fly(RANDOM, range(5))
    for b, (member, run) in enumerate(zip(runs.trajectories["member"], runs.trajectories["run"], strict=True)):
        draws = generator(int(member), "planner", int(run)).random((SETTINGS.num_steps, 4), np.float32)
        np.testing.assert_array_equal(runs.trajectories["action"][b], draws)
    actions = runs.trajectories["action"]
    assert abs(actions.mean() - 1 / 2) < 5 * np.sqrt(1 / 12 / actions.size)
    assert abs((actions**2).mean() - 1 / 3) < 5 * np.sqrt(4 / 45 / actions.size)


def test_the_straight_agent_pushes_exactly_towards_the_goal() -> None:
    """At rest the force of its throttles is along the way: nothing across, at most two neighbours open, one fully."""
    numbers = torch.Generator().manual_seed(0)
    position, goal = (torch.rand(200, 2, generator=numbers) * torch.tensor([3.0, 2.0]) for _ in range(2))
    far = (goal - position).norm(dim=-1) > 2**0.5 * STRAIGHT.slow_distance
    decision, _ = STRAIGHT.act(seen(position, goal), None, [])
    force = decision.action @ torch.from_numpy(THROTTLES).float()
    way = torch.nn.functional.normalize(goal - position, dim=-1)
    assert ((decision.action >= 0) & (decision.action <= 1)).all()
    torch.testing.assert_close(force[:, 0] * way[:, 1], force[:, 1] * way[:, 0], atol=1e-6, rtol=0)
    assert ((force * way).sum(-1) > 0).all()
    assert ((decision.action > 0).sum(-1) <= 2).all() and (decision.action[:, :2] * decision.action[:, 2:] == 0).all()
    assert 50 < far.sum() < 200
    torch.testing.assert_close(decision.action[far].amax(-1), torch.ones(int(far.sum())))


def test_the_straight_agent_slows_down() -> None:
    """By hand: half open at half the distance, closed at the goal, and the opposite ones where it comes too fast."""
    right = STRAIGHT.slow_distance / 2**0.5 * torch.tensor([[1.0, 0.0]])
    goal = torch.tensor([[1.5, 1.0]])
    for way, delta, expected in (
        (right, 0 * right, [0.5, 0.0, 0.0, 0.5]),
        (0 * right, 0 * right, [0.0, 0.0, 0.0, 0.0]),
        (right, 2 * right / STRAIGHT.foresight, [0.0, 0.5, 0.5, 0.0]),
    ):
        decision, _ = STRAIGHT.act(seen(goal - way, goal, delta), None, [])
        torch.testing.assert_close(decision.action, torch.tensor([expected]))


def test_the_straight_agent_flies_straight_to_the_goal_and_stays_there() -> None:
    """The line from start to goal in an arena without obstacles."""
    settings = SETTINGS.model_copy(update={"num_steps": 200})
    runs = control(STRAIGHT, [EMPTY], VEHICLE, settings, range(5))
    position, goal = runs.trajectories["position"], runs.trajectories["goal"]
    way = goal - position[:, 0]
    along = way / np.linalg.norm(way, axis=-1, keepdims=True)
    left = position - position[:, :1]
    across = left[..., 0] * along[:, None, 1] - left[..., 1] * along[:, None, 0]
    assert np.abs(across).max() < 1e-3
    assert runs.table["reached"].all() and (runs.table["steps_touching"] == 0).all()
    assert (np.linalg.norm(position[:, -1] - goal, axis=-1) < 0.01).all()


def test_fly_and_pilot_take_any_controller() -> None:
    """`control` with the seed of member 0, and its first run step by step through Gymnasium's own interface."""
    layout = affmap.Layout.load("layout", "two_obstacles")
    settings = ControlSettings.load("control", "default")
    expected = control(STRAIGHT, [layout], VEHICLE, settings, (0,))
    pd.testing.assert_frame_equal(affmap.fly(STRAIGHT, "two_obstacles").table, expected.table, check_exact=True)
    env = gymnasium.make("affmap/Vehicle-v0", layout=layout)
    options = {"position": expected.trajectories["position"][0, 0], "goal": expected.trajectories["goal"][0]}
    observation, _ = env.reset(seed=0, options=options)
    pilot = affmap.Pilot(STRAIGHT, layout)
    for step in range(20):
        action = pilot(observation)
        np.testing.assert_allclose(action, expected.trajectories["action"][0, step], atol=1e-5)
        observation, *_ = env.step(action)
    assert np.isnan(pilot.thought.path).all() and pilot.thought.candidates.shape == (0, 1, 2)
    assert len(pilot.consider(observation).costs) == 0


def test_a_pilot_with_a_state_begins_anew_when_it_is_reset() -> None:
    """And considering changes nothing."""
    observation, _ = affmap.VehicleEnv("original").reset(seed=0)
    pilot = affmap.Pilot(Hover(), "original")
    actions = [pilot(observation)[0] for _ in range(2)]
    pilot.consider(observation)
    actions.append(pilot(observation)[0])
    pilot.reset()
    actions.append(pilot(observation)[0])
    np.testing.assert_allclose(actions, [0.0, 0.01, 0.02, 0.0], atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"slow_distance": 0.0}, "slow_distance = 0.0 is not allowed"),
        ({"foresight": -1.0}, "foresight = -1.0 is not allowed"),
    ],
)
def test_bad_settings_are_named(changes: dict[str, float], message: str) -> None:
    """Golden parts of the message."""
    with pytest.raises(ConfigError, match=message):
        StraightAgent.load("agent", "straight", **changes)
