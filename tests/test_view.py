"""`view` against a rasteriser of plain Python loops, against symmetry, and each library and batch against the other."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.view import EXTENT, PIXELS, VisibleLayout, view, views

pytestmark = pytest.mark.usefixtures("loops")
quick = settings(max_examples=60, deadline=None, derandomize=True)


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def worlds(draw: st.DrawFn) -> VisibleLayout:
    size = (draw(numbers(0.2, 4)), draw(numbers(0.2, 4)))
    num_channels = draw(st.integers(1, 4))
    channels = st.integers(0, num_channels - 1)
    circle = st.tuples(numbers(-0.5, size[0] + 0.5), numbers(-0.5, size[1] + 0.5), numbers(0.01, 1), channels)
    return VisibleLayout(size, num_channels, draw(channels), tuple(draw(st.lists(circle, max_size=5))))


points = st.tuples(numbers(-1, 5), numbers(-1, 5))


def rasterise(world: VisibleLayout, position: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """The picture, one pixel at a time, `[K, 11, 11]`; and which pixels lie so near an edge that rounding decides."""
    picture = np.zeros((world.num_channels, 11, 11), bool)
    unsure = np.zeros_like(picture)
    for row in range(11):
        for column in range(11):
            x = position[0] - 0.25 + (column + 0.5) * 0.5 / 11
            y = position[1] - 0.25 + (row + 0.5) * 0.5 / 11
            depth = max(-x, x - world.size[0], -y, y - world.size[1])  # how far outside the arena
            picture[world.border_channel, row, column] |= depth > 0
            unsure[world.border_channel, row, column] |= abs(depth) < 1e-9
            for center_x, center_y, radius, channel in world.circles:
                gap = math.hypot(x - center_x, y - center_y) - radius
                picture[channel, row, column] |= gap < 0
                unsure[channel, row, column] |= abs(gap) < 1e-9
    return picture, unsure


@quick
@given(worlds(), points)
def test_equals_a_rasteriser_of_plain_loops(world: VisibleLayout, position: tuple[float, float]) -> None:
    expected, unsure = rasterise(world, position)
    actual = view(world, np.array(position))
    assert actual.shape == expected.shape and actual.dtype == np.bool_
    np.testing.assert_array_equal(actual | unsure, expected | unsure)


@quick
@given(worlds(), st.lists(points, min_size=1, max_size=4), st.sampled_from(["float32", "float64"]))
def test_numpy_and_torch_give_equal_pictures(
    world: VisibleLayout, positions: list[tuple[float, float]], dtype: str
) -> None:
    array = np.array(positions, dtype)
    tensor = view(world, torch.from_numpy(array))
    assert isinstance(tensor, torch.Tensor) and tensor.dtype == torch.bool
    np.testing.assert_array_equal(view(world, array), tensor.numpy())


# Coordinates in 64ths: mirroring them is exact, and no pixel centre but the middle one can lie on an edge.
sixty_fourths = st.integers(-64, 256).map(lambda number: number / 64)


@quick
@given(
    st.tuples(sixty_fourths, sixty_fourths),
    st.lists(st.tuples(sixty_fourths, sixty_fourths, st.integers(1, 64).map(lambda n: n / 64), st.integers(0, 1))),
)
def test_mirroring_world_and_position_mirrors_the_view(
    position: tuple[float, float], circles: list[tuple[float, float, float, int]]
) -> None:
    """Symmetry of the square and the circle; the middle pixel lies exactly at the position."""
    x, y = position
    plain = view(VisibleLayout((3.0, 2.0), 2, 0, tuple(circles)), np.array([x, y]))
    left_right = VisibleLayout((3.0, 2.0), 2, 0, tuple((3 - cx, cy, radius, k) for cx, cy, radius, k in circles))
    np.testing.assert_array_equal(view(left_right, np.array([3 - x, y])), plain[:, :, ::-1])
    up_down = VisibleLayout((3.0, 2.0), 2, 0, tuple((cx, 2 - cy, radius, k) for cx, cy, radius, k in circles))
    np.testing.assert_array_equal(view(up_down, np.array([x, 2 - y])), plain[:, ::-1, :])
    swapped = VisibleLayout((2.0, 3.0), 2, 0, tuple((cy, cx, radius, k) for cx, cy, radius, k in circles))
    np.testing.assert_array_equal(view(swapped, np.array([y, x])), plain.transpose(0, 2, 1))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_middle_pixel_on_the_border_is_inside_on_all_sides(dtype: str) -> None:
    """Golden picture: at each border, the five columns (rows) beyond it are set, in every precision."""
    world = VisibleLayout((3.0, 2.0), 1, 0, ())
    left, right, bottom, top = view(world, np.array([[0, 1], [3, 1], [1, 0], [1, 2]], dtype))[:, 0]
    beyond = np.array([True] * 5 + [False] * 6)
    np.testing.assert_array_equal(left, np.tile(beyond, (11, 1)))
    np.testing.assert_array_equal(right, np.tile(beyond[::-1], (11, 1)))
    np.testing.assert_array_equal(bottom, np.tile(beyond, (11, 1)).T)
    np.testing.assert_array_equal(top, np.tile(beyond[::-1], (11, 1)).T)


def test_far_from_everything_is_empty_and_far_outside_is_border_only() -> None:
    """Closed form: half a view (0.25 u) from the next edge nothing is seen, beyond it everything."""
    world = VisibleLayout((3.0, 2.0), 3, 1, ((0.5, 0.5, 0.2, 0), (2.5, 1.5, 0.2, 2)))
    assert not view(world, np.array([1.5, 1.0])).any()
    for outside in ([-0.26, 1.0], [3.26, 1.0], [1.5, -0.26], [1.5, 2.26], [-9.0, 9.0]):
        picture = view(world, np.array(outside))
        assert picture[1].all() and not picture[[0, 2]].any()


def test_a_circle_is_painted_in_its_channel_only() -> None:
    """Golden picture: in the middle of a large circle its channel is full, the others are empty."""
    picture = view(VisibleLayout((3.0, 2.0), 3, 0, ((1.5, 1.0, 0.9, 2),)), np.array([1.5, 1.0]))
    assert picture[2].all() and not picture[:2].any()


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3), (2, 1, 4), (0,), (3, 0)])
def test_a_batch_of_any_shape_equals_each_alone(shape: tuple[int, ...]) -> None:
    world = VisibleLayout((3.0, 2.0), 2, 0, ((1.0, 1.0, 0.4, 1), (2.0, 0.5, 0.3, 0)))
    positions = np.random.default_rng(0).uniform([-0.2, -0.2], [3.2, 2.2], (*shape, 2))
    batch = view(world, positions)
    assert batch.shape == (*shape, 2, PIXELS, PIXELS)
    for index in np.ndindex(*shape):
        np.testing.assert_array_equal(batch[index], view(world, positions[index]))


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_views_of_several_worlds_are_those_of_each(shape: tuple[int, ...]) -> None:
    """Each world by itself; a single world is everybody's; other numbers of worlds are refused."""
    worlds = [VisibleLayout((3.0, 2.0), 2, 0, ((0.5 + x, 1.0, 0.4, 1),)) for x in (0.0, 0.7, 1.4)]
    positions = np.random.default_rng(0).uniform([1.2, 0.8], [1.8, 1.2], (3, *shape, 2))
    expected = [view(world, own) for world, own in zip(worlds, positions, strict=True)]
    np.testing.assert_array_equal(views(worlds, positions), expected)
    assert not np.array_equal(expected, view(worlds[0], positions))
    np.testing.assert_array_equal(views(worlds[:1], positions), view(worlds[0], positions))
    with pytest.raises(ValueError, match="there are 2 layouts; give one, or 3"):
        views(worlds[:2], positions)


def test_pixels_and_extent_are_the_papers() -> None:
    """Appendix A: 11 x 11 pixels for 0.5 x 0.5 u; the rasteriser above has these numbers written out."""
    assert (PIXELS, EXTENT) == (11, 0.5)


@pytest.mark.parametrize("library", [np.asarray, torch.as_tensor])
def test_nothing_is_seen_from_a_hidden_place(library: Callable[[np.ndarray], Any]) -> None:
    """By distance to two circles, one by one; elsewhere the view is that of the same world without them."""
    hidden = ((1.0, 1.0, 0.3), (1.5, 1.0, 0.4))
    world = VisibleLayout((2.0, 2.0), 1, 0, ((1.2, 1.1, 0.5, 0),))
    places = np.random.default_rng(0).uniform(0, 2, (100, 3, 2))
    seen = np.asarray(view(dataclasses.replace(world, hidden=hidden), library(places)))
    plain = np.asarray(view(world, library(places)))
    for index in np.ndindex(100, 3):
        inside = any(math.dist(places[index], (x, y)) < radius for x, y, radius in hidden)
        np.testing.assert_array_equal(seen[index], plain[index] & (not inside))
    assert (seen != plain).any()
