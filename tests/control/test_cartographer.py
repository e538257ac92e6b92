"""Agents that plan with a memorised map, beside agents that look up the same codes in a painted one."""

import numpy as np
import pytest
import torch

from affmap.control.agent import Agent, ControlSettings
from affmap.control.cartographer import Cartographer
from affmap.control.controller import Observation
from affmap.control.episodes import control
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap
from affmap.model.memory import Memory, MemorySettings, PlaceNetwork
from affmap.model.stack import ModelSettings, Stack
from affmap.planning.cem import CEMPlanner
from affmap.view import view

pytestmark = pytest.mark.usefixtures("loops")

LAYOUT, VEHICLE = Layout.load("layout", "original"), Vehicle.load("vehicle", "default")
SEEDS, RUNS, SPACING = (4, 5), 2, 0.25
CONTROL = ControlSettings.load("control", "default", num_steps=5, runs_per_member=RUNS)
KEPT, LEARNING = (MemorySettings.load("memory", name) for name in ("outdated", "repaired"))


def agent(*seeds: int) -> Agent:
    """Untrained, with a map of views."""
    stack = Stack(ModelSettings.load("model", "default", context_size=3), LAYOUT.map.num_channels, seeds)
    planner = CEMPlanner.load("planner", "cem", num_iterations=2)
    return Agent(stack, AffordanceMap.paint(stack, [LAYOUT.map], SPACING), planner, CONTROL)


def weights(settings: MemorySettings) -> Memory:
    """Of the members, drawn at random."""
    network = PlaceNetwork(LAYOUT.size, settings)
    drawn = torch.randn(len(SEEDS), network.num_units, 3, generator=torch.Generator().manual_seed(1))
    return Memory(drawn, torch.eye(network.num_units).repeat(len(SEEDS), 1, 1))


def pilot(settings: MemorySettings) -> Cartographer:
    return Cartographer(agent(*SEEDS), PlaceNetwork(LAYOUT.size, settings), weights(settings))


def observations(seed: int = 0) -> Observation:
    generator = torch.Generator().manual_seed(seed)
    position, goal = (torch.rand(4, 2, generator=generator) * torch.tensor(LAYOUT.size) for _ in range(2))
    return Observation(position, torch.zeros(4, 2), view(LAYOUT.map, position), goal)


def generators() -> list[np.random.Generator]:
    return [np.random.default_rng(number) for number in range(4)]


def test_it_flies_as_an_agent_whose_map_is_painted_with_what_it_remembers() -> None:
    """Flights of two members in a map that stays as it is, against the agent itself with the codes as its map."""
    cartographer = pilot(KEPT)
    codes = cartographer.network.painted(cartographer.memory, SPACING)
    plain = agent(*SEEDS)
    expected = control(plain.looking_up(AffordanceMap(codes, [LAYOUT.map] * 2)), [LAYOUT], VEHICLE, CONTROL, SEEDS)
    found = control(cartographer, [LAYOUT], VEHICLE, CONTROL, SEEDS)
    views = control(plain, [LAYOUT], VEHICLE, CONTROL, SEEDS)
    np.testing.assert_allclose(found.trajectories["position"], expected.trajectories["position"], atol=1e-6)
    assert not np.allclose(views.trajectories["action"], found.trajectories["action"], atol=1e-3)


def test_a_map_that_does_not_learn_stays_as_it_was() -> None:
    """The very same map and memory after a step."""
    cartographer = pilot(KEPT)
    before = cartographer.initial(4)
    _, after = cartographer.act(observations(), before, generators())
    assert after.memory is before.memory and after.lookup is before.lookup


def test_it_learns_the_code_of_the_view_at_the_vehicle_before_it_plans() -> None:
    """Against the encoder and the network; the plan is that of an agent with the new map."""
    cartographer, seen = pilot(LEARNING), observations()
    before = cartographer.initial(4)
    decision, after = cartographer.act(seen, before, generators())
    codes = torch.cat(
        [
            agent(seed).sensed(Observation(*(part[2 * k : 2 * k + 2] for part in seen)))[0]
            for k, seed in enumerate(SEEDS)
        ]
    )
    expected = cartographer.network.learned(before.memory, seen.position, codes)
    torch.testing.assert_close(after.memory.weights, expected.weights)
    torch.testing.assert_close(after.lookup.codes, cartographer.network.painted(expected, SPACING))
    planner = cartographer.agent.looking_up(after.lookup)
    planned, _ = planner.act(seen, cartographer.agent.initial(4), generators())
    torch.testing.assert_close(decision.action, planned.action)
    error = (cartographer.network.recalled(after.memory, seen.position[:, None])[:, 0] - codes).norm(dim=-1)
    assert (
        error < 0.2 * (cartographer.network.recalled(before.memory, seen.position[:, None])[:, 0] - codes).norm(dim=-1)
    ).all()


def test_runs_of_a_member_begin_with_its_own_memory() -> None:
    """Member-major; a memory that has one part for each run is taken as it is."""
    cartographer = pilot(LEARNING)
    state = cartographer.initial(4)
    for run, member in enumerate((0, 0, 1, 1)):
        assert torch.equal(state.memory.weights[run], cartographer.memory.weights[member])
    again = Cartographer(cartographer.agent, cartographer.network, state.memory).initial(4)
    assert torch.equal(again.memory.weights, state.memory.weights)
