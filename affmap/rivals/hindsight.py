"""Steps of a data set without goals, for which goals are chosen in hindsight."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from affmap.control.controller import Observation


class Hindsight:
    """Steps of S sequences of T steps, as a policy would have sensed them on the way to a goal.

    Attributes:
        num_sequences: S.
        num_steps: T.
        position: reported positions, `[S, T + 1, 2]`, u.
        action: throttles, `[S, T, 4]`.
    """

    def __init__(self, data: Mapping[str, np.ndarray]) -> None:
        """Take the arrays of `affmap.data.collect.collect`, or some of their sequences."""
        self.num_sequences, self.num_steps = data["action"].shape[:2]
        self.position, self.action = (torch.from_numpy(data[key]) for key in ("position", "action"))
        self._view = torch.from_numpy(data["view"])
        self._delta = torch.diff(self.position, dim=1, prepend=self.position[:, :1])

    def draw(
        self, number: int, num_steps: int, max_delay: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw sequences, steps among the first `num_steps`, and later moments, at most `max_delay` steps away."""
        sequence, step = rng.integers(self.num_sequences, size=number), rng.integers(num_steps, size=number)
        delay = 1 + rng.integers(np.minimum(max_delay, self.num_steps - step))
        return sequence, step, step + delay

    def observation(self, sequence: np.ndarray, step: np.ndarray, goal: Tensor) -> Observation:
        """Sensations before steps, with goals `[N, 2]`."""
        now = torch.from_numpy(sequence), torch.from_numpy(step)
        return Observation(self.position[now], self._delta[now], self._view[now], goal)
