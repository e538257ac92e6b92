"""A transition model whose weights are linear in the context code: a linear hypernetwork of low rank.

    x = [delta, action, 1]
    h = tanh(x W + (x P * c Q) R)
    [mean, log deviation] = [h, 1] V + ([h, 1] S * c T) U

P, Q, R and S, T, U have few columns or rows, the rank. Without a code, c = 0, what remains is a perceptron for free
motion. Weights of two codes that are added up are those of both, but tanh and logarithm keep their effects from adding
up.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.layers import Generators, tanh, uniform
from affmap.model.transition import Carry, Memoryless, StepFunction


class Hyper(Memoryless):
    """M models side by side."""

    def __init__(self, generators: Generators, context_size: int, delta_scale: float, units: int, rank: int) -> None:
        """Draw the weights of M models with so many hidden units; `rank` is that of the change of each layer."""
        super().__init__()
        sizes = (2 + 4 + 1, units), (units + 1, 2 + 2)
        self.weights = torch.nn.ParameterList(uniform(generators, size, size[0]) for size in sizes)
        self.inputs = torch.nn.ParameterList(uniform(generators, (size[0], rank), size[0]) for size in sizes)
        self.codes = torch.nn.ParameterList(
            uniform(generators, (context_size, rank), max(1, context_size)) for _ in sizes
        )
        self.outputs = torch.nn.ParameterList(uniform(generators, (rank, size[1]), rank) for size in sizes)
        self.delta_scale = delta_scale

    def step(self) -> StepFunction:
        """Step function with the present weights, see `affmap.model.transition.TransitionModel.step`."""

        def step(carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
            hidden = tanh(self._layer(0, torch.cat([self.delta_scale * delta, action], dim=-1), code))
            mean, log_std = self._layer(1, hidden, code).chunk(2, dim=-1)
            return carry, Gaussian(mean / self.delta_scale, log_std - math.log(self.delta_scale))

        return step

    def _layer(self, number: int, values: Tensor, code: Tensor) -> Tensor:
        """Outputs of a layer for `values` `[M, P, n]`, with a bias, for codes `[M, P, C]`."""
        values = torch.cat([values, torch.ones_like(values[..., :1])], dim=-1)
        change = torch.bmm(values, self.inputs[number]) * torch.bmm(code, self.codes[number])
        return torch.baddbmm(torch.bmm(change, self.outputs[number]), values, self.weights[number])
