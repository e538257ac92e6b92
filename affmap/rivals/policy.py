"""A policy: a small network from sensations to throttles, and the controller that flies with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from affmap.control.controller import Decision, Observation
from affmap.model.layers import Generators, StackedLinear, tanh
from affmap.planning import planner
from affmap.rivals.settings import Activation, Imitation, Rival
from affmap.view import PIXELS

STATE = 6
"""Numbers of the position, its change, and the way to the goal."""

CHANGE = 10.0
"""Factor on changes of position (u/step), which are about a tenth of positions and ways (u)."""


Numbers = TypeVar("Numbers", Tensor, np.ndarray)


def parts(position: Numbers, delta: Numbers, goal: Numbers) -> list[Numbers]:
    """Position (u), its change (0.1 u/step) and the way to the goal (u), as a policy has them."""
    return [position, CHANGE * delta, goal - position]


def state_of(observation: Observation) -> Tensor:
    """The parts of a policy's state, `[..., 6]`."""
    return torch.cat(parts(observation.position, observation.delta, observation.goal), dim=-1)


def pixels_of(observation: Observation) -> Tensor:
    """The view as numbers, 0 or 1, `[..., K x 121]`."""
    return observation.view.flatten(-3).to(observation.position.dtype)


ACTIVATIONS: Mapping[Activation, Callable[[Tensor], Tensor]] = {"tanh": tanh, "relu": torch.relu}


def perceptron(layers: Iterable[nn.Module], values: Tensor, activation: Activation) -> Tensor:
    """Outputs of layers one after the other, with an activation between them."""
    first, *others = layers
    values = first(values)
    for layer in others:
        values = layer(ACTIVATIONS[activation](values))
    return values


class Network(nn.Module):
    """M multilayer perceptrons side by side."""

    def __init__(
        self,
        generators: Generators,
        num_channels: int,
        hidden_sizes: Sequence[int],
        view_units: int = 0,
        squash: bool = True,
        activation: Activation = "tanh",
    ) -> None:
        """Draw the weights of M members, each from its own generator.

        Args:
            generators: one a member.
            num_channels: K, of a view.
            hidden_sizes: units of each hidden layer.
            view_units: units of a layer that sees the view alone; 0: the first hidden layer sees all.
            squash: whether outputs, too, pass through a tanh; else they are clipped where they are executed.
            activation: of hidden layers; that of the view is always a tanh.
        """
        super().__init__()
        self._num_members, self._squash, self._activation = len(generators), squash, activation
        num_pixels = num_channels * PIXELS**2
        self.view = StackedLinear(generators, num_pixels, view_units) if view_units else None
        sizes = [STATE + (view_units or num_pixels), *hidden_sizes, 4]
        self.layers = nn.ModuleList(StackedLinear(generators, *pair) for pair in pairwise(sizes))

    @classmethod
    def of(cls, settings: Rival, generators: Generators, num_channels: int) -> Network:
        """The network of a rival, as the constructor makes it."""
        view_units = settings.view_units if isinstance(settings, Imitation) else 0
        return cls(generators, num_channels, settings.hidden_sizes, view_units, settings.squash, settings.activation)

    @property
    def num_parameters(self) -> int:
        """Number of weights and biases of a member."""
        return sum(each[0].numel() for each in self.parameters())

    def forward(self, state: Tensor, pixels: Tensor) -> Tensor:
        """Outputs `[M, N, 4]` for states `[M, N, 6]` and pixels `[M, N, K x 121]`: 1 opens a throttle, -1 closes it."""
        seen = tanh(self.view(pixels)) if self.view is not None else pixels
        outputs = perceptron(self.layers, torch.cat([state, seen], dim=-1), self._activation)
        return tanh(outputs) if self._squash else outputs

    def act(self, observation: Observation) -> Tensor:
        """Throttles `[B, 4]` of B vehicles, the same number for each member (member-major)."""
        shape = self._num_members, -1
        inputs = (part.unflatten(0, shape) for part in (state_of(observation), pixels_of(observation)))
        return throttles(self(*inputs)).flatten(0, 1)


def throttles(outputs: Tensor) -> Tensor:
    """Openings in [0, 1] for outputs of a network."""
    return ((outputs + 1) / 2).clamp(0, 1)


class Policy:
    """A controller that acts as a network says; it predicts nothing, remembers nothing, and nothing is random.

    Attributes:
        network: of M members.
    """

    def __init__(self, network: Network) -> None:
        """Fly with a network, whose weights cease to require gradients."""
        self.network = network.requires_grad_(False)

    def __repr__(self) -> str:
        return f"Policy({self.network.num_parameters} parameters)"

    def initial(self, num_problems: int) -> None:
        """Return no state: nothing is remembered."""

    def act(self, observation: Observation, state: None, generators: planner.Generators) -> tuple[Decision, None]:
        """Act for B vehicles, the same number for each member (member-major); see `Controller.act`."""
        return Decision.without_prediction(self.network.act(observation)), None
