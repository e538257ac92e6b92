"""References: hand-placed positions, views rasterized finely, NumPy's singular value decomposition."""

from collections.abc import Callable

import numpy as np
import pytest

from affmap.results import maps
from affmap.results.files import World

EVERYWHERE = np.ones((4, 5), dtype=bool)


def test_surface_distance_by_hand(world: World) -> None:
    positions = np.array([[0.1, 1.0], [0.75, 0.9], [0.75, 0.5], [3.1, 1.0]])
    assert maps.surface_distance(positions, world) == pytest.approx([0.1, 0.2, -0.2, -0.1])
    assert maps.reachable(positions, world).tolist() == [True, True, False, False]


def test_circles_without_resistance_can_be_entered(load_world: Callable[[str], World]) -> None:
    center = np.array([[0.75, 0.5], [0.375, 1.0]])
    assert maps.reachable(center, load_world("fog")).tolist() == [True, True]
    assert maps.reachable(center, load_world("three_looks")).tolist() == [False, True], (
        "an obstacle, a meaningless circle"
    )


@pytest.mark.parametrize("layout", ["three_looks", "two_obstacles", "four_properties"])
def test_what_is_seen_alone_is_what_a_fine_picture_shows_alone(layout: str, load_world: Callable[[str], World]) -> None:
    """The square of a view, sampled 0.01 u apart: no sample is in another thing; where not alone, one nearly is."""
    world = load_world(layout)
    nodes = np.random.default_rng(3).uniform((0, 0), world.size, size=(150, 2))
    offsets = np.linspace(-0.25, 0.25, 51)
    seen = nodes[:, None, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1)  # [nodes, 51, 51, 2]
    for things in ((), ("left",), tuple(maps.DIRECTIONS), (world.circles[-1],)):
        depths = [-maps.border_distance(seen, world, side) for side in maps.DIRECTIONS if side not in things]
        depths += [-maps.circle_distance(seen, circle) for circle in world.circles if circle not in things]
        deepest = np.max(depths, axis=(0, 2, 3))  # how far the nearest sample is inside another thing, u
        alone = maps.sees_only(nodes, world, things)
        assert alone.any() and not alone.all()
        assert (deepest[alone] <= 1e-9).all() and (deepest[~alone] > -0.008).all()


def test_codes_on_a_line_vary_in_one_channel() -> None:
    """Rank 1: red follows the position on the line from 0 to 1, green and blue are neutral."""
    position = np.linspace(0, 1, 20).reshape(4, 5)
    painted = maps.colors(position[..., None] * np.array([1.0, 2.0, -0.5, 0.2]), EVERYWHERE)
    assert painted[0, 0, 0] == 0.0 and painted[-1, -1, 0] == 1.0
    assert (np.diff(painted[..., 0].ravel()) >= 0).all()
    assert (painted[..., 1:] == 0.5).all()


@pytest.mark.parametrize("context_size", [0, 1, 2, 3, 8])
def test_every_context_size_is_painted_in_the_unit_cube(context_size: int) -> None:
    codes = np.random.default_rng(1).normal(size=(4, 5, context_size)).astype(np.float32)
    painted = maps.colors(codes, EVERYWHERE)
    assert painted.shape == (4, 5, 3)
    assert painted.min() >= 0.0 and painted.max() <= 1.0
    assert (painted[..., context_size:] == 0.5).all(), "channels without a component are neutral"
    assert (painted[..., :context_size].std(axis=(0, 1)) > 0.1).all()


def test_unreachable_nodes_do_not_choose_the_colors() -> None:
    codes = np.random.default_rng(2).normal(size=(4, 5, 3))
    fit = EVERYWHERE.copy()
    fit[0, 0] = False
    outlier = codes.copy()
    outlier[0, 0] = 1e3
    assert maps.colors(outlier, fit)[fit] == pytest.approx(maps.colors(codes, fit)[fit])
