"""Position or view -> context code in one pass of compiled code, without a cache of views."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from affmap import compiled
from affmap.model.stack import Stack, num_changes, readable
from affmap.model.vision import VisionModel
from affmap.view import PIXELS, VisibleLayout, for_compiled


class Weights(NamedTuple):
    """Weights of a vision model in the layout of compiled code, float32; q and h as in `affmap.model.vision.Sizes`.

    Outputs of a layer are last, with zeros up to a multiple of 8.
    """

    pictures: np.ndarray
    """`[M, K * 512, 8]`, outputs of the first convolution for all pictures of 3 x 3 pixels, bias included."""
    weight2: np.ndarray
    """`[M, 16 * q, 8 * q]`, the second convolution as one product; inputs are in the order of windows."""
    bias2: np.ndarray
    """`[M, 8 * q]`"""
    weight3: np.ndarray
    """`[M, 8 * q, h]`"""
    bias3: np.ndarray
    """`[M, h]`"""
    weight4: np.ndarray
    """`[M, h, C]`"""
    bias4: np.ndarray
    """`[M, C]`"""

    @classmethod
    def of(cls, vision: VisionModel, channel: int | None = None) -> "Weights":
        """Arrange the weights of a vision model, or of one that sees a single channel."""
        from affmap.compiled.direct import PICTURES

        pictures, pixels = (torch.arange(number, device="cpu") for number in (PICTURES, 9))
        is_set = (pictures[:, None] >> pixels & 1).float()
        features = is_set @ vision.conv1_weight.flatten(-2).permute(0, 2, 3, 1)  # [M, K, 512, q]
        if channel is not None:
            features[:, torch.arange(features.shape[1], device="cpu") != channel] = 0
        features[:, 0] += vision.conv1_bias[:, None]
        parts = (
            features.flatten(1, 2),
            vision.dense_convolution().permute(0, 3, 2, 1, 4).flatten(3).flatten(1, 2),
            vision.conv2_bias.repeat_interleave(4, dim=1),
            vision.linear1.weight,
            vision.linear1.bias,
            vision.linear2.weight,
            vision.linear2.bias,
        )
        return cls(*(pad(part, (0, -part.shape[-1] % 8)).contiguous().numpy() for part in parts))

    def member(self, number: int) -> "Weights":
        """Weights of a single member, with the leading axis."""
        return Weights(*(part[number, None] for part in self))


class DirectEncoder:
    """Encoder with the present weights of a stack on the CPU."""

    def __init__(self, stack: Stack) -> None:
        """Encode with `stack`."""
        self._stack = stack
        self._parameters = list(stack.vision.parameters()) if stack.vision else []
        self._changes = -1

    @torch.no_grad()
    def __call__(self, worlds: Sequence[VisibleLayout], positions: Tensor) -> Tensor | None:
        """Context codes at `positions` `[M, ..., 2]` (u) in one world, or in B, member-major: `[M, ..., C]`.

        None if only PyTorch can compute them, as where nothing is seen in fog.
        """
        places, num_members = for_compiled(positions), len(self._stack.seeds)
        if any(world.hidden for world in worlds):
            return None
        if places is None or len(positions) != num_members or not self._readable():
            return None
        from affmap.compiled.direct import codes_at

        scenes = [world.arrays[places.dtype] for world in worlds]
        num_groups = num_members if len(scenes) == 1 else len(scenes)
        places = places.reshape(num_groups, len(places) // num_groups, 2)

        def compute(weights: Weights, codes: np.ndarray) -> None:
            if len(scenes) == 1:
                codes_at(*scenes[0], *weights, places, codes)
                return
            for number, scene in enumerate(scenes):
                own = weights.member(number * num_members // num_groups)
                codes_at(*scene, *own, places[number, None], codes[number, None])

        return self._encode(compute, places.shape[:2], positions.shape[:-1])

    @torch.no_grad()
    def of_views(self, views: Tensor) -> Tensor | None:
        """Context codes of views `[M, P, K, 11, 11]` bool, own views for each member: `[M, P, C]`.

        None if only PyTorch can compute them.
        """
        if not compiled.enabled() or views.device.type != "cpu" or not self._readable():
            return None
        from affmap.compiled.direct import codes_of

        pictures = views.contiguous().numpy()

        def compute(weights: Weights, codes: np.ndarray) -> None:
            codes_of(*weights, pictures, codes)

        return self._encode(compute, views.shape[:2], views.shape[:2])

    def _encode(
        self, compute: Callable[[Weights, np.ndarray], None], grouped: Sequence[int], shape: Sequence[int]
    ) -> Tensor:
        """Codes `[*shape, C]`, from `compute`, which writes outputs of the last layer `[*grouped, C]`."""
        self.weights()  # arranges those that changed
        codes = np.empty((*grouped, self._stack.context_size), np.float32)
        for weights, units in self._passes:
            outputs = np.empty_like(codes)
            compute(weights, outputs)
            codes[..., units] = outputs[..., units]
        result = torch.from_numpy(codes.reshape(*shape, codes.shape[-1]))
        return (
            result if self._empty is None else result - self._empty.view(-1, *[1] * (result.ndim - 2), codes.shape[-1])
        )

    @torch.no_grad()
    def weights(self) -> Weights:
        """Present weights of a vision model on the CPU, rearranged after changes."""
        changes = num_changes(self._parameters)
        if changes != self._changes:
            vision = self._stack.vision
            assert vision is not None
            self._weights, self._changes = Weights.of(vision), changes
            self._passes = [(self._weights, slice(None))]
            if vision.encoder == "channels":
                self._passes = [(Weights.of(vision, channel), units) for channel, units in vision.units()]
            self._empty = None if vision.encoder == "plain" else self._empty_code()
        return self._weights

    def _empty_code(self) -> Tensor:
        """`VisionModel.empty_code` by compiled code, in which a member has the same bits alone and among others."""
        from affmap.compiled.direct import codes_of

        size = len(self._stack.seeds), 1, self._stack.num_channels, PIXELS, PIXELS
        codes = np.empty((*size[:2], self._stack.context_size), np.float32)
        codes_of(*self._weights, np.zeros(size, bool), codes)
        return torch.from_numpy(codes[:, 0])

    def _readable(self) -> bool:
        """Whether there is a vision model whose weights compiled code can read."""
        return bool(self._parameters) and readable(self._parameters)
