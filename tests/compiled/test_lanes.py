"""Vectors in compiled loops against NumPy in float64; limits, infinities and NaN included."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from scipy import special

from affmap.compiled import lanes, search
from affmap.compiled.lanes import WIDTH, load, splat, store

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


@pytest.mark.parametrize(
    ("function", "expected", "values", "tolerance"),
    [
        (lanes.exp2, np.exp2, spaced(-124, 125), 2e-7),
        (lanes.log, np.log, np.exp2(spaced(-126, 127)), 2e-7),
        (lanes.log, np.log, spaced(0.9, 1.1), 2e-7),
        (lanes.sigmoid, lambda x: 1 / (1 + np.exp2(x)), spaced(-40, 29), 3e-7),
        (lanes.floor, np.floor, spaced(-9, 9), 0),
        (lanes.root, np.sqrt, spaced(0, 100), 1e-7),
        (search._erf_inverse, special.erfinv, spaced(-0.99999, 0.99999), 5e-7),
    ],
)
def test_functions(
    function: Callable[..., Any], expected: Callable[[np.ndarray], np.ndarray], values: np.ndarray, tolerance: float
) -> None:
    np.testing.assert_allclose(applied(function, values), expected(values.astype(float)), rtol=tolerance, atol=1e-38)


def test_error_function() -> None:
    values = spaced(-6, 6)
    np.testing.assert_allclose(applied(search._erf, values), special.erf(values.astype(float)), atol=5e-7)


def test_powers_at_the_limits() -> None:
    powers = applied(lanes.exp2, np.array([-np.inf, -200, -126, 127, 200, np.inf, np.nan, 0], f32))
    np.testing.assert_array_equal(powers, np.array([0, 0, 0, np.inf, np.inf, np.inf, np.nan, 1], f32))


def test_logarithms_at_the_limits() -> None:
    logarithms = applied(lanes.log, special_values())
    assert logarithms[0] == logarithms[4] == -np.inf and logarithms[7] == 0


def test_inverse_of_the_error_function_at_its_limits() -> None:
    """6, where the inverse is infinite: PyTorch's value is clamped to that."""
    found = applied(search._erf_inverse, np.array([1, -1, 0, 0.5, -0.5, 0.25, 0.75, 0], f32))
    assert found[0] == 6 and found[1] == -6 and found[2] == 0


@pytest.mark.parametrize(("function", "expected"), [(lanes.at_most, np.minimum), (lanes.at_least, np.maximum)])
def test_limits(function: Callable[..., Any], expected: Callable[..., np.ndarray]) -> None:
    """NaN stays NaN."""
    values, limit = special_values(), np.full(WIDTH, 0.5, f32)
    np.testing.assert_array_equal(applied(function, values, limit), expected(values, limit))


def test_where_less() -> None:
    @numba.njit
    def chosen(a: Any, b: Any) -> Any:
        return lanes.where_less(a, b, splat(f32(1)), splat(f32(2)))

    values, limit = special_values(), np.full(WIDTH, 0.5, f32)
    np.testing.assert_array_equal(applied(chosen, values, limit), np.where(values < limit, f32(1), f32(2)))


def test_arithmetic() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 10 * WIDTH)).astype(f32)
    for function, expected in (
        (numba.njit(lambda a, b: a + b), a + b),
        (numba.njit(lambda a, b: a - b), a - b),
        (numba.njit(lambda a, b: a * b), a * b),
        (numba.njit(lambda a, b: a / b), a / b),
        (numba.njit(lambda a, b: lanes.fma(a, b, a)), (a.astype(float) * b + a).astype(f32)),
    ):
        np.testing.assert_array_equal(applied(function, a, b), expected)


def test_sigmoids_are_four_of_them() -> None:
    """One division for four differs by rounding."""
    values = spaced(-40, 29).reshape(-1, 4, WIDTH)

    @numba.njit
    def four(x: Any, result: Any) -> None:
        for k in range(0, len(x), 4 * WIDTH):
            a, b, c, d = lanes.sigmoids(load(x, k), load(x, k + WIDTH), load(x, k + 2 * WIDTH), load(x, k + 3 * WIDTH))
            store(result, k, a)
            store(result, k + WIDTH, b)
            store(result, k + 2 * WIDTH, c)
            store(result, k + 3 * WIDTH, d)

    result = np.empty(values.size, f32)
    four(values.reshape(-1), result)
    np.testing.assert_allclose(result, 1 / (1 + np.exp2(values.reshape(-1).astype(float))), rtol=6e-7)


def test_totals_columns_and_single_numbers() -> None:
    """Reductions and moves between lanes, against the same of a matrix."""
    rows = np.arange(64, dtype=f32).reshape(8, 8) ** 2

    @numba.njit
    def moved(x: Any, columns: Any, totals: Any, others: Any) -> Any:
        a, b, c, d = load(x, 0), load(x, 8), load(x, 16), load(x, 24)
        turned = lanes.transposed(a, b, c, d, load(x, 32), load(x, 40), load(x, 48), load(x, 56))
        for k in range(8):
            store(columns, 8 * k, turned[k])
        lanes.store_totals(totals, 0, a, b, c, d)
        store(others, 0, lanes.spread(b, 3))
        store(others, 8, lanes.broadcast(x, 21))
        return lanes.whole(b, 3), lanes.any_less(a, splat(f32(0))), lanes.any_less(a, splat(f32(1)))

    columns, totals, others = np.empty(64, f32), np.empty(4, f32), np.empty(16, f32)
    assert moved(rows.reshape(-1), columns, totals, others) == (121, False, True)
    np.testing.assert_array_equal(columns.reshape(8, 8), rows.T)
    np.testing.assert_array_equal(totals, rows[:4].sum(1))
    np.testing.assert_array_equal(others, [121.0] * 8 + [441.0] * 8)
