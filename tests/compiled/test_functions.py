"""Functions of vectors against NumPy and SciPy in float64, limits and infinities included."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from scipy import special
from vectors import applied, spaced, special_values

from affmap.compiled import functions, lanes
from affmap.compiled.lanes import WIDTH, load, store

f32 = np.float32


@pytest.mark.parametrize(
    ("function", "expected", "values", "tolerance"),
    [
        (functions.exp2, np.exp2, spaced(-124, 125), 2e-7),
        (functions.log, np.log, np.exp2(spaced(-126, 127)), 2e-7),
        (functions.log, np.log, spaced(0.9, 1.1), 2e-7),
        (functions.sigmoid, lambda x: 1 / (1 + np.exp2(x)), spaced(-40, 29), 3e-7),
        (lanes.floor, np.floor, spaced(-9, 9), 0),
        (lanes.root, np.sqrt, spaced(0, 100), 1e-7),
        (functions.erf_inverse, special.erfinv, spaced(-0.99999, 0.99999), 5e-7),
    ],
)
def test_functions(
    function: Callable[..., Any], expected: Callable[[np.ndarray], np.ndarray], values: np.ndarray, tolerance: float
) -> None:
    np.testing.assert_allclose(applied(function, values), expected(values.astype(float)), rtol=tolerance, atol=1e-38)


def test_error_function() -> None:
    values = spaced(-6, 6)
    np.testing.assert_allclose(applied(functions.erf, values), special.erf(values.astype(float)), atol=5e-7)


def test_powers_at_the_limits() -> None:
    powers = applied(functions.exp2, np.array([-np.inf, -200, -126, 127, 200, np.inf, np.nan, 0], f32))
    np.testing.assert_array_equal(powers, np.array([0, 0, 0, np.inf, np.inf, np.inf, np.nan, 1], f32))


def test_logarithms_at_the_limits() -> None:
    logarithms = applied(functions.log, special_values())
    assert logarithms[0] == logarithms[4] == -np.inf and logarithms[7] == 0


def test_inverse_of_the_error_function_at_its_limits() -> None:
    """6, where the inverse is infinite: PyTorch's value is clamped to that."""
    actual = applied(functions.erf_inverse, np.array([1, -1, 0, 0.5, -0.5, 0.25, 0.75, 0], f32))
    assert actual[0] == 6 and actual[1] == -6 and actual[2] == 0


def test_sigmoids_are_four_of_them() -> None:
    """One division for four differs by rounding."""
    values = spaced(-40, 29).reshape(-1, 4, WIDTH)

    @numba.njit
    def four(x: Any, result: Any) -> None:
        for k in range(0, len(x), 4 * WIDTH):
            a, b, c, d = functions.sigmoids(
                load(x, k), load(x, k + WIDTH), load(x, k + 2 * WIDTH), load(x, k + 3 * WIDTH)
            )
            store(result, k, a)
            store(result, k + WIDTH, b)
            store(result, k + 2 * WIDTH, c)
            store(result, k + 3 * WIDTH, d)

    result = np.empty(values.size, f32)
    four(values.reshape(-1), result)
    np.testing.assert_allclose(result, 1 / (1 + np.exp2(values.reshape(-1).astype(float))), rtol=6e-7)


def test_tanh_is_that_of_numpy() -> None:
    """From values that vanish to those that overflow; infinity and NaN."""
    values = np.concatenate([np.linspace(-20, 20, 4000), np.geomspace(1e-30, 1e30, 92), [np.inf, -np.inf, np.nan, 0]])
    values = values.astype(f32)
    np.testing.assert_allclose(applied(functions.tanh, values), np.tanh(values.astype(float)), rtol=0, atol=2e-7)
