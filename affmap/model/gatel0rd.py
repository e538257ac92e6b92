"""The transition model whose hidden state changes at few steps: M GateL0RD cells side by side (arXiv 2110.15949).

    g = max(0, tanh(x W_g + h U_g + b_g + noise))    how far each unit moves; most gates are shut
    r = tanh(x W_r + h U_r + b_r)                    to where
    h' = h + g * (r - h)
    y = tanh(x W_p + h' U_p + b_p) * sigmoid(x W_o + h' U_o + b_o)

The prediction is linear in y. Where a gate is shut, its unit stays as it was, to the last bit. The share of open gates
is a further term of the training loss; its gradient is that of the gates themselves (straight-through). Noise on the
inputs of gates, in training only, keeps them from being open by a little.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.layers import Generators, StackedLinear, tanh, uniform
from affmap.model.transition import Carry, TransitionModel


class GateL0RD(TransitionModel):
    """M cells side by side, each with a linear layer for means and (logarithms of) deviations.

    Weights are in the order g, r, p, o; they begin as those of `torch.nn.Linear` with all inputs and the state.
    """

    def __init__(
        self,
        generators: Generators,
        context_size: int,
        hidden_size: int,
        delta_scale: float,
        gate_penalty: float,
        gate_noise: float,
    ) -> None:
        """Draw the weights of M models, and a seed for the noise of each."""
        super().__init__()
        num_inputs = 2 + 4 + context_size
        num_weights = num_inputs + hidden_size
        self.input_weight = uniform(generators, (num_inputs, 4 * hidden_size), num_weights)
        self.hidden_weight = uniform(generators, (hidden_size, 4 * hidden_size), num_weights)
        self.bias = uniform(generators, (4 * hidden_size,), num_weights)
        self.output = StackedLinear(generators, hidden_size, 2 + 2)
        seeds = [torch.randint(2**62, (), generator=each) for each in generators]
        self.register_buffer("noise_seed", torch.stack(seeds))  # of the next noise; kept, so that trainings resume
        self.noise_seed: Tensor
        self.hidden_size, self.delta_scale = hidden_size, delta_scale
        self.gate_penalty, self.gate_noise = gate_penalty, gate_noise
        self._open: Tensor

    def initial(self, num_sequences: int = 1) -> Carry:
        """Initial carry of zeros, see `TransitionModel.initial`."""
        return (self.bias.new_zeros(len(self.bias), num_sequences, self.hidden_size),)

    def step(self) -> Step:
        """Step function with the present weights, see `TransitionModel.step`."""
        return Step(self)

    def unroll(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict along recorded sequences, see `TransitionModel.unroll`; in training, gates are noisy.

        Only the hidden state is computed step by step.
        """
        step, (num_members, *shape, _) = self.step(), code.shape
        parts = (part.expand(num_members, -1, -1, -1).transpose(1, 2).flatten(1, 2) for part in (code, delta, action))
        inputs = step.inputs(*parts)  # [M, T * B, ...]
        of_state, of_output = inputs.chunk(2, dim=-1)
        if self.training and self.gate_noise:
            gates, new = of_state.chunk(2, dim=-1)
            of_state = torch.cat([gates + self._noise(gates.shape[1:]), new], dim=-1)
        (hidden,) = carry
        states, gates_of_steps = [], []
        for now in of_state.unflatten(1, shape[::-1]).unbind(1):  # T of [M, B, ...]
            hidden, gate = step.update(hidden, now)
            states.append(hidden)
            gates_of_steps.append(gate)
        if self.training:
            self._open = share_open(torch.stack(gates_of_steps))
        prediction = step.predict(torch.stack(states, dim=1).flatten(1, 2), of_output)
        return (hidden,), Gaussian(*(part.unflatten(1, shape[::-1]).transpose(1, 2) for part in prediction))

    def auxiliary_loss(self) -> Tensor:
        """Loss for open gates, see `TransitionModel.auxiliary_loss`."""
        return self.gate_penalty * self._open

    def _noise(self, shape: torch.Size) -> Tensor:
        """Noise on the inputs of gates, `[M, *shape]`, from a seed of each member, which becomes the next one."""
        draws = [torch.randn(shape, generator=torch.Generator().manual_seed(seed)) for seed in self.noise_seed.tolist()]
        self.noise_seed += 1
        return self.gate_noise * torch.stack(draws).to(self.bias)


def share_open(gates: Tensor) -> Tensor:
    """Share of the gates `[T, M, ...]` that are open: `[M]`; its gradient is that of the mean of the gates."""
    is_open = gates + ((gates > 0).to(gates) - gates).detach()
    return is_open.transpose(0, 1).flatten(1).mean(1)


class Step:
    """One step of M cells, as a function with fixed weights."""

    def __init__(self, model: GateL0RD) -> None:
        """Arrange the weights: those of the state, g and r, and those of the output, p and o."""
        size = 2 * model.hidden_size
        self._input = torch.cat([model.delta_scale * model.input_weight[:, :2], model.input_weight[:, 2:]], dim=1)
        self._bias = model.bias[:, None]
        self._state, self._result = model.hidden_weight[..., :size], model.hidden_weight[..., size:]
        self._output, self._scale = model.output, model.delta_scale

    def __call__(self, carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
        """Predict the change of position that an action will cause; see `affmap.model.transition.Step`."""
        of_state, of_output = self.inputs(code, delta, action).chunk(2, dim=-1)
        hidden, _ = self.update(carry[0], of_state)
        return (hidden,), self.predict(hidden, of_output)

    def inputs(self, code: Tensor, delta: Tensor, action: Tensor) -> Tensor:
        """Contributions of the inputs `[M, P, ...]` to g, r, p and o: `[M, P, 4 * hidden]`."""
        inputs = torch.cat([delta.mT, action.mT, code.mT], dim=1).mT
        return torch.baddbmm(self._bias, inputs, self._input)

    def update(self, hidden: Tensor, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Next hidden state and gates, `[M, P, hidden]`, from the last state and the contributions to g and r."""
        g, r = tanh(torch.baddbmm(inputs, hidden, self._state)).chunk(2, dim=-1)
        gate = g.relu()
        return torch.addcmul(hidden, gate, r - hidden), gate

    def predict(self, hidden: Tensor, inputs: Tensor) -> Gaussian:
        """Prediction from hidden states `[M, P, hidden]` and the contributions to p and o: of `[M, P, 2]`, u/step."""
        p, o = torch.baddbmm(inputs, hidden, self._result).chunk(2, dim=-1)
        mean, log_std = self._output(tanh(p) * o.sigmoid()).chunk(2, dim=-1)
        return Gaussian(mean / self._scale, log_std - math.log(self._scale))
