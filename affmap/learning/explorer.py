"""Explorers: agents that choose the plan from which their committees expect to learn most.

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
from affmap.learning.settings import SeekingLearning
from affmap.model.lookup import Lookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import Stack
from affmap.planning.information import SIGNALS, changes


class Explorer:
    """A committees of K models in one world."""

    def __init__(self, stack: Stack, lookup: Lookup, exploration: Exploration, settings: SeekingLearning) -> None:
        """Take a stack of A * K members (agent-major), a look-up of them, and how plans are drawn and chosen."""
        self._stack, self._lookup = stack, lookup
        self._exploration = exploration.model_copy(update={"num_steps": settings.plan_steps})
        self._settings, self._signal = settings, SIGNALS[settings.kind]
        self._compiled = loops_of(stack, lookup)

    def choose(self, position: Tensor, delta: Tensor, generators: Sequence[np.random.Generator]) -> Tensor:
        """Choose a plan for each of A vehicles, from N that its generator draws.

        Args:
            position: reported positions, `[A, 2]`, u.
            delta: their last changes, `[A, 2]`, u/step.
            generators: A of them.

        Returns:
            Throttles, `[A, H, 4]`.
        """
        drawn = [
            [random_actions(self._exploration, rng) for _ in range(self._settings.num_plans)] for rng in generators
        ]
        plans = torch.from_numpy(np.array(drawn))
        best = self.news(position, delta, plans).argmax(1)
        return plans[torch.arange(len(plans)), best]

    def news(self, position: Tensor, delta: Tensor, plans: Tensor) -> Tensor:
        """The signal that plans `[A, N, H, 4]` promise, its mean over their steps: `[A, N]`."""
        size = len(self._stack.seeds) // len(plans)
        position, delta = (part.repeat_interleave(size, 0) for part in (position, delta))
        situation = Situation(position, delta, self._stack.transition.initial(1))
        with torch.inference_mode():
            path = self._imagine(situation, plans.repeat_interleave(size, 0))
            step = changes(path, position[:, None], self._settings.resolution)
            committees = Gaussian(*(part.unflatten(0, (-1, size)).transpose(0, 1) for part in step))
            return self._signal(committees).mean(-1)

    def _imagine(self, situation: Situation, plans: Tensor) -> Gaussian:
        if self._compiled:
            return self._compiled.positions(situation, plans)
        return rollout(self._stack.transition, self._lookup, situation, plans)
