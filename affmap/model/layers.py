"""Layers that hold M independent sets of weights: member m's input meets member m's weights only.

Weights are initialised as in PyTorch's own layers, uniform in +-1 / sqrt(number of inputs), drawn from
each member's own generator, so that a member of a stack equals the same member made alone.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

Generators = Sequence[torch.Generator]
"""One generator a member, M of them."""


def uniform(generators: Generators, shape: Sequence[int], num_inputs: int) -> nn.Parameter:
    """Draw a parameter `[M, *shape]`, uniform in +-1 / sqrt(num_inputs)."""
    draws = [torch.rand(*shape, generator=each, dtype=torch.float32, device=each.device) for each in generators]
    return nn.Parameter((2 * torch.stack(draws) - 1) / num_inputs**0.5)


def tanh(inputs: Tensor) -> Tensor:
    """Hyperbolic tangent computed from the sigmoid, which PyTorch computes several times as fast on a CPU."""
    return 2 * (2 * inputs).sigmoid() - 1


class StackedLinear(nn.Module):
    """M affine maps side by side."""

    def __init__(self, generators: Generators, num_inputs: int, num_outputs: int) -> None:
        """Draw the weights `[M, num_inputs, num_outputs]` and biases `[M, num_outputs]`."""
        super().__init__()
        self.weight = uniform(generators, (num_inputs, num_outputs), num_inputs)
        self.bias = uniform(generators, (num_outputs,), num_inputs)

    def forward(self, inputs: Tensor) -> Tensor:
        """Map `[M, ..., num_inputs]` to `[M, ..., num_outputs]`, with at least one axis between.

        Features are last in the shape and first in memory, here and everywhere: one row a feature makes everything
        around small products faster, the more so the fewer the features are.
        """
        outputs = torch.baddbmm(self.bias[..., None], self.weight.mT, inputs.flatten(1, -2).mT)
        return outputs.mT.unflatten(1, inputs.shape[1:-1])
