"""Distillation by DAgger: policies that imitate the plans of agents, at first where these fly, then where they do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from affmap.control.agent import Agent
from affmap.control.controller import Observation
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.random import generator, integer
from affmap.rivals.flights import task
from affmap.rivals.imitation import Examples, Imitator
from affmap.rivals.policy import state_of
from affmap.rivals.settings import Distillation


class Distiller(Imitator):
    """M policies, each of which learns from the plans of one member of an agent."""

    def __init__(
        self, settings: Distillation, seeds: Sequence[int], agent: Agent, layouts: Sequence[Layout], vehicle: Vehicle
    ) -> None:
        """Take the agents, members with `seeds`, that are imitated.

        Flights are in one of W `layouts` after the other; the look-up of `agent` is for all flights of a round.
        """
        super().__init__(settings, seeds, len(layouts[0].channels))
        self._flights, self._num_steps = settings.flights, settings.num_steps
        self._agent, self._layouts, self._vehicle = agent, layouts, vehicle
        self._examples: list[Examples] = []

    def prepare(self) -> None:
        """Fly a round; the agent flies in the first one, and the policy in all others."""
        new = self._fly()
        self._examples.append(Examples(*(part.unflatten(0, (len(self._seeds), -1)).flatten(1, 2) for part in new)))

    def draw(self, member: int, number: int, rng: np.random.Generator) -> Examples:
        """Draw from the steps of all rounds so far."""
        size = self._examples[0].state.shape[1]
        rounds, steps = np.divmod(rng.integers(len(self._examples) * size, size=number), size)
        parts = [[each[member, steps[rounds == n]] for each in own] for n, own in enumerate(self._examples)]
        return Examples(*(torch.cat(same) for same in zip(*parts, strict=True)))

    @torch.no_grad()
    def _fly(self) -> Examples:
        """The steps of a round: `[B, T, ...]`, B flights member by member."""
        keys = [(seed, self.num_rounds, flight) for seed in self._seeds for flight in range(self._flights)]
        layouts = [self._layouts[flight % len(self._layouts)] for _, _, flight in keys]
        envs = [VehicleEnv(layout, self._vehicle) for layout in layouts]
        rngs = [generator(seed, "task of a policy", *rest) for seed, *rest in keys]
        tasks = [task(layout, self._vehicle, rng) for layout, rng in zip(layouts, rngs, strict=True)]
        sensed = [
            env.reset(seed=integer(seed, "flight of a policy", *rest), options=own)[0]
            for env, (seed, *rest), own in zip(envs, keys, tasks, strict=True)
        ]
        generators = [generator(seed, "planner of a policy", *rest) for seed, *rest in keys]
        state, steps = self._agent.initial(len(envs)), []
        for _ in range(self._num_steps):
            observation = Observation.of(sensed)
            decision, state = self._agent.act(observation, state, generators)
            steps.append(Examples(state_of(observation), observation.view.flatten(1), decision.action))
            action = decision.action if self.num_rounds == 0 else self.network.act(observation)
            sensed = [env.step(each)[0] for env, each in zip(envs, action.numpy(), strict=True)]
        return Examples(*(torch.stack(part, dim=1) for part in zip(*steps, strict=True)))

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors."""
        return {**super().state(), "examples": [tuple(each) for each in self._examples]}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""
        super().load(state)
        self._examples = [Examples(*each) for each in state["examples"]]
