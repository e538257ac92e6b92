"""Imagination in compiled loops: multilayer perceptrons with an affordance map, on the CPU.

Stands in for `affmap.model.rollout` and `affmap.planning.objective` where it can. They are its reference, and do the
work for all other models, look-ups and devices. Importing this module needs numba.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import pad

from affmap.compiled.gradients import gradients
from affmap.compiled.imagination import costs, positions
from affmap.compiled.lanes import WIDTH
from affmap.compiled.problems import Maps, Start, Weights, pack
from affmap.gaussian import Gaussian
from affmap.model.lookup import AffordanceMap, Lookup
from affmap.model.rollout import Situation
from affmap.model.stack import Stack
from affmap.model.transition import TransitionModel
from affmap.planning.planner import Objective


class CompiledImagination:
    """Imagines for a stack, with the weights that it has at each call."""

    @classmethod
    def of(cls, stack: Stack, lookup: Lookup) -> "CompiledImagination | None":
        """That of a stack with a look-up, or None for models, look-ups and devices that it does not know."""
        if type(stack.transition) is not TransitionModel or not isinstance(lookup, AffordanceMap):
            return None
        tensors = (lookup.codes, *stack.transition.parameters())
        known = all(tensor.device.type == "cpu" and tensor.dtype == torch.float32 for tensor in tensors)
        return cls(stack, lookup) if known else None

    def __init__(self, stack: Stack, lookup: AffordanceMap) -> None:
        """Take a stack and a map of it, both on the CPU."""
        self._transition, self._parameters = stack.transition, list(stack.transition.parameters())
        codes = pad(lookup.codes, (0, -lookup.codes.shape[-1] % WIDTH)).contiguous()
        nodes = codes.shape[2] - 1, codes.shape[1] - 1
        self._maps = Maps(codes.numpy(), np.divide(nodes, lookup.worlds[0].size).astype(np.float32))
        self._differentiable = lookup.differentiable
        self._version = -1
        self._packed: Weights

    def positions(self, situation: Situation, actions: Tensor) -> Gaussian:
        """Imagine the execution of actions `[B, N, H, 4]`; see `affmap.model.rollout.rollout`."""
        num_problems, num_candidates, horizon, _ = actions.shape
        mean, variance = actions.new_empty(2, num_problems, horizon, 2, num_candidates)
        positions(*self._weights(), *self._maps, *_start(situation), _array(actions), mean.numpy(), variance.numpy())
        return Gaussian(*(part.permute(0, 3, 1, 2) for part in (mean, 0.5 * variance.log())))

    def objective(self, situation: Situation, goal: Tensor, goal_std: Tensor, beta: float) -> Objective:
        """The expected free energy of actions `[B, N, H, 4]`; see `affmap.planning.objective.expected_free_energy`.

        Args:
            situation: where each of B problems starts.
            goal: `[B, 2]`, u.
            goal_std: `[B]`, u.
            beta: weight of the uncertainty.
        """
        networks, start = (*self._weights(), *self._maps), _start(situation)
        desired = _array(goal), _array(goal_std), np.float32(beta)

        def without_gradient(actions: Tensor) -> Tensor:
            result = actions.new_empty(actions.shape[:2])
            costs(*networks, *start, _array(actions), *desired, result.numpy())
            return result

        def with_gradient(actions: Tensor) -> tuple[Tensor, Tensor]:
            result, gradient = actions.new_empty(actions.shape[:2]), actions.new_empty(actions.shape)
            filled = result.numpy(), gradient.numpy()
            gradients(*networks, *start, _array(actions), *desired, self._differentiable, *filled)
            return result, gradient

        def objective(actions: Tensor) -> Tensor:
            if torch.is_grad_enabled() and actions.requires_grad:
                return _Costs.apply(actions, with_gradient)
            # A single candidate costs the same to the last bit, with a gradient and without.
            return with_gradient(actions)[0] if actions.shape[1] == 1 else without_gradient(actions)

        return objective

    def _weights(self) -> Weights:
        """The present weights, arranged anew when they have changed."""
        version = sum(weight._version for weight in self._parameters)
        if version != self._version:
            step = self._transition.step()
            self._packed = pack(_array(step.hidden), _array(step.output), _array(step.bias[..., 0]))
            self._version = version
        return self._packed


class _Costs(torch.autograd.Function):
    """Costs whose gradient is computed with them."""

    @staticmethod
    def forward(ctx: Any, actions: Tensor, with_gradient: Any) -> Tensor:
        result, gradient = with_gradient(actions)
        ctx.save_for_backward(gradient)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (own,) = ctx.saved_tensors
        return gradient[..., None, None] * own, None


def _start(situation: Situation) -> Start:
    return Start(_array(situation.position), _array(situation.delta))


def _array(tensor: Tensor) -> np.ndarray:
    """The numbers of a tensor, which is copied only if they are not neighbours."""
    return tensor.detach().contiguous().numpy()
