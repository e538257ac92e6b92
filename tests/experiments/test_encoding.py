"""References: maps whose codes are written by hand, so that every distance is known; loops over nodes."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from stage_files import make_world

from affmap.env.layout import Circle, Layout
from affmap.experiments import encoding
from affmap.results import statistics
from affmap.results.files import Maps
from affmap.results.statistics import Order, Verdict

RADIUS = 0.06
"""Of the vehicle, u."""

X, Y = np.arange(151) * 0.02, np.arange(101) * 0.02
NODES = np.stack(np.meshgrid(X, Y), axis=-1)
BLOCKED = {"right": (1, 0), "left": (-1, 0), "upper": (0, 1), "lower": (0, -1)}

LOWER: Order = "lower"
HIGHER: Order = "higher"
LoadWorld = Callable[[str], Layout]


def blocked_direction_codes(world: Layout, obstacle_sign: float = 1.0) -> np.ndarray:
    """`[Y, X, 2]`: within 0.12 u of a surface the code points towards it, elsewhere it is zero.

    With `obstacle_sign` -1 it points away from obstacles, so that their sides look like the wrong border sides.
    """
    codes = np.zeros(NODES.shape)
    for circle in world.obstacles:
        offset = np.array([circle.x, circle.y]) - NODES
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        near = distance < circle.radius + 0.12
        codes += obstacle_sign * np.where(near, offset / np.maximum(distance, 1e-9), 0.0)
    distances = {"left": NODES[..., 0], "right": 3 - NODES[..., 0], "lower": NODES[..., 1], "upper": 2 - NODES[..., 1]}
    for side, distance in distances.items():
        codes += np.where(distance[..., None] < 0.12, np.array(BLOCKED[side], dtype=float), 0.0)
    return codes


def stack(codes: np.ndarray, members: int = 6) -> Maps:
    """Members whose codes are turned (in the plane of the first two) and shrunk: neither may matter."""
    angles = np.arange(members)
    turns = np.tile(np.eye(codes.shape[-1]), (members, 1, 1))
    turns[:, :2, :2] = np.stack([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]).transpose(
        2, 0, 1
    )
    turned = np.einsum("yxc,mcd->myxd", codes, turns) / (1 + angles)[:, None, None, None]
    return painted(turned)


def painted(codes: np.ndarray) -> Maps:
    """Maps with `codes` `[M, Y, X, C]`, and codes of zero before training."""
    values = codes.astype(np.float32)
    none = np.empty((0, *values.shape))
    return Maps(values, np.zeros(values.shape), none, np.empty(0, int), X, Y, np.arange(len(values)))


def spread(codes: np.ndarray, world: Layout) -> float:
    """Standard deviation of codes `[Y, X, C]` over the nodes that no obstacle or border keeps the vehicle from."""
    clear = (X >= 0.06 - 1e-9) & (X <= 2.94 + 1e-9) & ((Y >= 0.06 - 1e-9) & (Y <= 1.94 + 1e-9))[:, None]
    for circle in world.obstacles:
        clear &= np.hypot(NODES[..., 0] - circle.x, NODES[..., 1] - circle.y) >= circle.radius + 0.06 - 1e-6
    return float(np.sqrt(codes[clear].var(axis=0).sum()))


def near(circle: Circle) -> np.ndarray:
    """Nodes `[Y, X]` up to 0.12 u from the rim of a circle, or inside it."""
    return np.hypot(NODES[..., 0] - circle.x, NODES[..., 1] - circle.y) < circle.radius + 0.12


def test_codes_that_point_at_surfaces_satisfy_both_parts(world: Layout) -> None:
    arrays = stack(blocked_direction_codes(world))
    for compare, order in ((encoding.obstacle_contrast, HIGHER), (encoding.side_match, LOWER)):
        first, second = compare(arrays, world, RADIUS)
        assert statistics.paired(first, second, order).verdict == Verdict.HOLDS
        assert np.ptp(first) < 1e-3 and np.ptp(second) < 1e-3, "turning and scaling a member's codes changes nothing"


def test_matching_sides_by_hand(world: Layout) -> None:
    """On the axes codes are unit vectors: 0 from the match, sqrt 2 from two borders, 2 from the opposite one."""
    arrays = stack(blocked_direction_codes(world))
    smaller, larger = encoding.side_match(arrays, world, RADIUS)
    scale = spread(blocked_direction_codes(world), world)
    assert smaller == pytest.approx(np.zeros(6), abs=0.02 / scale), (
        "half a node of distance to the axis is a small angle"
    )
    assert larger == pytest.approx(np.full(6, (2 + 2 * np.sqrt(2)) / 3 / scale), rel=0.01)


def test_codes_that_point_away_from_obstacles_fail_the_second_part(world: Layout) -> None:
    arrays = stack(blocked_direction_codes(world, obstacle_sign=-1.0))
    assert statistics.paired(*encoding.obstacle_contrast(arrays, world, RADIUS), HIGHER).verdict == Verdict.HOLDS
    assert statistics.paired(*encoding.side_match(arrays, world, RADIUS), LOWER).verdict == Verdict.DOES_NOT_HOLD


def test_a_constant_map_decides_nothing(world: Layout) -> None:
    codes = np.full((6, 101, 151, 3), np.float32(0.1))
    for compare in (encoding.obstacle_contrast, encoding.side_match):
        outcome = statistics.paired(*compare(painted(codes), world, RADIUS), LOWER)
        assert outcome.verdict == Verdict.NOT_DECIDED


def test_a_world_where_nothing_can_be_seen_alone_gives_no_scores() -> None:
    crowded = make_world((1.5, 1.0, 0.9, "obstacle"))
    arrays = stack(blocked_direction_codes(crowded))
    smaller, larger = encoding.side_match(arrays, crowded, RADIUS)
    assert len(smaller) == len(larger)
    no_obstacle = make_world()
    assert len(encoding.side_match(arrays, no_obstacle, RADIUS)[0]) == 0


@pytest.mark.parametrize("trace", [0.0, 0.3, 2.0])
def test_the_trace_of_meaningless_circles_by_hand(load_world: LoadWorld, trace: float) -> None:
    """Codes are 1 near obstacles, `trace` near and in meaningless circles, else 0: so are the distances to free space.

    Where more than one thing is seen codes are 9, which must not matter. Such nodes are those less than 0.25 u from the
    border, and those that come near a circle from the row of the other ones.
    """
    world = load_world("three_looks")
    codes = np.zeros((*NODES.shape[:2], 2))
    for circle in world.circles:
        codes[near(circle)] = (1.0, 0.0) if circle.effect == "obstacle" else (0.0, trace)
    y = NODES[..., 1]
    codes[(y < 0.24) | (y > 1.76) | (np.abs(y - 0.695) < 0.07) | (np.abs(y - 1.305) < 0.07)] = 9.0
    circles, obstacles = encoding.meaningless_trace(stack(codes), world, RADIUS)
    assert obstacles == pytest.approx(np.full(6, 1 / spread(codes, world)), rel=1e-5)
    assert circles == pytest.approx(trace * obstacles, rel=1e-5)


def test_the_inside_of_meaningless_circles_counts(load_world: LoadWorld) -> None:
    world = load_world("three_looks")
    codes = np.zeros((*NODES.shape[:2], 2))
    codes[50, 19] = 1.0  # (0.38, 1): beside the centre of one
    codes[25, 24] = 1.0  # (0.48, 0.5): beside an obstacle
    circles, obstacles = encoding.meaningless_trace(stack(codes), world, RADIUS)
    assert (circles > 0).all() and (obstacles > 0).all()


def test_a_world_without_meaningless_circles_has_no_trace_to_find(world: Layout) -> None:
    assert [len(part) for part in encoding.meaningless_trace(stack(blocked_direction_codes(world)), world, RADIUS)] == [
        0,
        0,
    ]


def test_looks_are_compared_at_the_same_offsets(load_world: LoadWorld) -> None:
    """Codes that point at an obstacle are the same at the same offsets, and would not be at mirrored ones."""
    world = load_world("three_looks")
    assert encoding.look_difference(stack(blocked_direction_codes(world)), world, RADIUS) == pytest.approx(
        np.zeros(6), abs=1e-6
    )


@pytest.mark.parametrize("other", [0.0, 0.5, 1.0])
def test_the_difference_between_looks_by_hand(load_world: LoadWorld, other: float) -> None:
    """Near upper obstacles codes are (1, 0), near lower ones (1 - other, other), other sqrt 2 apart."""
    world = load_world("three_looks")
    codes = np.zeros((*NODES.shape[:2], 2))
    for circle in world.obstacles:
        codes[near(circle)] = (1.0, 0.0) if circle.y > 1 else (1.0 - other, other)
    expected = other * np.sqrt(2) / spread(codes, world)
    assert encoding.look_difference(stack(codes), world, RADIUS) == pytest.approx(np.full(6, expected), rel=1e-5)


def test_obstacles_that_are_no_pair_are_not_compared(load_world: LoadWorld) -> None:
    """Different x, different radius, the same half."""
    centers = [(0.75, 0.5, 0.2), (1.5, 1.5, 0.2), (2.25, 0.5, 0.2), (2.25, 1.5, 0.18), (1.5, 1.2, 0.2)]
    world = make_world(*((*center, "obstacle") for center in centers))
    assert encoding.look_difference(stack(blocked_direction_codes(world)), world, RADIUS).shape == (0,)


def kinds_of_codes(world: Layout, fog: tuple[float, float, float]) -> np.ndarray:
    """`[Y, X, 3]`: 0 in free space, unit vectors of the blocked direction at the border, `fog` in fog."""
    border_only = make_world()
    codes = np.zeros((*NODES.shape[:2], 3))
    codes[..., :2] = blocked_direction_codes(border_only)
    for circle in world.circles:
        codes[near(circle)] = fog
    return codes


def separations(maps: Maps, world: Layout) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    pairs = itertools.combinations(("free space", "border", "fog"), 2)
    return {(kind, other): encoding.separation(maps, world, RADIUS, kind, [other]) for kind, other in pairs}


def test_kinds_of_places_by_hand(load_world: LoadWorld) -> None:
    """Codes do not scatter; the border's four, whose mean is 0, are 1 from free space and sqrt 2 from fog."""
    world = load_world("fog")
    codes = kinds_of_codes(world, (0.0, 0.0, 1.0))
    expected = {("free space", "border"): 1.0, ("free space", "fog"): 1.0, ("border", "fog"): np.sqrt(2)}
    for pair, distance in expected.items():
        apart, scatter = encoding.separation(stack(codes), world, RADIUS, pair[0], [pair[1]])
        assert scatter == pytest.approx(np.zeros(6), abs=1e-6)
        assert apart == pytest.approx(np.full(6, distance / spread(codes, world)), rel=1e-5)


def test_scatter_is_that_of_the_kind_that_scatters_more(load_world: LoadWorld) -> None:
    """In fog codes are 1 above or below their mean, column by column in turns; free space and border do not vary."""
    world = load_world("fog")
    codes = kinds_of_codes(world, (0.0, 0.0, 3.0))
    turns = np.where(np.arange(len(X)) % 2 == 0, 1.0, -1.0)
    codes[..., 2] += np.where(codes[..., 2] > 0, turns, 0.0)
    found = separations(stack(codes), world)
    sd = spread(codes, world)
    assert found["free space", "border"][1] == pytest.approx(np.zeros(6), abs=1e-6)
    for pair in (("free space", "fog"), ("border", "fog")):
        assert found[pair][1] == pytest.approx(np.full(6, 1 / sd), rel=0.02), "columns in a quarter are not quite even"
    assert found["free space", "fog"][0] == pytest.approx(np.full(6, 3 / sd), rel=0.02)


def test_fog_that_looks_like_a_side_of_the_border_is_not_apart_from_it(load_world: LoadWorld) -> None:
    """Three of four sides are far from it, and it is where the fourth is: the nearer of both views counts."""
    world = load_world("fog")
    codes = kinds_of_codes(world, (1.0, 0.0, 0.0))
    noise = np.random.default_rng(0).normal(0, 0.05, size=codes.shape)
    found = separations(stack(codes + noise), world)
    assert statistics.paired(*found["border", "fog"], HIGHER).verdict == Verdict.DOES_NOT_HOLD
    for pair in (("free space", "border"), ("free space", "fog")):
        assert statistics.paired(*found[pair], HIGHER).verdict == Verdict.HOLDS


def test_without_fog_there_is_nothing_to_tell_apart(world: Layout) -> None:
    found = separations(stack(blocked_direction_codes(world)), world)
    sizes = {pair: (len(apart), len(scatter)) for pair, (apart, scatter) in found.items()}
    assert sizes == {("free space", "border"): (6, 6), ("free space", "fog"): (0, 0), ("border", "fog"): (0, 0)}


def test_several_kinds_are_told_from_the_nearest_other(load_world: LoadWorld) -> None:
    """Codes are unit vectors of four properties: sqrt 2 from each other, but 1 from free space, which is 0.

    Where two pulls have one code they are 0 apart, and the others as before.
    """
    world = load_world("four_properties")
    kinds = ("obstacle", "fog", "force_up", "force_down")
    codes = np.zeros((*NODES.shape[:2], 4))
    for circle in world.circles:
        codes[near(circle)] = np.eye(4)[kinds.index(circle.effect)]
    alike = codes.copy()
    alike[codes[..., 3] == 1] = np.eye(4)[2]
    for values, expected in ((codes, (1.0, 1.0, 1.0, 1.0)), (alike, (1.0, 1.0, 0.0, 0.0))):
        for kind, distance in zip(kinds, expected, strict=True):
            others = ["free space", *(other for other in kinds if other != kind)]
            apart, scatter = encoding.separation(stack(values), world, RADIUS, kind, others)
            assert apart == pytest.approx(np.full(6, distance / spread(values, world)), rel=1e-5, abs=1e-6)
            assert scatter == pytest.approx(np.zeros(6), abs=1e-6)
