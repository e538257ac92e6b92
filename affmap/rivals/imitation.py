"""Policies that learn actions by regression, M of them side by side: what all have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from affmap.random import generator, integer
from affmap.rivals.policy import Network, throttles
from affmap.rivals.settings import Imitation


class Examples(NamedTuple):
    """N examples of each of M members."""

    state: Tensor
    """`[M, N, 6]`"""
    pixels: Tensor
    """`[M, N, K x 121]`, bool or numbers."""
    action: Tensor
    """`[M, N, 4]`, throttles in [0, 1]."""


class Imitator(ABC):
    """M policies that learn in rounds.

    A member's weights, examples and batches are drawn from generators of its own seed, and the loss is the sum over
    members, so that each learns as if it were alone.

    Attributes:
        network: the policies, trained in place.
        num_rounds: rounds so far.
    """

    def __init__(self, settings: Imitation, seeds: Sequence[int], num_channels: int) -> None:
        """Draw the weights of the members with these seeds."""
        self._settings, self._seeds = settings, seeds
        generators = [torch.Generator().manual_seed(integer(seed, "weights of a policy")) for seed in seeds]
        self.network = Network.of(settings, generators, num_channels)
        self._optimizer = torch.optim.Adam(self.network.parameters(), settings.learning_rate)
        self.num_rounds = 0

    @property
    def total(self) -> int:
        """Number of rounds of the whole training."""
        return self._settings.rounds

    @abstractmethod
    def prepare(self) -> None:
        """Collect the examples of a round."""

    @abstractmethod
    def draw(self, member: int, number: int, rng: Any) -> Examples:
        """Draw `number` of the examples of a member: an `Examples` without the axis M."""

    def round(self) -> None:
        """Learn for a round."""
        self.prepare()
        settings = self._settings
        for group in self._optimizer.param_groups:
            group["lr"] = settings.learning_rate * settings.decay**self.num_rounds
        rngs = [generator(seed, "examples of a policy", self.num_rounds) for seed in self._seeds]
        for _ in range(settings.updates):
            drawn = [self.draw(member, settings.batch_size, rng) for member, rng in enumerate(rngs)]
            state, pixels, action = (torch.stack(parts) for parts in zip(*drawn, strict=True))
            error = throttles(self.network(state, pixels.to(state.dtype))) - action
            loss = error.square().mean((1, 2)).sum()
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()
        self.num_rounds += 1

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors."""
        return {
            "network": self.network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "num_rounds": self.num_rounds,
        }

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""
        self.network.load_state_dict(state["network"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.num_rounds = state["num_rounds"]
