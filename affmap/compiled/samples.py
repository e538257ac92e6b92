"""A batch for compiled loops: samples ordered by the views that they show, rows filled up to eights."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from affmap.compiled.layout import NUM_INPUTS, NUM_PLACES, NUM_TAPS, WIDTH, filled

_WINDOWS = np.arange(16).reshape(4, 4)
_TAPS = np.lib.stride_tricks.sliding_window_view(_WINDOWS, (3, 3)).reshape(NUM_PLACES, NUM_TAPS)
"""Which of a view's windows is at each tap of each place of the second convolution."""


class Samples(NamedTuple):
    """A batch of N samples with D distinct views; members share it.

    Rows of inputs, views and patches are filled up to eights.
    """

    inputs: NDArray[np.float32]
    """`[N, 8]`: scaled changes of position, throttles, zeros."""
    targets: NDArray[np.float32]
    """`[N, 2]`, not filled up: scaled changes of position."""
    starts: NDArray[np.int64]
    """`[D + 1]`, not filled up: where each view's samples begin, and their end."""
    taps: NDArray[np.int64]
    """`[D, 4, 9]`: which of U windows is at each tap of each place of the second convolution."""
    patch_ids: NDArray[np.int64]
    """`[U, 9]`: which patch stands where in each window."""
    patches: NDArray[np.float32]
    """`[V, K * 9 filled up]`: the distinct patches."""


def samples(
    ids: NDArray[np.int64],
    window_ids: NDArray[np.int64],
    patch_ids: NDArray[np.int64],
    patches: NDArray[np.float32],
    changes: NDArray[np.float32],
    throttles: NDArray[np.float32],
    targets: NDArray[np.float32],
) -> Samples:
    """Order samples and fill rows up.

    Args:
        ids: `[N]`, which of D distinct views each sample shows; without a vision model the same for all.
        window_ids: `[D, 16]`, as in `affmap.model.windows`.
        patch_ids: `[U, 9]`
        patches: `[V, K * 9]`
        changes: `[N, 2]`, scaled.
        throttles: `[N, 4]`
        targets: `[N, 2]`, scaled.
    """
    order = ids.argsort(kind="stable")
    inputs = np.zeros((filled(len(ids)), WIDTH), np.float32)
    inputs[: len(ids), :2] = changes[order]
    inputs[: len(ids), 2:NUM_INPUTS] = throttles[order]
    starts = np.append(0, np.bincount(ids, minlength=len(window_ids)).cumsum())
    taps = np.zeros((filled(len(window_ids)), NUM_PLACES, NUM_TAPS), np.int64)
    taps[: len(window_ids)] = window_ids[:, _TAPS]
    pixels = np.zeros((filled(len(patches)), filled(patches.shape[1])), np.float32)
    pixels[: len(patches), : patches.shape[1]] = patches
    return Samples(inputs, targets[order], starts, taps, patch_ids, pixels)
