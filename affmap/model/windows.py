"""Views as references to the few distinct pictures, windows and patches that they are made of.

The first convolution and the pooling of the vision model see a view only through 16 windows of 5 x 5 pixels, at
stride 2. The sixty thousand views of a data set hold some thousands of *different* ones, these some hundreds of
different windows, and these some dozens of different 3 x 3 patches: compute each of those once, then gather. Exact,
because equal pixels have equal features.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap import compiled

WIDTH, STRIDE, PER_SIDE = 5, 2, 4
"""Pixels of a window's side, pixels between windows, windows along a view's side."""

_BITS = 22
"""Pixels per word: float32 holds all integers up to 2 ** 24."""


class Windows(NamedTuple):
    """Views `[...]`, taken apart."""

    ids: Tensor
    """`[...]` int64: index of each view among D distinct ones."""
    window_ids: Tensor
    """`[D, 16]` int64: indices of the windows in each distinct view among U distinct ones, row by row."""
    patch_ids: Tensor
    """`[U, 9]` int64: indices of the patches in each distinct window among V distinct ones, row by row."""
    patches: Tensor
    """`[V, K * 9]` float: the distinct patches of 3 x 3 pixels."""

    def select(self, key: Any) -> "Windows":
        """Select views by indexing `ids` with `key`, with only the distinct views and windows that occur in them."""
        views, ids = self.ids[key].unique(return_inverse=True)
        windows, window_ids = self.window_ids.index_select(0, views).unique(return_inverse=True)
        return Windows(ids, window_ids, self.patch_ids.index_select(0, windows), self.patches)

    def only(self, channel: int) -> "Windows":
        """The same views with all channels empty but one."""
        patches = torch.zeros_like(self.patches)
        patches[:, 9 * channel : 9 * channel + 9] = self.patches[:, 9 * channel : 9 * channel + 9]
        return self._replace(patches=patches)


def empty_view(like: Tensor) -> Windows:
    """A view without anything in it, `[1]`; its K channels and its device are those of a kernel `[..., K, 3, 3]`."""
    patch = like.new_zeros(1, like.shape[-3] * 9)
    ids, window_ids, patch_ids = (patch.new_zeros(1, num, dtype=torch.int64) for num in (1, PER_SIDE**2, 9))
    return Windows(ids, window_ids, patch_ids, patch)


def take_apart(views: Tensor) -> Windows:
    """Find the distinct views, windows and patches in `views` `[..., K, 11, 11]` bool.

    Raises:
        TypeError: the views are not boolean.
    """
    if views.dtype != torch.bool:
        raise TypeError(f"views have dtype {views.dtype}; they must be torch.bool, as affmap.view.view returns them.")
    pictures = views.reshape(-1, *views.shape[-3:])
    first, ids = distinct(pictures.flatten(1))
    windows = pictures[first].unfold(-2, WIDTH, STRIDE).unfold(-2, WIDTH, STRIDE)  # [D, K, 4, 4, 5, 5]
    windows = windows.permute(0, 2, 3, 1, 4, 5).flatten(0, 2)  # [D * 16, K, 5, 5]
    first, window_ids = distinct(windows.flatten(1))
    patches = windows[first].unfold(-2, 3, 1).unfold(-2, 3, 1).permute(0, 2, 3, 1, 4, 5)  # [U, 3, 3, K, 3, 3]
    patches = patches.flatten(3).flatten(0, 2)  # [U * 9, K * 9]
    first, patch_ids = distinct(patches)
    window_ids, patch_ids = window_ids.view(-1, PER_SIDE**2), patch_ids.view(-1, 9)
    return Windows(ids.view(views.shape[:-3]), window_ids, patch_ids, patches[first].float())


def distinct(pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Find the distinct rows of `pixels` `[n, k]` bool.

    Returns:
        Index of one row of each kind, `[D]`, and the kind of each row, `[n]`; kinds are in the order of their pixels.
    """
    if not compiled.enabled() or pixels.device.type != "cpu":
        return _sort(pixels)
    from affmap.compiled.distinct import number_rows

    num_rows, num_pixels = pixels.shape
    table = np.full(2 ** (2 * num_rows).bit_length(), -1, np.int32)
    first, ids = np.empty((2, num_rows), np.int64)
    words = np.empty((num_rows, math.ceil(num_pixels / 64)), np.uint64)
    number_rows(pixels.contiguous().numpy(), table, words, first, ids)
    some, order = _sort(pixels[first[: ids.max(initial=-1) + 1]])  # these are few
    return torch.from_numpy(first)[some], order[ids]


def _sort(pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Find the distinct rows with PyTorch, as `distinct`."""
    ids = kinds = torch.zeros(len(pixels), dtype=torch.int64, device=pixels.device)
    for word in words(pixels).long().unbind(-1):  # one number after the other: many times as fast as `dim=0`
        kinds, ids = torch.unique((ids << _BITS) | word, return_inverse=True)
    places = torch.arange(len(pixels), device=pixels.device)
    return ids.new_empty(len(kinds)).scatter_(0, ids, places), ids


def words(pixels: Tensor) -> Tensor:
    """Pack `[..., k]` bool into as few numbers as hold it exactly: `[..., k / 22, rounded up]` float32."""
    place = torch.arange(pixels.shape[-1], dtype=torch.float32, device=pixels.device)
    word = torch.arange(math.ceil(len(place) / _BITS), device=pixels.device)
    weight = torch.where(place[:, None] // _BITS == word, 2.0 ** (place % _BITS)[:, None], 0.0)
    return pixels.float() @ weight
