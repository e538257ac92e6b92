"""Imagination in compiled loops: multilayer perceptrons on the CPU, with affordance maps or exact look-ups.

Replaces `affmap.model.rollout` and `affmap.planning.objective` where possible. They are its reference, and serve all
other models, look-ups and devices. Importing this module needs numba.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import pad

from affmap.compiled.gradients import gradients
from affmap.compiled.imagination import costs, positions
from affmap.compiled.lanes import WIDTH
from affmap.compiled.problems import Desired, Maps, Scenes, Start, Weights, pack
from affmap.gaussian import Gaussian
from affmap.model import direct
from affmap.model.lookup import AffordanceMap, ExactLookup, Lookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import Stack, num_changes, readable
from affmap.model.transition import MLP
from affmap.planning.objective import expected_free_energy
from affmap.planning.planner import Objective


class CompiledImagination(Protocol):
    """Imagination of a stack, with its weights at each call."""

    def positions(self, situation: Situation, actions: Tensor) -> Gaussian:
        """Imagine the execution of actions `[B, N, H, 4]`; see `affmap.model.rollout.rollout`."""
        ...

    def objective(self, situation: Situation, goal: Tensor, goal_std: Tensor, beta: float) -> Objective:
        """Expected free energy of actions `[B, N, H, 4]`; see `affmap.planning.objective.expected_free_energy`.

        Args:
            situation: where each of B problems starts.
            goal: `[B, 2]`, u.
            goal_std: `[B]`, u.
            beta: weight of the uncertainty.
        """
        ...


def compiled_imagination(stack: Stack, lookup: Lookup) -> CompiledImagination | None:
    """Compiled imagination of a stack with a look-up; None for unsupported models, look-ups and devices."""
    if type(stack.transition) is not MLP or not readable(stack.parameters()):
        return None
    if isinstance(lookup, AffordanceMap) and readable([lookup.codes]):
        return MapImagination(stack, lookup)
    plain = stack.vision is not None and stack.vision.encoder == "plain"
    seen = not any(world.hidden for world in lookup.worlds)
    return ViewImagination(stack, lookup) if isinstance(lookup, ExactLookup) and plain and seen else None


class MapImagination:
    """Imagination with an affordance map."""

    def __init__(self, stack: Stack, lookup: AffordanceMap) -> None:
        """Take a stack and a map of it."""
        self._networks = _Networks(stack)
        codes = pad(lookup.codes, (0, -lookup.codes.shape[-1] % WIDTH)).contiguous()
        nodes = codes.shape[2] - 1, codes.shape[1] - 1
        self._maps = Maps(codes.numpy(), np.divide(nodes, lookup.worlds[0].size).astype(np.float32))
        self._differentiable = lookup.differentiable

    def positions(self, situation: Situation, actions: Tensor) -> Gaussian:
        """Imagine positions, see `CompiledImagination`."""
        num_problems, num_candidates, horizon, _ = actions.shape
        mean, variance = actions.new_empty(2, num_problems, horizon, 2, num_candidates)
        start = _start(situation)
        positions(self._networks(), self._maps, start, _array(actions), mean.numpy(), variance.numpy())
        return Gaussian(*(part.permute(0, 3, 1, 2) for part in (mean, 0.5 * variance.log())))

    def objective(self, situation: Situation, goal: Tensor, goal_std: Tensor, beta: float) -> Objective:
        """Objective for plans, see `CompiledImagination`."""
        networks, maps, start = self._networks(), self._maps, _start(situation)
        desired = _desired(goal, goal_std, beta)

        def without_gradient(actions: Tensor) -> Tensor:
            result = actions.new_empty(actions.shape[:2])
            costs(networks, maps, start, _array(actions), desired, result.numpy())
            return result

        def with_gradient(actions: np.ndarray, result: np.ndarray, gradient: np.ndarray) -> None:
            gradients(networks, maps, start, actions, desired, self._differentiable, result, gradient)

        def objective(actions: Tensor) -> Tensor:
            # A single candidate costs the same to the last bit, with a gradient and without.
            if actions.shape[1] == 1 or _is_differentiated(actions):
                return _Costs.apply(actions, with_gradient)
            return without_gradient(actions)

        return objective


class ViewImagination:
    """Imagination with exact look-ups: compiled for single candidates, as in gradient descent."""

    def __init__(self, stack: Stack, lookup: ExactLookup) -> None:
        """Take a stack that sees and its look-up."""
        self._stack, self._lookup = stack, lookup
        self._networks, self._encoder = _Networks(stack), direct.DirectEncoder(stack)
        scenes = [world.arrays[np.dtype(np.float32)] for world in lookup.worlds]
        most = max(len(scene.circles) for scene in scenes)
        circles = np.full((len(scenes), most, 3), -1, np.float32)  # a squared radius below 0 holds nothing
        channels = np.zeros((len(scenes), most), np.int64)
        for number, scene in enumerate(scenes):
            circles[number, : len(scene.circles)] = scene.circles
            channels[number, : len(scene.circles)] = scene.channels
        borders = np.array([scene.border_channel for scene in scenes])
        self._worlds = scenes[0].offsets, scenes[0].size, borders, circles, channels

    def positions(self, situation: Situation, actions: Tensor) -> Gaussian:
        """Imagine positions, see `CompiledImagination`."""
        return rollout(self._stack.transition, self._lookup, situation, actions)

    def objective(self, situation: Situation, goal: Tensor, goal_std: Tensor, beta: float) -> Objective:
        """Objective for plans, see `CompiledImagination`."""
        networks, start, desired = self._networks(), _start(situation), _desired(goal, goal_std, beta)
        scenes = Scenes(*self._worlds, *self._encoder.weights())

        def with_gradient(actions: np.ndarray, result: np.ndarray, gradient: np.ndarray) -> None:
            gradients(networks, scenes, start, actions, desired, False, result, gradient)

        def objective(actions: Tensor) -> Tensor:
            if actions.shape[1] == 1:
                return _Costs.apply(actions, with_gradient)
            path = self.positions(situation, actions)
            return expected_free_energy(path, goal[:, None], goal_std[:, None], beta).total

        return objective


class _Networks:
    """The weights of a stack's transition models, arranged anew when they have changed."""

    def __init__(self, stack: Stack) -> None:
        assert isinstance(stack.transition, MLP)
        self._transition, self._parameters = stack.transition, list(stack.transition.parameters())
        self._changes = -1
        self._packed: Weights

    def __call__(self) -> Weights:
        changes = num_changes(self._parameters)
        if changes != self._changes:
            step = self._transition.step()
            self._packed = pack(_array(step.hidden), _array(step.output), _array(step.bias[..., 0]))
            self._changes = changes
        return self._packed


class _Costs(torch.autograd.Function):
    """Costs whose gradient is computed with them."""

    @staticmethod
    def forward(ctx: Any, actions: Tensor, with_gradient: Callable[..., None]) -> Tensor:
        result, gradient = actions.new_empty(actions.shape[:2]), actions.new_empty(actions.shape)
        with_gradient(_array(actions), result.numpy(), gradient.numpy())
        ctx.save_for_backward(gradient)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (own,) = ctx.saved_tensors
        return gradient[..., None, None] * own, None


def _is_differentiated(actions: Tensor) -> bool:
    return torch.is_grad_enabled() and actions.requires_grad


def _start(situation: Situation) -> Start:
    return Start(_array(situation.position), _array(situation.delta))


def _desired(goal: Tensor, goal_std: Tensor, beta: float) -> Desired:
    return Desired(_array(goal), _array(goal_std), np.float32(beta))


def _array(tensor: Tensor) -> np.ndarray:
    """Array of a tensor, copied only if it is not contiguous."""
    return tensor.detach().contiguous().numpy()
