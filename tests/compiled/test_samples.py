"""Batches for compiled loops: order and filling by hand."""

import numpy as np
import torch

from affmap.compiled.samples import samples
from affmap.model.windows import take_apart


def test_samples_are_ordered_by_their_views_and_rows_are_padded() -> None:
    """Three samples, two views; the second and third show the first view."""
    changes, targets = np.array([[1, 2], [3, 4], [5, 6]], np.float32), np.array([[7, 8], [9, 0], [1, 1]], np.float32)
    throttles = np.arange(12, dtype=np.float32).reshape(3, 4)
    window_ids, patch_ids = np.arange(32).reshape(2, 16) % 3, np.arange(27).reshape(3, 9) % 5
    actual = samples(
        np.array([1, 0, 0]), window_ids, patch_ids, np.ones((5, 9), np.float32), changes, throttles, targets
    )
    expected = [[3, 4, 4, 5, 6, 7, 0, 0], [5, 6, 8, 9, 10, 11, 0, 0], [1, 2, 0, 1, 2, 3, 0, 0], *5 * [8 * [0]]]
    assert actual.inputs.tolist() == expected and actual.inputs.dtype == np.float32
    assert actual.targets.tolist() == [[9, 0], [1, 1], [7, 8]] and actual.starts.tolist() == [0, 2, 3]
    assert actual.patches.shape == (8, 16) and actual.patches.sum() == 45 and actual.patch_ids is patch_ids
    assert actual.taps.shape == (8, 4, 9) and not actual.taps[2:].any()


def test_taps_are_those_of_a_convolution() -> None:
    """`torch.nn.functional.unfold` of the numbers of windows, which are all different."""
    views = torch.rand(3, 1, 11, 11, generator=torch.Generator().manual_seed(0)) < 0.5
    ids, window_ids, patch_ids, patches = (part.numpy() for part in take_apart(views))
    zeros = np.zeros((3, 4), np.float32)
    actual = samples(ids, window_ids, patch_ids, patches, zeros[:, :2], zeros, zeros[:, :2])
    pictures = torch.from_numpy(window_ids).view(-1, 1, 4, 4).double()
    expected = torch.nn.functional.unfold(pictures, 3).mT  # [D, 4, 9]
    np.testing.assert_array_equal(actual.taps[: len(window_ids)], expected)
