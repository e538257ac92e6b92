"""Transition models whose predictions are made of effects: each block of the context code adds its own.

Without anything around, the code is 0 (`affmap.model.vision`, centered codes), and the model predicts free motion. A
block of code units b adds an effect that is linear in its units:

    h_b = tanh(W_b [delta, action, motion] + w_b)        motion: the mean predicted so far
    (e_b, s_b) = (sum over units u of b) c_u V_u h_b     change of the mean, and a deviation of its own
    mean = motion + (sum over b) e_b,    variance = free variance + (sum over b) s_b^2

So properties that were only ever seen apart have an effect together, too: that of each. In the `additive` model all
effects start from the free motion. In the `split` one blocks act in turn, each on the motion that the ones before have
changed (operator splitting): an obstacle stops a vehicle that a force field pushes towards it.

Independent causes of noise add their variances; that holds where several properties overlap.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.layers import Generators, StackedLinear, tanh, uniform
from affmap.model.transition import Carry, Memoryless, StepFunction


class Effects(Memoryless):
    """M models side by side: free motion, and B blocks of code units that change it."""

    def __init__(
        self,
        generators: Generators,
        context_size: int,
        delta_scale: float,
        units: int,
        block_size: int,
        in_turn: bool,
    ) -> None:
        """Draw the weights of M models.

        Args:
            generators: M of them.
            context_size: C; the last block may have fewer units of the code than the others.
            delta_scale: factor on the change of position.
            units: hidden units, of free motion and of each block.
            block_size: units of the code in a block.
            in_turn: whether blocks act one after the other (`split`), the last one first, instead of all at once.
        """
        super().__init__()
        self.free_hidden = StackedLinear(generators, 2 + 4, units)
        self.free_output = StackedLinear(generators, units, 2 + 2)
        num_blocks, num_inputs = math.ceil(context_size / block_size), 2 + 4 + 2
        self.block_weight = uniform(generators, (num_blocks, num_inputs, units), num_inputs)
        self.block_bias = uniform(generators, (num_blocks, units), num_inputs)
        self.effect_weight = uniform(generators, (context_size, units, 2 + 2), units)
        self.delta_scale, self.block_size, self.in_turn = delta_scale, block_size, in_turn

    @property
    def num_blocks(self) -> int:
        """Number of blocks, B."""
        return self.block_weight.shape[1]

    def step(self) -> StepFunction:
        """Step function with the present weights, see `affmap.model.transition.TransitionModel.step`."""
        blocks = range(self.num_blocks)
        stages = [[block] for block in reversed(blocks)] if self.in_turn else [list(blocks)]

        def step(carry: Carry, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Carry, Gaussian]:
            inputs, motion, log_std = self._free(delta, action)
            variance = (2 * log_std).exp()
            for stage in stages:
                effects = [self._effect(block, code, torch.cat([inputs, motion], dim=-1)) for block in stage]
                for change, deviation in effects:
                    motion, variance = motion + change, variance + deviation.square()
            return carry, Gaussian(motion / self.delta_scale, 0.5 * variance.log() - math.log(self.delta_scale))

        return step

    def alone(self, block: int, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Effect of one block alone, as if the code of all others were 0; arguments as those of a step.

        Returns:
            Change of the mean of free motion, and deviation beside that of free motion (its sign means nothing), each
            `[M, P, 2]` in u/step.
        """
        inputs, motion, _ = self._free(delta, action)
        change, deviation = self._effect(block, code, torch.cat([inputs, motion], dim=-1))
        return change / self.delta_scale, deviation / self.delta_scale

    def _free(self, delta: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Inputs `[M, P, 6]`, and mean and logarithm of the deviation of free motion, `[M, P, 2]` each, scaled."""
        inputs = torch.cat([self.delta_scale * delta, action], dim=-1)
        motion, log_std = self.free_output(tanh(self.free_hidden(inputs))).chunk(2, dim=-1)
        return inputs, motion, log_std

    def _effect(self, block: int, code: Tensor, inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Change of the mean and deviation by a block, `[M, P, 2]` each, scaled; `inputs` are `[M, P, 8]`."""
        units = slice(block * self.block_size, (block + 1) * self.block_size)
        weight, bias = self.block_weight[:, block], self.block_bias[:, block, None]
        hidden = tanh(torch.baddbmm(bias, inputs, weight))
        # The units' code first, then one product: c_u h for each unit u, times the V_u of all.
        weighted = (code[..., units, None] * hidden[..., None, :]).flatten(-2)
        change, deviation = torch.bmm(weighted, self.effect_weight[:, units].flatten(1, 2)).chunk(2, dim=-1)
        return change, deviation
