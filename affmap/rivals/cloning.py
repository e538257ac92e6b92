"""Behaviour cloning: policies that imitate random exploration, whose goals are chosen in hindsight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from affmap.control.controller import Observation
from affmap.rivals.imitation import Examples, Imitator
from affmap.rivals.policy import pixels_of, state_of
from affmap.rivals.settings import Cloning


class Cloner(Imitator):
    """M policies that learn from the same data set; they differ in initial weights and in the order of examples."""

    def __init__(self, settings: Cloning, seeds: Sequence[int], data: Mapping[str, np.ndarray]) -> None:
        """Take the arrays of `affmap.data.collect.collect`, or some of their sequences."""
        super().__init__(settings, seeds, data["view"].shape[2])
        self._max_delay = settings.max_delay
        self._position, self._action = (torch.from_numpy(data[key]) for key in ("position", "action"))
        self._view = torch.from_numpy(data["view"])
        self._delta = torch.diff(self._position, dim=1, prepend=self._position[:, :1])

    def prepare(self) -> None:
        """Collect nothing: the data are there."""

    def draw(self, member: int, number: int, rng: np.random.Generator) -> Examples:
        """Draw steps, and for each a later moment, whose position is its goal."""
        num_sequences, num_steps = self._action.shape[:2]
        sequence, step = rng.integers(num_sequences, size=number), rng.integers(num_steps, size=number)
        delay = 1 + rng.integers(np.minimum(self._max_delay, num_steps - step))
        return self.examples(sequence, step, step + delay)

    def examples(self, sequence: np.ndarray, step: np.ndarray, later: np.ndarray) -> Examples:
        """Steps of sequences, with the positions at later moments as goals."""
        now = torch.from_numpy(sequence), torch.from_numpy(step)
        goal = self._position[now[0], torch.from_numpy(later)]
        observation = Observation(self._position[now], self._delta[now], self._view[now], goal)
        return Examples(state_of(observation), pixels_of(observation), self._action[now])
