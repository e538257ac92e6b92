"""The transition model: context code, last change of position and action -> Gaussian over the next change.

`TransitionModel` is the interface of all kinds, `MLP` the paper's model. `affmap.model.gru` holds the recurrent one,
`affmap.model.effects` and `affmap.model.hyper` those whose codes compose.

It works in scaled units on both sides (Appendix A scales its inputs; its predictions are scaled back outside), so
that inputs and targets are of the order of 1. It knows nothing of positions, views or goals.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from torch import Tensor, nn

from affmap.gaussian import Gaussian
from affmap.model.layers import Generators, uniform

Carry = tuple[Tensor, ...]
"""Hidden state of a transition model, tensors `[M, P, hidden]`; the MLP's is empty."""

StepFunction = Callable[[Carry, Tensor, Tensor, Tensor], tuple[Carry, Gaussian]]
"""One step of M models, as `Step`: `(carry, code, delta, action) -> (carry, prediction)`."""


class TransitionModel(nn.Module, ABC):
    """Base class of M transition models side by side.

    Every parameter is `[M, ...]`, and the loss is the sum over members.
    """

    @abstractmethod
    def initial(self, num_sequences: int = 1) -> Carry:
        """Carry at the beginning of `num_sequences` (P) sequences of each member, tensors `[M, P, hidden]`."""

    @abstractmethod
    def step(self) -> StepFunction:
        """Step function for `[M, P, features]`, with constants folded into its weights; renew it after updates."""

    @abstractmethod
    def unroll(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict one step ahead along recorded sequences.

        As `step()`, for `[M, B, T, features]`; `delta` and `action` may be the same for all members, `[1, B, T, ...]`.
        """

    def auxiliary_loss(self) -> Tensor | None:
        """Further term of the training loss that follows from the last `unroll`, `[M]` in nats; None without one."""
        return None


class Memoryless(TransitionModel):
    """Base class of transition models without a hidden state, which need no more than `step`."""

    def initial(self, num_sequences: int = 1) -> Carry:
        """Empty carry, because there is no hidden state."""
        return ()

    def unroll(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict along recorded sequences, see `TransitionModel.unroll`.

        Without a hidden state the steps do not depend on each other, and all are computed at once.
        """
        parts = (part.expand(len(code), -1, -1, -1).flatten(1, 2) for part in (code, delta, action))
        carry, prediction = self.step()(carry, *parts)
        return carry, Gaussian(*(part.unflatten(1, code.shape[1:-1]) for part in prediction))


class Step:
    """One step of M multilayer perceptrons, as a function with fixed weights.

    The few inputs and outputs are last in the shape and first in memory: a long row for each makes the products, and
    all that follows, several times as fast. The many hidden units are last in both.
    """

    def __init__(self, hidden: Tensor, output: Tensor, bias: Tensor) -> None:
        """Take weights `[M, 2 + 4 + C, hidden]`, `[M, 2 + 2, hidden]`, `[M, 2 + 2, 1]`, for u/step and the sigmoid."""
        self.hidden, self.output, self.bias = hidden, output, bias

    def __call__(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict the change of position that an action will cause.

        Args:
            carry: the result of `initial` or of the last step.
            code: context codes `[M, P, C]`.
            delta: last changes of position `[M, P, 2]`, u/step.
            action: `[M, P, 4]`, throttles in [0, 1].

        Returns:
            The new carry, and a Gaussian of `[M, P, 2]` in u/step.
        """
        columns = torch.cat([delta.mT, action.mT, code.mT], dim=1)
        hidden = torch.bmm(columns.mT, self.hidden).sigmoid()  # [M, P, hidden]
        mean, log_std = torch.baddbmm(self.bias, self.output, hidden.mT).chunk(2, dim=1)  # [M, 2, P] each
        return carry, Gaussian(mean.mT, log_std.mT)


class MLP(Memoryless):
    """M multilayer perceptrons side by side (Section 4.2: the hidden state of the paper is dropped)."""

    def __init__(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> None:
        """Draw the weights of M models."""
        super().__init__()
        num_inputs = 2 + 4 + context_size
        self.hidden_weight = uniform(generators, (num_inputs, hidden_size), num_inputs)
        # The two parallel layers of the paper, means and (logarithms of) standard deviations, as one product.
        self.output_weight = uniform(generators, (hidden_size, 2 + 2), hidden_size)
        self.output_bias = uniform(generators, (2 + 2,), hidden_size)
        # What `step` multiplies into the weights, so that it takes and gives u/step.
        constants = {
            "input_factor": [2 * delta_scale] * 2 + [2.0] * (4 + context_size),
            "output_factor": [1 / delta_scale] * 2 + [1.0] * 2,
            "output_shift": [0.0] * 2 + [-math.log(delta_scale)] * 2,
        }
        for name, values in constants.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32, device="cpu"), persistent=False)
        self.input_factor: Tensor
        self.output_factor: Tensor
        self.output_shift: Tensor

    def step(self) -> Step:
        """Step function with constants folded into its weights; renew it after updates.

        All constants are multiplied into the weights once: the scale of inputs and outputs, and
        tanh(x) = 2 sigmoid(2 x) - 1, because PyTorch's sigmoid is several times as fast as its tanh on a CPU.
        """
        hidden = self.hidden_weight * self.input_factor[:, None]
        bias = (self.output_bias - self.output_weight.sum(1)) * self.output_factor + self.output_shift
        return Step(hidden, (self.output_weight * (2 * self.output_factor)).mT, bias[..., None])
