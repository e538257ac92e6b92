"""The vision model: a local view -> a context code (Section 3.1, Appendix A).

Convolution - tanh - max-pooling - convolution - linear - linear, tanh after each. It sees pictures only, and knows
nothing of positions, motion or the world.

Two variations beyond the paper prepare codes for transition models that add up effects (`affmap.model.effects`). Both
measure codes from that of the empty view, so that free space has the code 0:

- `centered` encodes the whole view, less the code of the empty view;
- `channels` encodes each channel of the view by itself, with the same weights, into units of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn.functional import embedding

from affmap.model.layers import Generators, StackedLinear, tanh, uniform
from affmap.model.registry import Encoder, unit_ends
from affmap.model.windows import PER_SIDE, Windows, empty_view


class Sizes(NamedTuple):
    """Widths of the vision model's layers."""

    channels: int
    """q, channels of the first convolution; the second has twice as many."""
    hidden: int
    """h, width of the first linear layer."""


def sizes(context_size: int) -> Sizes:
    """Widths of the paper's layers for a context size (Appendix A)."""
    if context_size < 5:
        return Sizes(channels=4, hidden=8)
    return Sizes(channels=4, hidden=16) if context_size < 32 else Sizes(channels=8, hidden=32)


def _placement() -> Tensor:
    """`[9, 16 * 4]`: 1 where a tap of a 3 x 3 kernel connects one of 4 x 4 inputs to one of 2 x 2 outputs."""
    inputs = torch.eye(PER_SIDE**2, dtype=torch.float32, device="cpu").view(PER_SIDE**2, 1, PER_SIDE, PER_SIDE)
    return nn.functional.unfold(inputs, 3).permute(1, 0, 2).flatten(1)


def _winners(convolved: Tensor, patch_ids: Tensor) -> Tensor:
    """Index of the patch with the largest value in each window: for features of patches `[F, V]`, `[F, U]` int64.

    Comparing nine times, with bytes for the places, is faster than `max` over an axis and its gradient.
    """
    first, *others = patch_ids.unbind(1)
    best = convolved.index_select(1, first)
    place = torch.zeros(best.shape, dtype=torch.uint8, device=best.device)
    for number, patch in enumerate(others, start=1):
        value = convolved.index_select(1, patch)
        place = torch.maximum(place, (value > best).view(torch.uint8) * number)
        best = torch.maximum(best, value)
    return patch_ids.T.gather(0, place.long())


class _Take(torch.autograd.Function):
    """Selects columns of a matrix `[F, n]` by indices `[k]`: `[F, k]`.

    As `index_select`, but gradients are added up in rows: for frequent columns (a blank window), every addition would
    have to wait for the one before.
    """

    @staticmethod
    def forward(ctx: Any, columns: Tensor, ids: Tensor) -> Tensor:
        ctx.save_for_backward(ids)
        ctx.num_columns = columns.shape[1]
        return columns.index_select(1, ids)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (ids,) = ctx.saved_tensors
        rows = gradient.new_zeros(ctx.num_columns, len(gradient))
        return rows.index_add_(0, ids, gradient.T.contiguous()).T, None


def _take(columns: Tensor, ids: Tensor) -> Tensor:
    """Select columns of `[M, F, n]` by indices `[...]`, the same for all M: `[M, F, ...]`."""
    columns_by_id = _Take.apply(columns.flatten(0, 1), ids.flatten())
    return columns_by_id.view(*columns.shape[:2], *ids.shape)


class VisionModel(nn.Module):
    """M vision models side by side."""

    def __init__(
        self, generators: Generators, num_channels: int, context_size: int, encoder: Encoder = "plain"
    ) -> None:
        """Draw the weights of M models for views of `num_channels` (K) channels; `encoder` see above."""
        super().__init__()
        self.encoder = encoder
        channels, hidden = sizes(context_size)
        self.conv1_weight = uniform(generators, (channels, num_channels, 3, 3), num_channels * 9)
        self.conv1_bias = uniform(generators, (channels,), num_channels * 9)
        self.conv2_weight = uniform(generators, (2 * channels, channels, 3, 3), channels * 9)
        self.conv2_bias = uniform(generators, (2 * channels,), channels * 9)
        self.linear1 = StackedLinear(generators, 8 * channels, hidden)
        self.linear2 = StackedLinear(generators, hidden, context_size)
        self.register_buffer("placement", _placement(), persistent=False)
        self.placement: Tensor

    def encode(self, windows: Windows) -> Tensor:
        """Encode views as context codes.

        Args:
            windows: views with leading axis M (each member its own) or 1 (all members the same), `[M or 1, ...]`,
                with at least one more axis.

        Returns:
            `[M, ..., C]`, each in (-1, 1), or in (-2, 2) where codes are measured from that of the empty view.
        """
        if self.encoder == "channels":
            passes = (self._encode_distinct(windows.only(channel))[:, units] for channel, units in self.units())
            codes = torch.cat(list(passes), dim=1)
        else:
            codes = self._encode_distinct(windows)  # [M, C, D]
        if self.encoder != "plain":
            codes = codes - self.empty_code()[..., None]
        if len(windows.ids) == 1:
            return _take(codes, windows.ids[0]).movedim(1, -1)
        first = torch.arange(len(codes), device=codes.device) * codes.shape[-1]
        rows = windows.ids + first.view(-1, *[1] * (windows.ids.ndim - 1))
        return embedding(rows, codes.mT.flatten(0, 1))

    def units(self) -> list[tuple[int, slice]]:
        """Each of K channels with the units of the code that `channels` gives it: C / K of them, rounded."""
        num_channels, context_size = self.conv1_weight.shape[2], self.linear2.bias.shape[1]
        ends = [0, *unit_ends(context_size, num_channels)]
        return [(channel, slice(*ends[channel : channel + 2])) for channel in range(num_channels)]

    def empty_code(self) -> Tensor:
        """Output of the last layer for an empty view, `[M, C]`."""
        return self._encode_distinct(empty_view(self.conv1_weight))[..., 0]

    def _encode_distinct(self, windows: Windows) -> Tensor:
        """Outputs of the last layer for the D distinct views, `[M, C, D]`."""
        features = _take(self._window_features(windows), windows.window_ids.T).flatten(1, 2)  # [M, 16 q, D]
        # On 4 x 4 inputs the second convolution is one product with a dense matrix [M, 8 q, 16 q].
        dense = self.dense_convolution().permute(0, 1, 4, 2, 3).reshape(len(features), -1, features.shape[1])
        bias = self.conv2_bias.repeat_interleave(4, dim=1)[..., None]
        hidden = tanh(torch.baddbmm(bias, dense, features).mT)  # [M, D, 8 q]
        return tanh(self.linear2(tanh(self.linear1(hidden)))).mT

    def dense_convolution(self) -> Tensor:
        """The second convolution's weight from each of 4 x 4 inputs to each of 2 x 2 outputs: `[M, 2 q, q, 16, 4]`."""
        return (self.conv2_weight.flatten(-2) @ self.placement).unflatten(-1, (PER_SIDE**2, 4))

    def _window_features(self, windows: Windows) -> Tensor:
        """First convolution, pooling and tanh on each of the U distinct windows: `[M, q, U]`.

        tanh comes after the maximum instead of before it: it is monotone, so the numbers are the same.
        """
        convolved = self.conv1_weight.view(self.conv1_bias.numel(), -1) @ windows.patches.T  # [M * q, V]
        pooled = convolved.gather(1, _winners(convolved.detach(), windows.patch_ids))  # [M * q, U]
        return tanh(pooled.view(*self.conv1_bias.shape, -1) + self.conv1_bias[..., None])
