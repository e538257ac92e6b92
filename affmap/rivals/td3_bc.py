"""TD3 with behaviour cloning (Fujimoto and Gu 2021): offline reinforcement learning, of M members side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from affmap.model.layers import Generators, StackedLinear
from affmap.random import generator, integer
from affmap.rivals.hindsight import Hindsight
from affmap.rivals.policy import STATE, Network, perceptron, pixels_of, state_of
from affmap.rivals.settings import TD3BC
from affmap.view import PIXELS

DISCOUNT = 0.99
"""Of the next step, the default of Stable-Baselines3; this and the following are the published values."""

RATE = 0.005
"""At which targets follow."""

NOISE, MAX_NOISE = 0.2, 0.5
"""Deviation of the noise on a target's actions, and where it is cut; actions go from -1 to 1."""

DELAY = 2
"""Updates of the critics for one of the policy."""


class Transitions(NamedTuple):
    """N steps of each of M members."""

    state: Tensor
    """`[M, N, 6]`"""
    pixels: Tensor
    """`[M, N, K x 121]`"""
    action: Tensor
    """`[M, N, 4]`, from -1, a closed throttle, to 1."""
    reward: Tensor
    """`[M, N]`, minus the distance to the goal after the step, u."""
    next_state: Tensor
    """`[M, N, 6]`"""
    next_pixels: Tensor
    """`[M, N, K x 121]`"""
    noise: Tensor
    """`[M, N, 4]`, on the target's actions after the step."""


class Critic(nn.Module):
    """M perceptrons side by side, from sensations and actions to values."""

    def __init__(self, generators: Generators, num_channels: int, settings: TD3BC) -> None:
        """Draw the weights of M members, each from its own generator."""
        super().__init__()
        self._activation = settings.activation
        sizes = [STATE + num_channels * PIXELS**2 + 4, *settings.hidden_sizes, 1]
        self.layers = nn.ModuleList(StackedLinear(generators, *pair) for pair in pairwise(sizes))

    def forward(self, state: Tensor, pixels: Tensor, action: Tensor) -> Tensor:
        """Values `[M, N]`: discounted means of rewards, u."""
        inputs = torch.cat([state, pixels, action], dim=-1)
        return perceptron(self.layers, inputs, self._activation)[..., 0]


class Offline:
    """M policies that learn from the same data set, with critics that say how much better another action would be.

    A member's weights, batches and noise are drawn from generators of its own seed, and losses are sums over members,
    so that each learns as if it were alone. Values are means of rewards instead of sums, so that they are about 1.

    Attributes:
        network: the policies, trained in place.
        num_rounds: rounds so far.
    """

    def __init__(self, settings: TD3BC, seeds: Sequence[int], data: Mapping[str, np.ndarray]) -> None:
        """Take the arrays of `affmap.data.collect.collect`, or some of their sequences."""
        self._settings, self._seeds, self._data = settings, seeds, Hindsight(data)
        num_channels = data["view"].shape[2]

        def drawn(*keys: int, name: str) -> list[torch.Generator]:
            return [torch.Generator().manual_seed(integer(seed, name, *keys)) for seed in seeds]

        self.network = Network.of(settings, drawn(name="weights of a policy"), num_channels)
        self._critics = nn.ModuleList(
            Critic(drawn(number, name="weights of a critic"), num_channels, settings) for number in range(2)
        )
        self._learned = nn.ModuleList([self.network, self._critics])
        self._targets = deepcopy(self._learned).requires_grad_(False)
        self._optimizers = [torch.optim.Adam(part.parameters(), settings.learning_rate) for part in self._learned]
        self.num_rounds = 0

    @property
    def total(self) -> int:
        """Number of rounds of the whole training."""
        return self._settings.rounds

    def round(self) -> None:
        """Learn for a round."""
        rngs = [generator(seed, "examples of a policy", self.num_rounds) for seed in self._seeds]
        for number in range(self._settings.updates):
            drawn = [self.draw(self._settings.batch_size, rng) for rng in rngs]
            self.update(Transitions(*map(torch.stack, zip(*drawn, strict=True))), number % DELAY == 0)
        self.num_rounds += 1

    def draw(self, number: int, rng: np.random.Generator) -> Transitions:
        """Draw steps that have a next one, and for each a goal: `Transitions` without the axis M."""
        data, settings = self._data, self._settings
        sequence, step, later = data.draw(number, data.num_steps - 1, settings.max_delay, rng)
        goal = data.position[sequence, later]
        now, then = data.observation(sequence, step, goal), data.observation(sequence, step + 1, goal)
        noise = torch.from_numpy(rng.normal(0, NOISE, (number, 4)).astype(np.float32))
        return Transitions(
            state_of(now),
            pixels_of(now),
            2 * data.action[sequence, step] - 1,
            -(then.position - goal).norm(dim=-1),
            state_of(then),
            pixels_of(then),
            noise.clamp(-MAX_NOISE, MAX_NOISE),
        )

    def update(self, drawn: Transitions, has_policy: bool) -> None:
        """Learn from some steps: the critics, and the policy and the targets, too, if `has_policy`."""
        now, action, then = drawn[:2], drawn.action, drawn[4:6]
        policy, critics = self._targets
        assert isinstance(critics, nn.ModuleList)
        with torch.no_grad():
            next_action = (policy(*then) + drawn.noise).clamp(-1, 1)
            values = torch.minimum(*(critic(*then, next_action) for critic in critics))
            aim = (1 - DISCOUNT) * drawn.reward + DISCOUNT * values
        errors = torch.stack([critic(*now, action) - aim for critic in self._critics])
        self._step(errors.square().mean(-1).sum(), 1)
        if not has_policy:
            return
        output = self.network(*now)
        value = self._critics[0](*now, output)
        gain = self._settings.weight * value.mean(1) / value.detach().abs().mean(1)
        self._step(((output - action).square().mean((1, 2)) - gain).sum(), 0)
        torch._foreach_lerp_([*self._targets.parameters()], [*self._learned.parameters()], RATE)

    def _step(self, loss: Tensor, part: int) -> None:
        """Change a part of what is learned, and nothing else."""
        self._optimizers[part].zero_grad()
        loss.backward(inputs=[*self._learned[part].parameters()])
        self._optimizers[part].step()

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors and numbers."""
        return {
            "learned": self._learned.state_dict(),
            "targets": self._targets.state_dict(),
            "optimizers": [each.state_dict() for each in self._optimizers],
            "num_rounds": self.num_rounds,
        }

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""
        self._learned.load_state_dict(state["learned"])
        self._targets.load_state_dict(state["targets"])
        for each, own in zip(self._optimizers, state["optimizers"], strict=True):
            each.load_state_dict(own)
        self.num_rounds = state["num_rounds"]
