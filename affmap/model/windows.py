"""Views as references to the few distinct windows that they are made of.

The first convolution and the pooling of the vision model see a view only through 16 windows of 5 x 5 pixels, at
stride 2. The sixty thousand views of a data set hold a million windows, but only some hundreds of *different* ones,
and these only some dozens of different 3 x 3 patches: compute each of those once, then gather. Exact, because equal
windows have equal features.
"""

from typing import Any, NamedTuple

import torch
from torch import Tensor

WIDTH, STRIDE, PER_SIDE = 5, 2, 4
"""Pixels of a window's side, pixels between windows, windows along a view's side."""


class Windows(NamedTuple):
    """Views, taken apart."""

    ids: Tensor
    """`[..., 16]` int64: which distinct window stands where in each view, row by row."""
    patch_ids: Tensor
    """`[U, 9]` int64: which distinct patch stands where in each of the U distinct windows, row by row."""
    patches: Tensor
    """`[V, K * 9]` float: the V distinct patches of 3 x 3 pixels."""

    def select(self, key: Any) -> "Windows":
        """Some of the views: `key` indexes the axes of `ids` before the last."""
        return self._replace(ids=self.ids[key])


def take_apart(views: Tensor) -> Windows:
    """Find the distinct windows of `views` `[..., K, 11, 11]` bool.

    Raises:
        TypeError: the views are not boolean.
    """
    if views.dtype != torch.bool:
        raise TypeError(f"views have dtype {views.dtype}; they must be torch.bool, as affmap.view.view returns them.")
    # Each window's 25 pixels become one number, first along rows, then along columns.
    place = torch.arange(WIDTH, dtype=torch.uint8, device=views.device)
    rows = (views.byte().unfold(-1, WIDTH, STRIDE) << place).sum(-1, dtype=torch.int32)  # [..., K, 11, 4]
    numbers = (rows.unfold(-2, WIDTH, STRIDE) << WIDTH * place).sum(-1).flatten(-2)  # [..., K, 16] int64
    ids = torch.zeros_like(numbers[..., 0, :])
    distinct = ids.new_zeros(1, 0)  # [U, channels so far]
    for channel in numbers.unbind(-2):
        combined, ids = torch.unique((ids << WIDTH**2) | channel, return_inverse=True)
        new = combined & ((1 << WIDTH**2) - 1)
        distinct = torch.cat([distinct[combined >> WIDTH**2], new[:, None]], dim=1)
    pixels = (distinct[..., None] >> torch.arange(WIDTH**2, device=views.device)) & 1  # [U, K, 25]
    pixels = pixels.float().unflatten(-1, (WIDTH, WIDTH))
    patches = pixels.unfold(-2, 3, 1).unfold(-2, 3, 1).permute(0, 2, 3, 1, 4, 5)  # [U, 3, 3, K, 3, 3]
    patches, patch_ids = torch.unique(patches.flatten(3).flatten(0, 2), dim=0, return_inverse=True)
    return Windows(ids, patch_ids.view(-1, 9), patches)
