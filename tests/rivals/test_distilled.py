"""Distillation by DAgger."""

import io

import numpy as np
import pytest
import torch

from affmap.control.agent import Agent
from affmap.control.controller import Observation
from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.model.lookup import ExactLookup
from affmap.model.settings import ModelSettings
from affmap.model.stack import Stack
from affmap.planning import CEMPlanner
from affmap.random import generator, integer
from affmap.rivals.distilled import Distiller
from affmap.rivals.flights import task
from affmap.rivals.policy import state_of
from affmap.rivals.settings import Distillation

VEHICLE = Vehicle.load("vehicle", "default")
SMALL = Distillation.load(
    "rival", "distilled", hidden_sizes=[5], view_units=2, rounds=3, updates=3, batch_size=8, flights=2, num_steps=6
)
PLANNER = CEMPlanner(horizon=4, num_candidates=8, num_elites=2, num_kept=1, num_iterations=2)


def agent(seeds: list[int], world: Layout) -> Agent:
    stack = Stack(ModelSettings.load("model", "default", context_size=2), 1, seeds)
    return Agent(stack, ExactLookup(stack, [world.map]), PLANNER, ControlSettings.load("control", "default"))


def distiller(seeds: list[int], world: Layout) -> Distiller:
    return Distiller(SMALL, seeds, agent(seeds, world), [world], VEHICLE)


@pytest.mark.parametrize("number", [0, 1])
def test_examples_are_the_plans_of_the_agent_where_the_pilot_flies(world: Layout, number: int) -> None:
    """A flight by hand with the same random streams: of the agent in the first round, of the policy in the second."""
    own, teacher = distiller([5], world), agent([5], world)
    own.round()
    if number:
        own.prepare()
    keys = [(5, number, flight) for flight in range(2)]
    envs = [VehicleEnv(world, VEHICLE) for _ in keys]
    tasks = [task(world, VEHICLE, generator(key[0], "task of a policy", *key[1:])) for key in keys]
    seeds = [integer(key[0], "flight of a policy", *key[1:]) for key in keys]
    sensed = [env.reset(seed=seed, options=each)[0] for env, seed, each in zip(envs, seeds, tasks, strict=True)]
    generators = [generator(key[0], "planner of a policy", *key[1:]) for key in keys]
    state, examples = teacher.initial(2), own._examples[number]
    for step in range(6):
        seen = Observation.of(sensed)
        decision, state = teacher.act(seen, state, generators)
        for flight in range(2):
            row = 6 * flight + step
            torch.testing.assert_close(examples.state[0, row], state_of(seen)[flight])
            assert torch.equal(examples.pixels[0, row], seen.view[flight].flatten())
            torch.testing.assert_close(examples.action[0, row], decision.action[flight])
        with torch.no_grad():
            action = own.network.act(seen) if number else decision.action
        sensed = [env.step(each)[0] for env, each in zip(envs, action.numpy(), strict=True)]


def test_all_rounds_are_drawn_from() -> None:
    """Every step of every round of the own member, and no other; counted."""
    world = Layout.load("layout", "original")
    own = distiller([5, 6], world)
    own.prepare()
    own.num_rounds = 1
    own.prepare()
    rows = [tuple(row) for each in own._examples for row in each.state[1].tolist()]
    drawn = own.draw(1, 2000, np.random.default_rng(0))
    assert {tuple(row) for row in drawn.state.tolist()} == {*rows}


def test_a_member_learns_as_it_would_alone(world: Layout) -> None:
    """Two members, and each by itself, for two rounds."""
    both = distiller([4, 7], world)
    alone = [distiller([seed], world) for seed in (4, 7)]
    for each in (both, *alone):
        each.round()
        each.round()
    for member, own in enumerate(alone):
        for one, other in zip(both.network.parameters(), own.network.parameters(), strict=True):
            torch.testing.assert_close(one[member], other[0])


def test_it_goes_on_from_a_checkpoint_as_if_nothing_had_happened(world: Layout) -> None:
    """Three rounds without interruption; the checkpoint is read without unpickling."""
    undisturbed, stopped, resumed = (distiller([1, 2], world) for _ in range(3))
    for each in (undisturbed, undisturbed, stopped, stopped):
        each.round()
    file = io.BytesIO()
    torch.save(stopped.state(), file)
    file.seek(0)
    resumed.load(torch.load(file, weights_only=True))
    for each in (undisturbed, resumed):
        each.round()
    assert all(map(torch.equal, undisturbed.network.parameters(), resumed.network.parameters()))
