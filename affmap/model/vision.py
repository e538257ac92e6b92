"""The vision model: a local view -> a context code (Section 3.1, Appendix A).

Convolution - tanh - max-pooling - convolution - linear - linear, tanh after each. It sees pictures only, and knows
nothing of positions, motion or the world.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from affmap.model.stacked import Generators, StackedLinear, uniform
from affmap.model.windows import PER_SIDE, Windows


class Sizes(NamedTuple):
    """Widths of the vision model's layers."""

    channels: int
    """q, channels of the first convolution; the second has twice as many."""
    hidden: int
    """h, width of the first linear layer."""


def sizes(context_size: int) -> Sizes:
    """The paper's widths for a context size (Appendix A)."""
    if context_size < 5:
        return Sizes(channels=4, hidden=8)
    return Sizes(channels=4, hidden=16) if context_size < 32 else Sizes(channels=8, hidden=32)


def _placement() -> Tensor:
    """`[9, 16 * 4]`: 1 where a tap of a 3 x 3 kernel connects one of 4 x 4 inputs to one of 2 x 2 outputs."""
    inputs = torch.eye(PER_SIDE**2).view(PER_SIDE**2, 1, PER_SIDE, PER_SIDE)
    return nn.functional.unfold(inputs, 3).permute(1, 0, 2).flatten(1)


def _winners(convolved: Tensor, patch_ids: Tensor) -> Tensor:
    """Which patch has the largest value in each window: rows of `convolved` `[V, F]`, as `[U, F]` int64.

    Comparing nine times is faster than `argmax` over an axis in the middle, or than the gradient of `maximum`.
    """
    first, *others = patch_ids.unbind(1)
    best, winner = convolved.index_select(0, first), first[:, None]
    for patch in others:
        value = convolved.index_select(0, patch)
        winner = torch.where(value > best, patch[:, None], winner)
        best = torch.maximum(best, value)
    return winner


class VisionModel(nn.Module):
    """M vision models side by side."""

    def __init__(self, generators: Generators, num_channels: int, context_size: int) -> None:
        """Draw the weights of M models for views of `num_channels` (K) channels."""
        super().__init__()
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
        """Context codes of views.

        Args:
            windows: views with leading axis M (each member its own) or 1 (all members the same): `[M or 1, ...]`, with
                at least one more axis.

        Returns:
            `[M, ..., C]`, each in (-1, 1).
        """
        ids = windows.ids.flatten(1, -2)  # [M or 1, P, 16]
        table = self._window_features(windows)  # [U, M, q]
        num_members, channels = table.shape[1:]
        if len(ids) == 1:  # gather rows that hold all members' features: contiguous
            rows = table.flatten(1).index_select(0, ids[0].flatten())  # several times faster than indexing
            features = rows.view(*ids[0].shape, num_members, channels).permute(2, 0, 1, 3)
        else:
            members = torch.arange(num_members, device=ids.device)
            features = table[ids, members[:, None, None]]  # [M, P, 16, q]
        # On 4 x 4 inputs the second convolution is one product with a dense matrix [M, 16 q, 8 q].
        dense = (self.conv2_weight.flatten(-2) @ self.placement).unflatten(-1, (PER_SIDE**2, 4))
        dense = dense.permute(0, 3, 2, 1, 4).reshape(num_members, PER_SIDE**2 * channels, -1)
        bias = self.conv2_bias.repeat_interleave(4, dim=1)[:, None]
        hidden = torch.baddbmm(bias, features.reshape(num_members, -1, dense.shape[1]), dense).tanh()
        codes = self.linear2(self.linear1(hidden).tanh()).tanh()
        return codes.unflatten(1, windows.ids.shape[1:-1])

    def _window_features(self, windows: Windows) -> Tensor:
        """First convolution, pooling and tanh on each of the U distinct windows: `[U, M, q]`.

        tanh comes after the maximum instead of before it: it is monotone, so the numbers are the same.
        """
        weight = self.conv1_weight.flatten(2).permute(2, 0, 1)  # [K * 9, M, q]
        convolved = windows.patches @ weight.flatten(1)  # [V, M * q]
        pooled = convolved.gather(0, _winners(convolved.detach(), windows.patch_ids))  # [U, M * q]
        return (pooled.unflatten(-1, weight.shape[1:]) + self.conv1_bias).tanh()
