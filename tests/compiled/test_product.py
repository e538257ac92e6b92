"""Products of small matrices: NumPy's."""

import numpy as np
import pytest

from affmap.compiled.product import Matrix, Shape, product


@pytest.mark.parametrize("rows", [8, 16])
@pytest.mark.parametrize("depth", [0, 1, 5, 64])
@pytest.mark.parametrize("width", [8, 16, 24, 40])
def test_products_are_those_of_numpy(rows: int, depth: int, width: int) -> None:
    """`start + a @ b`, also of a transposed matrix, and with a single row to start from."""
    rng = np.random.default_rng(0)
    start, a, b = (rng.standard_normal(shape, np.float32) for shape in ((rows, width), (rows, depth), (depth, width)))
    for left in (Matrix(a.ravel(), depth, 1), Matrix(a.T.ravel(), 1, rows)):
        for step, first in ((width, start), (0, start[:1])):
            result = np.full((rows, width), np.nan, np.float32)
            product(Matrix(start.ravel(), step, 1), left, b.ravel(), result.ravel(), Shape(rows, depth, width))
            np.testing.assert_allclose(result, first + a @ b, rtol=1e-5, atol=1e-5)


def test_nothing_beside_the_result_is_written() -> None:
    """By hand: what lies behind stays as it was."""
    ones, result = np.ones(64, np.float32), np.full(72, 7, np.float32)
    product(Matrix(ones, 0, 1), Matrix(ones, 8, 1), ones, result, Shape(8, 8, 8))
    assert result.tolist() == [9] * 64 + [7] * 8
