"""Views laid over each other, from which codes learn to add up.

Where the worlds of the data hold one property each, no recorded view shows two of them. But two views can be laid over
each other, channel by channel, as if one place had the properties of both; no physics is needed for that. Only views
without a filled channel in common are paired, so that nothing hides behind anything.
"""

from __future__ import annotations

import numpy as np
import torch

from affmap.model.windows import Windows, take_apart

NUM_PAIRS = 4096
"""Pairs drawn once, before training."""

PAIRS_PER_UPDATE = 64
"""Pairs chosen from these for each update."""

_DRAWS = 16 * NUM_PAIRS  # more than enough: of random pairs from the paper's four worlds two in five are of use


def paste(views: np.ndarray, rng: np.random.Generator) -> Windows | None:
    """Draw pairs of views and lay them over each other.

    Args:
        views: recorded ones, `[S, T, K, 11, 11]` bool.
        rng: draws the pairs.

    Returns:
        `[1, P, 4]`, P up to `NUM_PAIRS`: the first view, the second, both over each other, and an empty view. None if
        all views fill the same channels, so that there is nothing to compose.
    """
    pictures = views.reshape(-1, *views.shape[2:])
    first, second = (pictures[rng.integers(len(pictures), size=_DRAWS)] for _ in range(2))
    filled = [np.any(view, axis=(-2, -1)) for view in (first, second)]  # [draws, K]
    useful = filled[0].any(axis=1) & filled[1].any(axis=1) & ~(filled[0] & filled[1]).any(axis=1)
    if not useful.any():
        return None
    first, second = (view[useful][:NUM_PAIRS] for view in (first, second))
    four = np.stack([first, second, first | second, np.zeros_like(first)], axis=1)
    return take_apart(torch.from_numpy(four)[None])
