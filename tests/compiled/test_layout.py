"""Places of parameters in matrices: each has a place of its own, and transposing brings it to the other."""

import numpy as np
import pytest

from affmap.compiled import lanes
from affmap.compiled.layout import WIDTH, Parameters, layout, round_up

CASES = [(9, 4, 8, 1, 32), (36, 4, 16, 5, 7), (36, 8, 32, 32, 32), (9, 4, 8, 0, 8)]


def test_a_vector_holds_as_much_as_in_lanes() -> None:
    """The layout itself needs no numba."""
    assert lanes.WIDTH == WIDTH


def test_the_next_multiple_of_eight() -> None:
    """By hand."""
    assert [round_up(count) for count in (0, 1, 7, 8, 9, 36)] == [0, 8, 8, 8, 16, 40]


@pytest.mark.parametrize("case", CASES)
def test_each_number_has_a_place_of_its_own(case: tuple[int, int, int, int, int]) -> None:
    """Counted, in matrices and in the transposed ones, which have the same size."""
    pixels, channels, hidden, code, units = case
    places = layout(*case)
    counts = {"hidden": (6 + code) * units, "output": 4 * units, "output_bias": 4}
    if code:
        counts |= {"conv1": pixels * channels, "conv2": 2 * channels * channels * 9, "linear1": 8 * channels * hidden}
        counts |= {"linear2": hidden * code, "conv1_bias": channels, "conv2_bias": 2 * channels}
        counts |= {"linear1_bias": hidden, "linear2_bias": code}
    for name in Parameters._fields:
        for kind in (places.straight, places.turned):
            own = getattr(kind, name)
            assert len(own) == len(set(own.tolist())) == counts.get(name, 0), name
            assert not len(own) or 0 <= own.min() <= own.max() < getattr(places.sizes, name)


def test_a_matrix_and_the_transposed_one() -> None:
    """The weights of the perceptron's outputs by hand, `[32, 4]`: rows of 8, and rows of 32."""
    places = layout(9, 4, 8, 1, 32)
    weight = np.arange(32 * 4).reshape(32, 4)
    straight, turned = np.zeros((32, 8), int), np.zeros((8, 32), int)
    straight.ravel()[places.straight.output] = weight.ravel()
    turned.ravel()[places.turned.output] = weight.ravel()
    np.testing.assert_array_equal(straight[:, :4], weight)
    np.testing.assert_array_equal(turned, straight.T)
