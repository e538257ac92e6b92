"""The hyperbolic tangent of vectors: NumPy's."""

import numpy as np
import pytest

pytest.importorskip("numba")

from affmap.compiled.jit import compiled
from affmap.compiled.lanes import load, store, tanh


@compiled
def tangents(values: np.ndarray, result: np.ndarray) -> None:
    for place in range(0, len(values), 8):
        store(result, place, tanh(load(values, place)))


def test_tanh_is_that_of_numpy() -> None:
    """In double precision, from values that vanish to those that overflow; infinity and NaN."""
    values = np.concatenate([np.linspace(-20, 20, 4000), np.geomspace(1e-30, 1e30, 90), [np.inf, -np.inf, np.nan, 0]])
    values = np.resize(values, 4096).astype(np.float32)
    result = np.empty_like(values)
    tangents(values, result)
    np.testing.assert_allclose(result, np.tanh(values.astype(float)), rtol=0, atol=2e-7)
