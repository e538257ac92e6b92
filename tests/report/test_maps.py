"""References: hand-placed positions, maps whose codes are written by hand, NumPy's singular value decomposition."""

import numpy as np
import pytest

from affmap.report import maps, statistics
from affmap.report.statistics import Verdict
from affmap.report.tables import Circle, Maps, World

X, Y = np.arange(151) * 0.02, np.arange(101) * 0.02
EVERYWHERE = np.ones((4, 5), dtype=bool)
BLOCKED = {"right": (1, 0), "left": (-1, 0), "upper": (0, 1), "lower": (0, -1)}


def blocked_direction_codes(world: World, obstacle_sign: float = 1.0) -> np.ndarray:
    """`[Y, X, 2]`: within 0.12 u of a surface the code points towards it, elsewhere it is zero.

    With `obstacle_sign` -1 it points away from obstacles, so that their sides look like the wrong border sides.
    """
    nodes = np.stack(np.meshgrid(X, Y), axis=-1)
    codes = np.zeros(nodes.shape)
    for circle in world.obstacles:
        offset = np.array([circle.x, circle.y]) - nodes
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        near = distance < circle.radius + 0.12
        codes += obstacle_sign * np.where(near, offset / np.maximum(distance, 1e-9), 0.0)
    distances = {"left": nodes[..., 0], "right": 3 - nodes[..., 0], "lower": nodes[..., 1], "upper": 2 - nodes[..., 1]}
    for side, distance in distances.items():
        codes += np.where(distance[..., None] < 0.12, np.array(BLOCKED[side], dtype=float), 0.0)
    return codes


def stack(codes: np.ndarray, members: int = 6) -> Maps:
    """Members whose codes are rotated and shrunk: neither may matter."""
    angles = np.arange(members)
    turns = np.stack([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
    turned = np.einsum("yxc,mcd->myxd", codes, turns) / (1 + angles)[:, None, None, None]
    return Maps(turned.astype(np.float32), np.zeros(turned.shape), X, Y, np.arange(members))


def test_surface_distance_by_hand(world: World) -> None:
    positions = np.array([[0.1, 1.0], [0.75, 0.9], [0.75, 0.5], [3.1, 1.0]])
    assert maps.surface_distance(positions, world) == pytest.approx([0.1, 0.2, -0.2, -0.1])
    assert maps.reachable(positions, world).tolist() == [True, True, False, False]


def test_codes_that_point_at_surfaces_satisfy_both_parts(world: World) -> None:
    arrays = stack(blocked_direction_codes(world))
    for compare in (maps.obstacle_contrast, maps.side_match):
        smaller, larger = compare(arrays, world)
        assert statistics.lower(smaller, larger).verdict == Verdict.HOLDS
        assert np.ptp(smaller) < 1e-3 and np.ptp(larger) < 1e-3, "turning and scaling a member's codes changes nothing"


def test_matching_sides_by_hand(world: World) -> None:
    """On the axes codes are unit vectors: 0 from the match, sqrt 2 from two borders, 2 from the opposite one."""
    arrays = stack(blocked_direction_codes(world))
    smaller, larger = maps.side_match(arrays, world)
    possible = maps.reachable(arrays.nodes, world)
    sample = blocked_direction_codes(world)[possible]
    scale = np.sqrt(sample.var(axis=0).sum())
    assert smaller == pytest.approx(np.zeros(6), abs=0.02 / scale), (
        "half a node of distance to the axis is a small angle"
    )
    assert larger == pytest.approx(np.full(6, (2 + 2 * np.sqrt(2)) / 3 / scale), rel=0.01)


def test_codes_that_point_away_from_obstacles_fail_the_second_part(world: World) -> None:
    arrays = stack(blocked_direction_codes(world, obstacle_sign=-1.0))
    assert statistics.lower(*maps.obstacle_contrast(arrays, world)).verdict == Verdict.HOLDS
    assert statistics.lower(*maps.side_match(arrays, world)).verdict == Verdict.DOES_NOT_HOLD


def test_a_constant_map_decides_nothing(world: World) -> None:
    codes = np.full((6, 101, 151, 3), np.float32(0.1))
    for compare in (maps.obstacle_contrast, maps.side_match):
        outcome = statistics.lower(*compare(Maps(codes, codes, X, Y, np.arange(6)), world))
        assert outcome.verdict == Verdict.NOT_DECIDED


def test_a_world_where_nothing_can_be_seen_alone_gives_no_scores() -> None:
    crowded = World("crowded", (3.0, 2.0), (Circle(1.5, 1.0, 0.9, "obstacle"),), 0.1, 0.2, 0.06)
    arrays = stack(blocked_direction_codes(crowded))
    smaller, larger = maps.side_match(arrays, crowded)
    assert len(smaller) == len(larger)
    no_obstacle = World("empty", (3.0, 2.0), (), 0.1, 0.2, 0.06)
    assert len(maps.side_match(arrays, no_obstacle)[0]) == 0


def test_principal_components_are_the_singular_vectors() -> None:
    sample = np.random.default_rng(0).normal(size=(200, 5)) * (3.0, 1.0, 0.3, 2.0, 0.1)
    basis = maps.principal_components(sample)
    reference = np.linalg.svd(sample - sample.mean(axis=0), full_matrices=False)[2].T
    assert np.abs(np.sum(basis * reference, axis=0)) == pytest.approx(np.ones(5)), "the same axes up to signs"
    assert (basis[np.abs(basis).argmax(axis=0), np.arange(5)] > 0).all(), "the largest loading is positive"


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
