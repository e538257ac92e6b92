"""Functions of vectors in compiled loops, applied to arrays; needs numba."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from affmap.compiled.lanes import WIDTH, load, store

f32 = np.float32


def applied(function: Callable[..., Any], *arrays: np.ndarray) -> np.ndarray:
    """What a function of vectors makes of arrays of eight numbers, or of many eights."""
    number = len(arrays)

    @numba.njit
    def one(x: Any, result: Any) -> None:
        for k in range(0, len(x), WIDTH):
            store(result, k, function(load(x, k)))

    @numba.njit
    def two(x: Any, y: Any, result: Any) -> None:
        for k in range(0, len(x), WIDTH):
            store(result, k, function(load(x, k), load(y, k)))

    result = np.empty_like(arrays[0])
    (one, two)[number - 1](*arrays, result)
    return result


def spaced(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, 1000 * WIDTH).astype(f32)


def special_values() -> np.ndarray:
    return np.array([0, np.inf, -np.inf, np.nan, 1e-40, 3e38, -3e38, 1], f32)
