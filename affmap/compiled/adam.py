"""Clipping and Adam of a member's sub-model, in place.

`clip_per_member` and `torch.optim.Adam` are their reference.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from affmap.compiled.jit import inlined
from affmap.compiled.lanes import WIDTH, fma, load, splat, store

f32 = np.float32


class Adam(NamedTuple):
    """Numbers of an update; those of the vision model have no meaning without one."""

    step: int
    """Number of the update, from 1."""
    mean_decay: float
    square_decay: float
    eps: float
    rates: tuple[float, float]
    """Learning rates of the transition model and the vision model."""
    max_norms: tuple[NDArray[np.float32], NDArray[np.float32]]
    """Their clipping norms for each member, `[M]` each."""


@inlined
def clip(gradient: Any, count: int, max_norm: Any) -> None:
    """Scale the first `count` numbers of a gradient to a norm of at most `max_norm`; the rest is padding.

    All become NaN where one is.
    """
    squares, totals = splat(f32(0)), np.empty(WIDTH, f32)
    for i in range(0, count, WIDTH):
        squares = fma(load(gradient, i), load(gradient, i), squares)
    store(totals, 0, squares)
    factor = max_norm / (np.sqrt(totals.sum()) + f32(1e-6))
    if not factor > f32(1):
        for i in range(0, count, WIDTH):
            store(gradient, i, load(gradient, i) * splat(factor))


@inlined
def descend(weights: Any, means: Any, squares: Any, gradient: Any, start: int, rate: float, adam: Adam) -> None:
    """Make a step with one parameter, whose gradient begins at `start`."""
    keep_mean, keep_square = f32(adam.mean_decay), f32(adam.square_decay)
    new_mean, new_square = f32(1 - adam.mean_decay), f32(1 - adam.square_decay)
    size, eps = f32(rate / (1 - adam.mean_decay**adam.step)), f32(adam.eps)
    unbiased = f32(1 / np.sqrt(1 - adam.square_decay**adam.step))
    for i in range(len(weights)):
        slope = gradient[start + i]
        mean, square = keep_mean * means[i] + new_mean * slope, keep_square * squares[i] + new_square * slope * slope
        means[i], squares[i] = mean, square
        weights[i] -= size * mean / (np.sqrt(square) * unbiased + eps)
