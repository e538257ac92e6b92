"""Vectors in compiled loops against NumPy; limits, infinities and NaN included."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from vectors import applied, special_values

from affmap.compiled import lanes
from affmap.compiled.lanes import WIDTH, load, splat, store

f32 = np.float32


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
