"""The agent that keeps track of its place in fog: beliefs against the true places of flights in Box2D."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from affmap.control.agent import Observation
from affmap.control.controller import Decision
from affmap.control.episodes import control
from affmap.control.filter import Filter
from affmap.control.oracle import Oracle
from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.planning.cem import CEMPlanner
from affmap.results.belief import errors, steps_in_fog
from affmap.results.files import Trajectories

BELT = Layout.load("layout", "fog_belt")
PLAIN = BELT.model_copy(update={"circles": tuple(each for each in BELT.circles if each.effect == "fog")})
VEHICLE = Vehicle.load("vehicle", "default")
SETTINGS = ControlSettings.load("control", "default", num_steps=40, runs_per_member=4, reports="noisy")
PLANNER = CEMPlanner.load("planner", "cem")


def flown(layout: Layout, kind: type[Oracle] = Filter, vehicle: Vehicle = VEHICLE) -> Trajectories:
    agent = kind([layout], vehicle, PLANNER, SETTINGS)
    return Trajectories(**control(agent, [layout], vehicle, SETTINGS, [500]).trajectories)


def test_it_knows_where_it_is_and_gets_through() -> None:
    """True places: within 0.01 u in free flight, 0.05 u with walls in fog; the oracle trusts reports and is lost."""
    for layout, most in ((PLAIN, 0.01), (BELT, 0.05)):
        paths = flown(layout)
        assert (steps_in_fog(paths) >= 15).any()
        assert errors(paths).max() < most
        assert paths.reached.any(1).all()
    lost = flown(BELT, Oracle)
    assert errors(lost)[lost.in_fog].mean() > 1 and not lost.reached.any(1).all()


def test_without_noise_it_flies_as_the_oracle() -> None:
    """Paths to rounding: a report without noise is where the filter believes to be."""
    still = VEHICLE.model_copy(update={"fog_std": 0.0})
    clear = BELT.model_copy(update={"circles": tuple(each for each in BELT.circles if each.effect != "fog")})
    ours, theirs = (flown(clear, kind, still).position for kind in (Filter, Oracle))
    np.testing.assert_allclose(ours, theirs, atol=1e-4)


def observed(env: VehicleEnv, actions: int) -> list[tuple[Observation, np.ndarray, np.ndarray]]:
    """Observations of a flight with fixed actions, each with its true place and the next action."""
    rng = np.random.default_rng(0)
    seen, info = env.reset(seed=0, options={"position": [0.3, 1.0]})
    record = []
    for _ in range(actions):
        action = np.clip(np.array([0.6, 0.1, 0.1, 0.6]) + 0.2 * rng.uniform(-1, 1, 4), 0, 1).astype(np.float32)
        record.append((Observation.of([seen]), info["position"], action))
        seen, *_, info = env.step(action)
    return record


def test_beliefs_are_carried_from_step_to_step() -> None:
    """By hand along a flight to the right through fog: the belief before each step is the true place.

    The next report is predicted there, with the noise of fog if that is where the step ends.
    """
    agent, env = Filter([PLAIN], VEHICLE, PLANNER, SETTINGS), VehicleEnv(PLAIN, VEHICLE)
    carry, off, deviations = agent.initial_carry(1), [], []
    for (observation, place, action), (_, after, _) in pairwise(observed(env, 30)):
        believed = agent.believed(observation, carry)
        np.testing.assert_allclose(believed.position[0], place, atol=0.01)
        off.append((observation.position[0] - torch.tensor(place)).norm().item())
        carry, delta = agent.predict(observation, torch.tensor(action)[None], carry)
        np.testing.assert_allclose((observation.position + delta.mean)[0], after, atol=0.01)
        deviations.append(delta.log_std.exp()[0].tolist())
        std = 1.0 if PLAIN.in_fog(after, VEHICLE.radius) else 0.0005
        np.testing.assert_allclose(deviations[-1], [std, std], rtol=1e-4)
    assert max(off) > 1 and min(deviations) < [0.1] < max(deviations)  # reports were of no use, for a while


@pytest.mark.parametrize("shift", [0.03, 0.3])
def test_a_report_corrects_a_wrong_belief_where_it_can_be_trusted(shift: float) -> None:
    """Far outside fog always; in fog never; at the rim (0.4 u from the border), if it is near the belief."""
    agent = Filter([PLAIN], VEHICLE, PLANNER, SETTINGS)
    for x, trusted in ((0.2, True), (1.5, False), (0.41, shift < 0.05)):
        there = torch.tensor([[x, 0.2]])
        report = there + torch.tensor([[0.0, shift]])
        seen = Observation(report, torch.zeros(1, 2), torch.zeros(1, 2, 11, 11, dtype=torch.bool), there)
        believed = agent.believed(seen, (there[None], there[None]))
        torch.testing.assert_close(believed.position, report if trusted else there)


def test_vehicles_together_are_each_alone() -> None:
    """Two of them, one in fog and one outside, against each by itself."""
    agent = Filter([PLAIN], VEHICLE, PLANNER, SETTINGS)
    position = torch.tensor([[0.2, 0.2], [1.5, 1.0]])
    seen = Observation(position, torch.zeros(2, 2), torch.zeros(2, 2, 11, 11, dtype=torch.bool), position.flip(1))
    state = agent.initial(2)._replace(carry=(position[None] + 0.02, position[None]))

    def act(rows: list[int]) -> Decision:
        own = state._replace(
            planner=agent.planner.initial(len(rows), "cpu"), carry=tuple(c[:, rows] for c in state.carry)
        )
        part = Observation(*(each[rows] for each in seen))
        return agent.act(part, own, [np.random.default_rng(row) for row in rows])[0]

    together = act([0, 1])
    for row in (0, 1):
        torch.testing.assert_close(act([row]).action[0], together.action[row])
        torch.testing.assert_close(act([row]).path.mean[0], together.path.mean[row])
    assert repr(agent.elsewhere([BELT])).startswith("Filter(CEMPlanner, 1 world")
