"""The transition model: context code, last change of position and action -> Gaussian over the next change.

It works in scaled units on both sides (Appendix A scales its inputs; its predictions are scaled back outside), so
that inputs and targets are of the order of 1. It knows nothing of positions, views or goals.
"""

import math

import torch
from torch import Tensor, nn

from affmap.gaussian import Gaussian
from affmap.model.stacked import Generators, StackedLinear

Carry = tuple[Tensor, ...]
"""Hidden state of a transition model, tensors `[M, ..., hidden]`; the MLP's is empty."""


class TransitionModel(nn.Module):
    """M multilayer perceptrons side by side (Section 4.2: the hidden state of the paper is dropped)."""

    def __init__(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> None:
        """Draw the weights of M models."""
        super().__init__()
        self.delta_scale = delta_scale
        self.hidden = StackedLinear(generators, 2 + 4 + context_size, hidden_size, bias=False)
        # The two parallel layers of the paper, means and (logarithms of) standard deviations, as one product.
        self.output = StackedLinear(generators, hidden_size, 2 + 2)

    def initial(self) -> Carry:
        """The carry at the beginning of a sequence."""
        return ()

    def step(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict the change of position that an action will cause.

        Args:
            carry: what `initial` or the last `step` returned.
            code: context codes `[M, ..., C]`.
            delta: last changes of position `[M or 1, ..., 2]`, u/step.
            action: `[M or 1, ..., 4]`, throttles in [0, 1].

        Returns:
            The new carry, and a Gaussian of `[M, ..., 2]` in u/step.
        """
        parts = (self.delta_scale * delta, action, code)
        columns = [part.expand(*code.shape[:-1], -1).flatten(1, -2).mT for part in parts]
        hidden = self.hidden(torch.cat(columns, dim=1).mT)
        mean, log_std = self.output.after_tanh(hidden).unflatten(1, code.shape[1:-1]).split(2, dim=-1)
        return carry, Gaussian(mean / self.delta_scale, log_std - math.log(self.delta_scale))

    def unroll(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """One-step predictions along recorded sequences; arguments as in `step`, time T before the features.

        Without a hidden state the steps do not depend on each other, and all are computed at once.
        """
        return self.step(carry, code, delta, action)
