"""Views as references to the few distinct windows that they are made of.

The first convolution and the pooling of the vision model see a view only through 16 windows of 5 x 5 pixels, at
stride 2. The sixty thousand views of a data set hold a million windows, but only some hundreds of *different* ones,
and these only some dozens of different 3 x 3 patches: compute each of those once, then gather. Exact, because equal
windows have equal features.
"""

from typing import NamedTuple

import torch
from torch import Tensor

WIDTH, STRIDE, PER_SIDE = 5, 2, 4
"""Pixels of a window's side, pixels between windows, windows along a view's side."""


class Windows(NamedTuple):
    """Views, taken apart."""

    index: Tensor
    """`[..., 16]` int64: which distinct window stands where in each view, row by row."""
    patch_index: Tensor
    """`[U, 9]` int64: which distinct patch stands where in each of the U distinct windows, row by row."""
    patches: Tensor
    """`[V, K * 9]` float: the V distinct patches of 3 x 3 pixels."""

    def __getitem__(self, key: object) -> "Windows":  # type: ignore[override]
        """Some of the views, indexed as a tensor of the shape of `index` without its last axis would be."""
        return self._replace(index=self.index[key])


def take_apart(views: Tensor) -> Windows:
    """Find the distinct windows of `views` `[..., K, 11, 11]` bool.

    Raises:
        TypeError: the views are not boolean.
    """
    if views.dtype != torch.bool:
        raise TypeError(f"views have dtype {views.dtype}; they must be torch.bool, as affmap.view.view returns them.")
    bits = views.long()
    last = STRIDE * (PER_SIDE - 1) + 1
    # Each window's 25 pixels become one number, first along rows, then along columns.
    rows = sum(bits[..., i : i + last : STRIDE] << i for i in range(WIDTH))  # [..., K, 11, 4]
    numbers = sum(rows[..., i : i + last : STRIDE, :] << (WIDTH * i) for i in range(WIDTH))  # [..., K, 4, 4]
    numbers = numbers.flatten(-2)  # [..., K, 16]
    index = torch.zeros_like(numbers[..., 0, :])
    distinct = index.new_zeros(1, 0)  # [U, channels so far]
    for channel in numbers.unbind(-2):
        combined, index = torch.unique((index << WIDTH**2) | channel, return_inverse=True)
        new = combined & ((1 << WIDTH**2) - 1)
        distinct = torch.cat([distinct[combined >> WIDTH**2], new[:, None]], dim=1)
    pixels = (distinct[..., None] >> torch.arange(WIDTH**2, device=views.device)) & 1  # [U, K, 25]
    pixels = pixels.float().unflatten(-1, (WIDTH, WIDTH))
    patches = pixels.unfold(-2, 3, 1).unfold(-2, 3, 1).permute(0, 2, 3, 1, 4, 5)  # [U, 3, 3, K, 3, 3]
    patches, patch_index = torch.unique(patches.flatten(3).flatten(0, 2), dim=0, return_inverse=True)
    return Windows(index, patch_index.view(-1, 9), patches)
