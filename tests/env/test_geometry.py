"""Whether worlds can be crossed: worlds made by hand whose answer is plain, and a graph search of our own."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.env import geometry
from affmap.env.body import Vehicle
from affmap.env.geometry import crossable, way_length
from affmap.env.layout import Acts, Layout
from affmap.env.physics import Physics

VEHICLE = Vehicle.load("vehicle", "default")  # radius 0.06 u, thrust 1 N, force 0.5 N
START, GOAL = np.array([0.2, 1.0]), np.array([2.8, 1.0])


def world(
    *circles: tuple[float, float, float, str], size: tuple[float, float] = (3.0, 2.0), acts: Acts = "rim"
) -> Layout:
    parts = [{"center": [x, y], "radius": r, "effect": e, "channel": "solid"} for x, y, r, e in circles]
    return Layout.load("layout", "original", size=size, circles=parts, acts=acts)


def wall(effect: str, x: float = 1.5) -> list[tuple[float, float, float, str]]:
    """Overlapping circles from the lower to the upper border."""
    return [(x, y, 0.2, effect) for y in np.arange(0, 2.01, 0.25).tolist()]


def test_a_free_arena_can_be_crossed() -> None:
    assert crossable(world(), VEHICLE, START, GOAL)
    assert crossable(world(), VEHICLE, START, START)


@pytest.mark.parametrize(
    ("effect", "answer"), [("obstacle", False), ("fog", False), ("none", True), ("force_up", True)]
)
def test_a_wall_blocks_where_its_circles_do(effect: str, answer: bool) -> None:
    """By hand: neighbours in the wall overlap (two fields at most, 1 N); the same in the other direction."""
    layout = world(*wall(effect))
    assert crossable(layout, VEHICLE, START, GOAL) is answer
    assert crossable(layout, VEHICLE, GOAL, START) is answer
    assert crossable(layout, VEHICLE, START, np.array([0.2, 1.8]))  # on the same side


@pytest.mark.parametrize("effect", ["obstacle", "fog"])
@pytest.mark.parametrize(("gap", "answer"), [(0.11, False), (0.118, False), (0.145, True), (0.2, True)])
def test_a_gap_lets_the_vehicle_through_if_it_is_wider(effect: str, gap: float, answer: bool) -> None:
    """By hand: two circles that leave a gap between them; the vehicle is 0.12 u wide, the grid is 0.01 u fine."""
    radius = (2.0 - gap) / 4  # centres on the borders would leave 2 - 2 r; these touch the borders
    layout = world((1.5, radius, radius, effect), (1.5, 2.0 - radius, radius, effect))
    assert crossable(layout, VEHICLE, START, GOAL) is answer


@pytest.mark.parametrize(("gap", "answer"), [(0.11, False), (0.135, True)])
def test_a_gap_at_the_border_counts_as_any_other(gap: float, answer: bool) -> None:
    """By hand: a circle that leaves a gap to the upper border and none to the lower."""
    radius = (2.0 - gap) / 2
    assert crossable(world((1.5, radius, radius, "obstacle")), VEHICLE, START, GOAL) is answer


@pytest.mark.parametrize(
    ("effects", "answer"),
    [
        (["force_up"], True),
        (["force_up"] * 2, True),
        (["force_up"] * 3, False),
        (["force_down"] * 2, True),
        (["force_down"] * 3, False),
        (["force_up"] * 3 + ["force_down"], True),
        (["force_down"] * 4 + ["force_up"], False),
        (["force_up"] * 3 + ["force_down"] * 3, True),
        (["none"] * 3, True),
    ],
)
def test_force_fields_add_up_and_block_where_they_are_too_strong(effects: list[str], answer: bool) -> None:
    """By hand: fields of 0.5 N over the whole height; two throttles push upwards with 1.414 N."""
    layout = world(*((1.5, 1.0, 1.1, effect) for effect in effects))
    assert crossable(layout, VEHICLE, START, GOAL) is answer


def test_forces_count_as_the_vehicle_has_them() -> None:
    """By hand: with half the thrust (0.707 N) two fields block; with three times the force (1.5 N) one does."""
    one, two = (world(*[(1.5, 1.0, 1.1, "force_up")] * number) for number in (1, 2))
    assert not crossable(two, VEHICLE.model_copy(update={"thrust": 0.5}), START, GOAL)
    assert crossable(one, VEHICLE.model_copy(update={"thrust": 0.5}), START, GOAL)
    assert not crossable(one, VEHICLE.model_copy(update={"force": 1.5}), START, GOAL)


@pytest.mark.parametrize(
    ("effect", "narrowest"), [("fog", {"rim": 0.13, "center": 0.01}), ("obstacle", {"rim": 0.13, "center": 0.13})]
)
def test_a_gap_in_fog_need_not_be_as_wide_as_the_vehicle_where_fog_acts_at_the_centre(
    effect: str, narrowest: dict[Acts, float]
) -> None:
    """By hand: a centre passes a gap of a grid step between two fogs, and obstacles are touched under either rule.

    The line of the grid between the circles is y = 1 u; on it a disc of 0.06 u passes a gap above 0.12 u.
    """
    for acts, least in narrowest.items():
        for gap, answer in ((least, True), (least - 0.02, False)):
            radius = (2.0 - gap) / 4
            layout = world((1.5, radius, radius, effect), (1.5, 2.0 - radius, radius, effect), acts=acts)
            assert crossable(layout, VEHICLE, START, GOAL) is answer, (acts, gap)


def test_a_field_acts_where_the_centre_is_inside() -> None:
    """By hand: three fields leave 0.5 u at the upper border, and a centre comes as near to it as the radius is.

    So a vehicle of 0.26 u passes by their rims with its centre outside; one of 0.49 u passes, one of 0.51 u does not.
    """
    layout = world(*[(1.5, 0.75, 0.75, "force_up")] * 3, acts="center")
    for radius, answer in ((0.06, True), (0.26, True), (0.49, True), (0.51, False)):
        vehicle = VEHICLE.model_copy(update={"radius": radius})
        ends = np.array([0.55, 1.0]), np.array([2.45, 1.0])
        assert crossable(layout, vehicle, *ends) is answer


@pytest.mark.parametrize(
    ("effect", "acts", "expected"),
    [
        ("fog", "center", [True, True, False, False, False]),
        ("force_up", "center", [True, True, False, False, False]),
        ("fog", "rim", [True, True, True, True, False]),
        ("force_down", "rim", [True, True, True, True, False]),
        ("obstacle", "center", [True, True, True, True, False]),
        ("obstacle", "rim", [True, True, True, True, False]),
    ],
)
def test_where_a_circle_acts(effect: str, acts: Acts, expected: list[bool]) -> None:
    """By hand: a disc of 0.06 u at 0, 0.199, 0.201, 0.259 and 0.261 u from the centre of a circle of 0.2 u."""
    layout = world((1.0, 1.0, 0.2, effect), acts=acts)
    places = np.array([[1.0, 1.0], [1.0, 1.199], [0.799, 1.0], [1.259, 1.0], [1.0, 0.739]])
    assert geometry.affected(places, layout, layout.circles[0], 0.06).tolist() == expected
    assert geometry.affected(places[:, None], layout, layout.circles[0], 0.06).shape == (5, 1)


def test_a_field_acts_as_soon_as_the_disc_reaches_it() -> None:
    """By hand: between fields and border are 0.5 u; a vehicle wider than that cannot stay out of the fields."""
    layout = world(*[(1.5, 0.75, 0.75, "force_up")] * 3)
    for radius, answer in ((0.06, True), (0.24, True), (0.26, False)):
        vehicle = VEHICLE.model_copy(update={"radius": radius})
        assert crossable(layout, vehicle, np.array([0.4, 1.0]), np.array([2.6, 1.0])) is answer


@pytest.mark.parametrize(("gap", "answer"), [(-0.00004, False), (0.04, True)])
def test_there_is_no_squeezing_through_diagonally(gap: float, answer: bool) -> None:
    """By hand: two obstacles on a falling diagonal shut off the lower left; between them meets a cell of the grid.

    Two opposite corners of that cell are free even where the gap is a little narrower than the vehicle.
    """
    radius = (0.5**0.5 * 2 - gap) / 2 - VEHICLE.radius
    layout = world((1.505, 0.505, radius, "obstacle"), (0.505, 1.505, radius, "obstacle"))
    assert crossable(layout, VEHICLE, np.array([0.2, 0.2]), np.array([2.8, 1.8])) is answer


RING = [
    (1.5 + 0.4 * np.cos(a), 1.0 + 0.4 * np.sin(a), 0.15, "obstacle") for a in np.linspace(0, 2 * np.pi, 13).tolist()
]


@pytest.mark.parametrize(
    "enclosed",
    [[1.5, 1.0], [1.9, 1.0], [0.05, 1.0], [-1.0, 1.0], [4.0, 1.0]],
    ids=["in a ring", "in an obstacle", "in a border", "outside, left", "outside, right"],
)
def test_an_enclosed_start_or_goal_is_not_reached(enclosed: list[float]) -> None:
    """By hand."""
    layout = world(*RING)
    assert crossable(layout, VEHICLE, START, GOAL)
    assert not crossable(layout, VEHICLE, np.array(enclosed), GOAL)
    assert not crossable(layout, VEHICLE, START, np.array(enclosed))
    if enclosed != [1.5, 1.0]:
        assert not crossable(layout, VEHICLE, np.array(enclosed), np.array(enclosed))


def test_start_and_goal_count_at_their_nearest_grid_point() -> None:
    """By hand: 0.06 u is the first grid line where the vehicle fits."""
    for place, answer in (([0.056, 1.0], True), ([0.054, 1.0], False)):
        assert crossable(world(), VEHICLE, np.array(place), GOAL) is answer


def reached(layout: Layout, start: np.ndarray) -> np.ndarray:
    """Grid places reached from `start`, `[columns, rows]`: breadth first, one place and one circle at a time."""
    columns, rows = round(layout.size[0] * 100) + 1, round(layout.size[1] * 100) + 1
    reach = {"rim": VEHICLE.radius, "center": 0.0}[layout.acts]

    def passable(column: int, row: int) -> bool:
        place, pull = np.array([column, row]) * 0.01, 0.0
        if not (0 <= column < columns and 0 <= row < rows) or not layout.is_free(place, VEHICLE.radius):
            return False
        for circle in layout.circles:
            if np.linalg.norm(place - circle.center) < circle.radius + reach:
                if circle.effect == "fog":
                    return False
                pull += {"force_up": 0.5, "force_down": -0.5}.get(circle.effect, 0.0)
        return abs(pull) <= 2**0.5

    begin = (round(start[0] * 100), round(start[1] * 100))
    actual = np.zeros((columns, rows), bool)
    actual[begin] = passable(*begin)
    queue = deque([begin] if actual[begin] else [])
    while queue:
        column, row = queue.popleft()
        for near in ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)):
            if passable(*near) and not actual[near]:
                actual[near] = True
                queue.append(near)
    return actual


effects = st.sampled_from(["obstacle", "fog", "force_up", "force_up", "force_up", "force_down", "none"])
places = st.integers(0, 59).map(lambda place: place / 100 + 0.001)  # off the grid: no distance is within rounding


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.lists(st.tuples(places, places, st.floats(0.05, 0.25), effects), min_size=1, max_size=8), st.booleans())
def test_it_agrees_with_a_search_of_our_own(circles: list[tuple[float, float, float, str]], rim: bool) -> None:
    """A breadth-first search over the same grid with plain loops, in a small arena, from its corner to 20 places."""
    layout = Layout.load("layout", "original", circles=[], start_margin=0.1, start_side=0.1)
    layout = layout.model_copy(update={"size": (0.6, 0.6)})
    layout = layout.model_copy(update={"circles": world(*circles).circles, "acts": "rim" if rim else "center"})
    start = np.array([0.1, 0.1])
    actual = reached(layout, start)
    goals = np.random.default_rng(0).integers(0, 61, (20, 2))
    for column, row in goals.tolist():
        assert crossable(layout, VEHICLE, start, np.array([column, row]) / 100) == actual[column, row]


def test_surface_distance_by_hand(world: Layout) -> None:
    positions = np.array([[0.1, 1.0], [0.75, 0.9], [0.75, 0.5], [3.1, 1.0]])
    assert geometry.surface_distance(positions, world) == pytest.approx([0.1, 0.2, -0.2, -0.1])
    assert geometry.reachable(positions, world, 0.06).tolist() == [True, True, False, False]


def test_circles_without_resistance_can_be_entered(load_world: Callable[[str], Layout]) -> None:
    center = np.array([[0.75, 0.5], [0.375, 1.0]])
    assert geometry.reachable(center, load_world("fog"), 0.06).tolist() == [True, True]
    assert geometry.reachable(center, load_world("three_looks"), 0.06).tolist() == [False, True], (
        "an obstacle, a meaningless circle"
    )


@pytest.mark.parametrize("layout", ["three_looks", "two_obstacles", "four_properties"])
def test_what_is_seen_alone_is_what_a_fine_picture_shows_alone(
    layout: str, load_world: Callable[[str], Layout]
) -> None:
    """The square of a view, sampled 0.01 u apart: no sample is in another thing; where not alone, one nearly is."""
    world = load_world(layout)
    nodes = np.random.default_rng(3).uniform((0, 0), world.size, size=(150, 2))
    offsets = np.linspace(-0.25, 0.25, 51)
    seen = nodes[:, None, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1)  # [nodes, 51, 51, 2]
    for things in ((), ("left",), tuple(geometry.DIRECTIONS), (world.circles[-1],)):
        depths = [-geometry.border_distance(seen, world, side) for side in geometry.DIRECTIONS if side not in things]
        depths += [-geometry.circle_distance(seen, circle) for circle in world.circles if circle not in things]
        deepest = np.max(depths, axis=(0, 2, 3))  # how far the nearest sample is inside another thing, u
        alone = geometry.sees_only(nodes, world, things)
        assert alone.any() and not alone.all()
        assert (deepest[alone] <= 1e-9).all() and (deepest[~alone] > -0.008).all()


def test_the_shortest_way_is_measured_along_both_axes() -> None:
    """By hand: straight, around the corner, around a wall that leaves a door at the top, and behind a closed one."""
    radius = VEHICLE.radius
    assert way_length(world(), radius, START, GOAL) == pytest.approx(2.6)
    assert way_length(world(), radius, START, np.array([0.5, 1.4])) == pytest.approx(0.3 + 0.4)
    high = [each for each in wall("obstacle") if each[1] <= 1.25]  # up to y = 1.45, where the vehicle passes at 1.51
    assert way_length(world(*high), radius, START, GOAL) == pytest.approx(2.6 + 2 * 0.55, abs=0.051)
    assert way_length(world(*wall("obstacle")), radius, START, GOAL) == np.inf
    assert way_length(world(*wall("fog")), radius, START, GOAL) == pytest.approx(2.6)


def test_no_vehicle_is_faster_than_the_shortest_way_at_top_speed() -> None:
    """Full thrust along an axis, from rest, by Box2D."""
    physics, steps = Physics(world(), VEHICLE, START), 0
    while physics.position[0] < GOAL[0]:
        physics.step(np.array([1.0, 0, 0, 1.0]))
        steps += 1
    assert way_length(world(), VEHICLE.radius, START, GOAL) / VEHICLE.top_speed < steps


KEY = (0.6, 1.5, 0.1, "key")


@pytest.mark.parametrize(
    ("circles", "answer"),
    [
        ([*wall("door"), KEY], True),
        ([*wall("door"), (2.4, 1.5, 0.1, "key")], False),
        ([*wall("obstacle"), *wall("door", 2.0), KEY], False),
        ([*wall("obstacle"), KEY], False),
        ([*wall("obstacle", 0.9), *wall("door", 2.0), (1.5, 1.0, 0.1, "key")], False),
    ],
)
def test_doors_let_through_whoever_gets_to_a_key(circles: list[tuple[float, float, float, str]], answer: bool) -> None:
    """A key on this side, one behind the door; walls behind an open door; no door; a key out of reach."""
    assert crossable(world(*circles), VEHICLE, START, GOAL) is answer


def test_the_shortest_way_leads_over_a_key() -> None:
    """By hand: from y = 1 up to the rim of the key at 1.4 and down again, and no detour for a key on the way."""
    radius = VEHICLE.radius
    assert way_length(world(*wall("door"), KEY), radius, START, GOAL) == pytest.approx(2.6 + 2 * 0.4, abs=0.11)
    assert way_length(world(*wall("door"), (0.6, 1.0, 0.1, "key")), radius, START, GOAL) == pytest.approx(2.6)
    assert way_length(world(*wall("door"), (2.4, 1.5, 0.1, "key")), radius, START, GOAL) == np.inf
    assert way_length(world(KEY), radius, START, GOAL) == pytest.approx(2.6)
