"""Explorers: agents that choose the plan from which their committees expect to learn most, or to get nearest to a goal.

A agents fly side by side, each with a committee of K models. Plans are drawn as random actions are; an agent with one
plan to choose from explores at random, but for actions that are cut short where a plan ends. Knows models and
look-ups, and no environment.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from affmap.control.agent import loops_of
from affmap.data.collect import random_actions
from affmap.data.settings import Exploration
from affmap.gaussian import Gaussian
from affmap.learning.settings import AnyPlanningLearning, GoalLearning
from affmap.model.lookup import Lookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import Stack
from affmap.planning.information import SIGNALS, changes, information
from affmap.planning.objective import expected_free_energy


class Explorer:
    """A committees of K models in one world."""

    def __init__(self, stack: Stack, lookup: Lookup, exploration: Exploration, settings: AnyPlanningLearning) -> None:
        """Take a stack of A * K members (agent-major), a look-up of them, and how plans are drawn and chosen."""
        self._stack, self._lookup = stack, lookup
        self._exploration = exploration.model_copy(update={"num_steps": settings.plan_steps})
        self._settings = settings
        self._compiled = loops_of(stack, lookup)

    def choose(
        self, position: Tensor, delta: Tensor, goal: Tensor | None, generators: Sequence[np.random.Generator]
    ) -> Tensor:
        """Choose a plan for each of A vehicles, from N that its generator draws.

        Args:
            position: reported positions, `[A, 2]`, u.
            delta: their last changes, `[A, 2]`, u/step.
            goal: `[A, 2]`, u; None for agents that have none.
            generators: A of them.

        Returns:
            Throttles, `[A, H, 4]`.
        """
        drawn = [
            [random_actions(self._exploration, rng) for _ in range(self._settings.num_plans)] for rng in generators
        ]
        plans = torch.from_numpy(np.array(drawn))
        best = self.value(position, delta, goal, plans).argmax(1)
        return plans[torch.arange(len(plans)), best]

    def value(self, position: Tensor, delta: Tensor, goal: Tensor | None, plans: Tensor) -> Tensor:
        """The worth of plans `[A, N, H, 4]`, mean over their steps: `[A, N]`.

        It is the signal that they promise. With goals it is the information, weighted, minus the expected free energy,
        mean over models; both are in nats.
        """
        size = len(self._stack.seeds) // len(plans)
        position, delta = (part.repeat_interleave(size, 0) for part in (position, delta))
        situation = Situation(position, delta, self._stack.transition.initial(1))
        with torch.inference_mode():
            path = self._imagine(situation, plans.repeat_interleave(size, 0))
            step = changes(path, position[:, None], self._settings.resolution)
            committees = _apart(step, size)
            if not isinstance(self._settings, GoalLearning):
                return SIGNALS[self._settings.kind](committees).mean(-1)
            assert goal is not None
            std = torch.full((len(goal), 1), self._settings.goal_std)
            cost = expected_free_energy(_apart(path, size), goal[:, None], std, beta=1).total.mean(0)
            return self._settings.information_weight * information(committees).mean(-1) - cost

    def _imagine(self, situation: Situation, plans: Tensor) -> Gaussian:
        if self._compiled:
            return self._compiled.positions(situation, plans)
        return rollout(self._stack.transition, self._lookup, situation, plans)


def _apart(predictions: Gaussian, size: int) -> Gaussian:
    """Predictions `[A * K, ...]` by the models of each committee, `[K, A, ...]`."""
    return Gaussian(*(part.unflatten(0, (-1, size)).transpose(0, 1) for part in predictions))
