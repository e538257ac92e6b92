"""Behaviour cloning: policies that imitate random exploration, whose goals are chosen in hindsight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from affmap.rivals.hindsight import Hindsight
from affmap.rivals.imitation import Examples, Imitator
from affmap.rivals.policy import pixels_of, state_of
from affmap.rivals.settings import Cloning


class Cloner(Imitator):
    """M policies that learn from the same data set; they differ in initial weights and in the order of examples."""

    def __init__(self, settings: Cloning, seeds: Sequence[int], data: Mapping[str, np.ndarray]) -> None:
        """Take the arrays of `affmap.data.collect.collect`, or some of their sequences."""
        super().__init__(settings, seeds, data["view"].shape[2])
        self._max_delay, self._data = settings.max_delay, Hindsight(data)

    def prepare(self) -> None:
        """Collect nothing: the data are there."""

    def draw(self, member: int, number: int, rng: np.random.Generator) -> Examples:
        """Draw steps, and for each a later moment, whose position is its goal."""
        return self.examples(*self._data.draw(number, self._data.num_steps, self._max_delay, rng))

    def examples(self, sequence: np.ndarray, step: np.ndarray, later: np.ndarray) -> Examples:
        """Steps of sequences, with the positions at later moments as goals."""
        observation = self._data.observation(sequence, step, self._data.position[sequence, later])
        return Examples(state_of(observation), pixels_of(observation), self._data.action[sequence, step])
