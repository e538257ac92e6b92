"""The transition model with a hidden state: gated recurrent units, M of them side by side (Section 2.1).

Cho et al. 2014, in the form of `torch.nn.GRU`:

    r = sigmoid(x W_r + h U_r + b_r)        how much of the old state the new one sees
    z = sigmoid(x W_z + h U_z + b_z)        how much of the old state stays
    n = tanh(x W_n + b_n + r * (h U_n + c_n))
    h' = (1 - z) * n + z * h

The prediction is linear in h', as the MLP's is in its hidden layer. Errors are propagated back through the steps of a
chunk (`TrainingSettings.chunk_length`); the state goes on to the next chunk, and begins anew with each sequence.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.layers import Generators, StackedLinear, uniform
from affmap.model.transition import Carry, TransitionModel


class GRU(TransitionModel):
    """M gated recurrent units side by side, each with a linear layer for means and (logarithms of) deviations.

    The weights are those of `torch.nn.GRU` with its gates in their order, r, z, n, transposed; they begin as those do,
    uniform in +-1 / sqrt(hidden_size).
    """

    def __init__(self, generators: Generators, context_size: int, hidden_size: int, delta_scale: float) -> None:
        """Draw the weights of M models."""
        super().__init__()
        num_inputs, num_gates = 2 + 4 + context_size, 3 * hidden_size
        self.input_weight = uniform(generators, (num_inputs, num_gates), hidden_size)
        self.input_bias = uniform(generators, (num_gates,), hidden_size)
        self.hidden_weight = uniform(generators, (hidden_size, num_gates), hidden_size)
        self.hidden_bias = uniform(generators, (num_gates,), hidden_size)
        self.output = StackedLinear(generators, hidden_size, 2 + 2)
        self.hidden_size, self.delta_scale = hidden_size, delta_scale

    def initial(self, num_sequences: int = 1) -> Carry:
        """Initial carry of zeros, see `TransitionModel.initial`."""
        return (self.input_bias.new_zeros(len(self.input_bias), num_sequences, self.hidden_size),)

    def step(self) -> Step:
        """Step function with the present weights, see `TransitionModel.step`."""
        return Step(self)

    def unroll(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict along recorded sequences, see `TransitionModel.unroll`.

        Only the hidden state is computed step by step; the products of all inputs and all predictions are computed at
        once.
        """
        step, (num_members, *shape, _) = self.step(), code.shape
        parts = (part.expand(num_members, -1, -1, -1).transpose(1, 2).flatten(1, 2) for part in (code, delta, action))
        inputs = (part.unflatten(1, shape[::-1]).unbind(1) for part in step.inputs(*parts))  # T of [M, B, ...]
        (hidden,) = carry
        states = []
        for gates, new in zip(*inputs, strict=True):
            hidden = step.update(hidden, gates, new)
            states.append(hidden)
        prediction = step.predict(torch.stack(states, dim=2).flatten(1, 2))
        return (hidden,), Gaussian(*(part.unflatten(1, shape) for part in prediction))


class Step:
    """One step of M gated recurrent units, as a function with fixed weights."""

    def __init__(self, model: GRU) -> None:
        """Arrange the weights: r and z in one product, all constants in the biases."""
        num_gates = 2 * model.hidden_size
        weight = torch.cat([model.delta_scale * model.input_weight[:, :2], model.input_weight[:, 2:]], dim=1)
        self._gates_input, self._new_input = weight[..., :num_gates], weight[..., num_gates:]
        self._gates_hidden, self._new_hidden = (
            model.hidden_weight[..., :num_gates],
            model.hidden_weight[..., num_gates:],
        )
        self._gates_bias = (model.input_bias + model.hidden_bias)[:, None, :num_gates]
        self._new_bias = model.input_bias[:, None, num_gates:]
        self._reset_bias = model.hidden_bias[:, None, num_gates:]  # of the part that r multiplies
        self._output, self._scale = model.output, model.delta_scale

    def __call__(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict the change of position that an action will cause; see `affmap.model.transition.Step`."""
        (hidden,) = carry
        hidden = self.update(hidden, *self.inputs(code, delta, action))
        return (hidden,), self.predict(hidden)

    def inputs(self, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Contributions of the inputs `[M, P, ...]` to r and z, `[M, P, 2 * hidden]`, and to n, `[M, P, hidden]`."""
        inputs = torch.cat([delta.mT, action.mT, code.mT], dim=1).mT
        return (
            torch.baddbmm(self._gates_bias, inputs, self._gates_input),
            torch.baddbmm(self._new_bias, inputs, self._new_input),
        )

    def update(self, hidden: Tensor, gates: Tensor, new: Tensor) -> Tensor:
        """Next hidden state, `[M, P, hidden]`, from the last one and the result of `inputs`."""
        r, z = torch.baddbmm(gates, hidden, self._gates_hidden).sigmoid().chunk(2, dim=-1)
        n = torch.addcmul(new, r, torch.baddbmm(self._reset_bias, hidden, self._new_hidden)).tanh()
        return torch.lerp(n, hidden, z)

    def predict(self, hidden: Tensor) -> Gaussian:
        """Prediction from hidden states `[M, P, hidden]`: a Gaussian of `[M, P, 2]`, u/step."""
        mean, log_std = self._output(hidden).chunk(2, dim=-1)
        return Gaussian(mean / self._scale, log_std - math.log(self._scale))
