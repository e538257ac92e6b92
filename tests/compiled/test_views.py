"""Views from compiled code against those of NumPy and PyTorch, bit for bit."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap import compiled
from affmap.view import EXTENT, PIXELS, VisibleLayout, view

quick = settings(max_examples=200, deadline=None, derandomize=True)

# Whole numbers of half pixels: centres of pixels lie on borders and rims, where the last bit decides.
lattice = st.integers(-30, 60).map(lambda number: number * EXTENT / PIXELS / 2)
anywhere = st.floats(-1, 3, allow_nan=False)
number = st.one_of(lattice, anywhere)
strange = st.sampled_from([np.nan, np.inf, -np.inf, 1e20, -1e20, 1e-30])


@st.composite
def worlds(draw: st.DrawFn) -> VisibleLayout:
    num_channels = draw(st.integers(1, 3))
    channels = st.integers(0, num_channels - 1)
    circle = st.tuples(number, number, st.one_of(lattice.map(abs), st.floats(0.01, 1)), channels)
    return VisibleLayout(
        (draw(st.floats(0.2, 2)), 1.0), num_channels, draw(channels), tuple(draw(st.lists(circle, max_size=5)))
    )


@quick
@given(
    worlds(),
    st.lists(st.tuples(st.one_of(number, strange), st.one_of(number, strange)), min_size=1, max_size=8),
    st.sampled_from([np.float32, np.float64]),
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy's, of infinite numbers
def test_views_are_those_of_numpy_and_torch(
    world: VisibleLayout, places: list[tuple[float, float]], dtype: type
) -> None:
    """Arrays and tensors in both precisions, rims and borders on the centres of pixels, and places that are none."""
    positions = np.array(places, dtype)
    with compiled.switched(False):
        expected = view(world, positions)
        np.testing.assert_array_equal(view(world, torch.from_numpy(positions)).numpy(), expected)
    actual = view(world, positions)
    assert actual.dtype == np.bool_ and actual.shape == expected.shape
    np.testing.assert_array_equal(actual, expected)
    np.testing.assert_array_equal(view(world, torch.from_numpy(positions)).numpy(), expected)


def test_every_kind_of_array_is_taken() -> None:
    """Read-only, in another order, of another library, with a gradient, of a type that is not compiled: NumPy's."""
    world = VisibleLayout((3.0, 2.0), 2, 0, ((1.0, 1.0, 0.4, 1),))
    positions = np.random.default_rng(0).uniform([0.5, 0.5], [1.5, 1.5], (3, 4, 2)).astype(np.float32)
    fixed = positions.copy()
    fixed.flags.writeable = False
    with compiled.switched(False):
        expected = view(world, positions)
    np.testing.assert_array_equal(view(world, fixed), expected)
    np.testing.assert_array_equal(view(world, np.asfortranarray(positions)), expected)
    np.testing.assert_array_equal(view(world, positions.astype(">f4")), expected)
    tensor = torch.from_numpy(positions)
    np.testing.assert_array_equal(view(world, tensor.clone().requires_grad_()).numpy(), expected)
    np.testing.assert_array_equal(view(world, tensor.transpose(0, 1)).numpy(), expected.swapaxes(0, 1))
    for dtype in (torch.float16, torch.bfloat16):
        assert view(world, tensor.to(dtype)).shape == expected.shape
