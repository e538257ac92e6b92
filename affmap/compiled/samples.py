"""A batch for compiled loops: samples ordered by their views, rows padded to multiples of eight."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from affmap.compiled.layout import NUM_INPUTS, NUM_PLACES, NUM_TAPS, WIDTH, round_up

_WINDOWS = np.arange(16).reshape(4, 4)
_TAPS = np.lib.stride_tricks.sliding_window_view(_WINDOWS, (3, 3)).reshape(NUM_PLACES, NUM_TAPS)
"""Index of a view's window at each tap of each place of the second convolution."""


class Samples(NamedTuple):
    """A batch of N samples with D distinct views; members share it.

    Rows of inputs, views and patches are padded to multiples of eight.
    """

    inputs: NDArray[np.float32]
    """`[N, 8]`: scaled changes of position, throttles, zeros."""
    targets: NDArray[np.float32]
    """`[N, 2]`, not padded: scaled changes of position."""
    starts: NDArray[np.int64]
    """`[D + 1]`, not padded: start of each view's samples, and their end."""
    taps: NDArray[np.int64]
    """`[D, 4, 9]`: index among U windows at each tap of each place of the second convolution."""
    patch_ids: NDArray[np.int64]
    """`[U, 9]`: index of each patch of each window."""
    patches: NDArray[np.float32]
    """`[V, K * 9 padded]`: the distinct patches."""


def samples(
    ids: NDArray[np.int64],
    window_ids: NDArray[np.int64],
    patch_ids: NDArray[np.int64],
    patches: NDArray[np.float32],
    changes: NDArray[np.float32],
    throttles: NDArray[np.float32],
    targets: NDArray[np.float32],
) -> Samples:
    """Order samples and pad rows.

    Args:
        ids: `[N]`, index of each sample's view among D distinct ones; without a vision model the same for all.
        window_ids: `[D, 16]`, as in `affmap.model.windows`.
        patch_ids: `[U, 9]`
        patches: `[V, K * 9]`
        changes: `[N, 2]`, scaled.
        throttles: `[N, 4]`
        targets: `[N, 2]`, scaled.
    """
    order = ids.argsort(kind="stable")
    inputs = np.zeros((round_up(len(ids)), WIDTH), np.float32)
    inputs[: len(ids), :2] = changes[order]
    inputs[: len(ids), 2:NUM_INPUTS] = throttles[order]
    starts = np.append(0, np.bincount(ids, minlength=len(window_ids)).cumsum())
    taps = np.zeros((round_up(len(window_ids)), NUM_PLACES, NUM_TAPS), np.int64)
    taps[: len(window_ids)] = window_ids[:, _TAPS]
    pixels = np.zeros((round_up(len(patches)), round_up(patches.shape[1])), np.float32)
    pixels[: len(patches), : patches.shape[1]] = patches
    return Samples(inputs, targets[order], starts, taps, patch_ids, pixels)
