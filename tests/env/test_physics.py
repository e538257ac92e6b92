"""Physics against closed forms: the recursion of Box2D's damping, forces, contacts, symmetry.

The reference for motion is `v' = (v + dt F / m) max(0, 1 - dt d)`, then `x' = x + dt v'`, in float64: Box2D 2.3.0
(`b2Island::Solve`), not the implicit `/ (1 + dt d)` of later releases.
"""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.env.body import MIN_RADIUS, THROTTLES, Vehicle
from affmap.env.layout import Acts, Layout
from affmap.env.physics import Physics

VEHICLE = Vehicle.load("vehicle", "default")
REST, RIGHT, UP = np.zeros(4), np.array([1.0, 0, 0, 1]), np.array([1.0, 1, 0, 0])
SLOP = 0.005
"""u, the overlap that Box2D leaves between bodies that press on each other; an impact may reach three times that."""

quick = settings(max_examples=40, deadline=None, derandomize=True)


def world(
    *circles: tuple[float, float, float, str], size: tuple[float, float] = (3.0, 2.0), acts: Acts = "rim"
) -> Layout:
    things = [
        {"center": [x, y], "radius": radius, "effect": effect, "channel": "solid"} for x, y, radius, effect in circles
    ]
    return Layout.load("layout", "original", size=size, circles=things, acts=acts)


def fly(physics: Physics, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities `[T, 2]` after each of `actions` `[T, 4]`."""
    positions, velocities = [], []
    for action in actions:
        physics.step(action)
        positions.append(physics.position)
        velocities.append(physics.velocity)
    return np.stack(positions), np.stack(velocities)


def advance(
    position: np.ndarray, velocity: np.ndarray, force: np.ndarray, damping: float, vehicle: Vehicle = VEHICLE
) -> tuple[np.ndarray, np.ndarray]:
    """The closed form of one step; positions in u, velocities in u/step."""
    dt = vehicle.time_step_s
    velocity = (velocity / dt + dt * force / vehicle.mass) * max(0.0, 1 - dt * damping) * dt
    return position + velocity, velocity


def random_actions(seed: int, num_steps: int) -> np.ndarray:
    """Throttles fully open or closed, or in between, held for five steps: what collides most."""
    generator = np.random.default_rng(seed)
    actions = generator.uniform(size=(num_steps, 4))
    binary = generator.uniform(size=num_steps) < 0.7
    actions[binary] = actions[binary].round()
    return np.repeat(actions, 5, axis=0)[:num_steps]


seeds = st.integers(0, 2**32 - 1)


def test_top_speed_is_the_paper_s() -> None:
    """Section 4.1: approximately 0.23 u per time step."""
    assert VEHICLE.top_speed == pytest.approx(0.23, abs=0.0005)


@pytest.mark.parametrize("throttles", [(0, 1), (1, 2), (2, 3), (3, 0)])
def test_two_neighbouring_throttles_reach_top_speed_and_no_more(throttles: tuple[int, int]) -> None:
    """Against the closed form, in an arena long enough; and no action is faster."""
    action = np.zeros(4)
    action[list(throttles)] = 1
    _, velocities = fly(Physics(world(size=(100, 100)), VEHICLE, np.array([50.0, 50.0])), np.tile(action, (200, 1)))
    speeds = np.linalg.norm(velocities, axis=1)
    assert speeds[-1] == pytest.approx(VEHICLE.top_speed, rel=1e-4)
    assert (np.diff(speeds[:80]) > 0).all() and speeds.max() < VEHICLE.top_speed * 1.0001


def test_without_damping_there_is_no_top_speed() -> None:
    assert Vehicle.load("vehicle", "default", damping=0.0).top_speed == math.inf


def test_from_the_very_left_to_the_very_right_takes_13_steps_at_top_speed() -> None:
    """Section 4.1; the centre travels from x = 0.06 to x = 2.94."""
    physics = Physics(world(size=(60, 2)), VEHICLE, np.array([1.0, 1.0]))
    positions, _ = fly(physics, np.tile(RIGHT, (200, 1)))
    begin = positions[150, 0]
    assert int(np.argmax(positions[150:, 0] >= begin + 2.88)) == 13


def test_from_rest_the_very_right_takes_at_least_13_steps() -> None:
    """Section 4.1; with inertia it takes longer, and the closed form of the flight says how much."""
    positions, _ = fly(Physics(world(), VEHICLE, np.array([0.06, 1.0])), np.tile(RIGHT, (60, 1)))
    arrived = int(np.argmax(positions[:, 0] >= 2.94 - SLOP)) + 1
    assert positions[-1, 0] == pytest.approx(2.94, abs=3 * SLOP)
    free, _ = fly(Physics(world(size=(9, 2)), VEHICLE, np.array([0.06, 1.0])), np.tile(RIGHT, (60, 1)))
    assert 13 <= arrived == int(np.argmax(free[:, 0] >= 2.94 - SLOP)) + 1


def test_mass_is_the_configured_one_whatever_the_radius() -> None:
    for radius in (0.01, 0.06, 0.3):
        vehicle = Vehicle.load("vehicle", "default", radius=radius, mass=0.25, damping=0.0)
        physics = Physics(world(), vehicle, np.array([1.5, 1.0]))
        physics.step(RIGHT)
        expected = math.sqrt(2) / 0.25 * vehicle.time_step_s**2
        np.testing.assert_allclose(physics.velocity, [expected, 0], rtol=1e-5, atol=1e-8)


def test_rest_stays_at_rest() -> None:
    """No gravity: bit-equal position after 100 steps without and with all four throttles open alike."""
    for action in (REST, np.ones(4), np.full(4, 0.3)):
        physics = Physics(world(), VEHICLE, np.array([1.3, 0.7]))
        begin = physics.position
        positions, velocities = fly(physics, np.tile(action, (100, 1)))
        np.testing.assert_allclose(positions, np.tile(begin, (100, 1)), atol=1e-7 if action.any() else 0)
        np.testing.assert_allclose(velocities, 0, atol=1e-8 if action.any() else 0)


def test_throttles_push_diagonally_and_counter_clockwise() -> None:
    """Section 4.1: attached between the axes; golden directions, unit vectors."""
    np.testing.assert_allclose(THROTTLES * math.sqrt(2), [[1, 1], [-1, 1], [-1, -1], [1, -1]])
    for throttle, direction in enumerate(THROTTLES):
        physics = Physics(world(), VEHICLE, np.array([1.5, 1.0]))
        physics.step(np.eye(4)[throttle])
        np.testing.assert_allclose(physics.velocity / np.linalg.norm(physics.velocity), direction, atol=1e-5)


@quick
@given(seeds, st.just(0.0) | st.floats(1e-12, 29.9), st.floats(0.05, 1), st.floats(0.1, 3))
def test_free_flight_follows_the_recursion_of_box2d_s_damping(
    seed: int, damping: float, mass: float, thrust: float
) -> None:
    vehicle = Vehicle.load("vehicle", "default", damping=damping, mass=mass, thrust=thrust)
    actions = np.random.default_rng(seed).uniform(size=(30, 4))
    physics = Physics(world(size=(1000, 1000)), vehicle, np.array([500.0, 500.0]))
    position, velocity = physics.position, physics.velocity
    for action in actions:
        force = sum(opening * thrust * direction for opening, direction in zip(action, THROTTLES, strict=True))
        position, velocity = advance(position, velocity, np.asarray(force), damping, vehicle)
        physics.step(action)
        np.testing.assert_allclose(physics.velocity, velocity, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(physics.position, position, atol=5e-3)


FIELDS = [(1.0, 1.0, 0.4, "force_up"), (1.2, 1.0, 0.5, "force_up"), (1.9, 0.9, 0.5, "force_down")]


@pytest.mark.parametrize(
    ("fields", "factor"),
    [
        (["force_up"], 1),
        (["force_down"], -1),
        (["force_up", "force_up"], 2),
        (["force_up", "force_down"], 0),
        (["force_up", "force_down", "force_down", "none", "fog"], -1),
    ],
)
def test_force_fields_pull_with_the_configured_force_and_add_up(fields: list[str], factor: int) -> None:
    """Closed form, from the first step on; across the pull nothing changes."""
    layout = world(*[(1.5, 1.0, 0.9 + 0.01 * number, effect) for number, effect in enumerate(fields)])
    physics = Physics(layout, VEHICLE, np.array([1.5, 1.0]))
    position, velocity = physics.position, physics.velocity
    for _ in range(5):
        pull = np.array([0, factor * VEHICLE.force]) + 0.5 * math.sqrt(2) * np.array([1.0, 0.0])
        position, velocity = advance(position, velocity, pull, VEHICLE.damping)
        physics.step(0.5 * RIGHT)
        np.testing.assert_allclose(physics.velocity, velocity, rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(physics.position, position, atol=1e-5)


@pytest.mark.parametrize(("acts", "reach"), [("rim", VEHICLE.radius), ("center", 0.0)])
@quick
@given(seeds)
def test_each_place_has_its_effects_without_delay(acts: Acts, reach: float, seed: int) -> None:
    """Closed form: fields and fog are those that the disc overlaps, or the centre is in, at the beginning of the step.

    Contact is the disc's. The reference computes distances; steps where a circle is only just reached are not judged.
    """
    fog = (2.2, 1.2, 0.3, "fog")
    start = np.array([0.4, 1.0]) + np.random.default_rng(seed).uniform(0, 0.3)
    physics = Physics(world(*FIELDS, fog, acts=acts), VEHICLE, start)
    for action in random_actions(seed, 60):
        before, velocity = physics.position, physics.velocity
        gaps = {field: np.linalg.norm(before - field[:2]) - field[2] - reach for field in [*FIELDS, fog]}
        gaps_to_border = [*(before - VEHICLE.radius), *(np.array([3, 2]) - VEHICLE.radius - before)]
        if min(map(abs, [*gaps.values(), *gaps_to_border])) < 1e-5:
            physics.step(action)
            continue
        assert physics.in_fog == (gaps[fog] < 0)
        assert physics.touching == (min(gaps_to_border) < 0)
        pull = sum({"force_up": 0.5, "force_down": -0.5}[field[3]] for field in FIELDS if gaps[field] < 0)
        damping = VEHICLE.contact_damping if physics.touching else VEHICLE.damping
        force = VEHICLE.thrust * action @ THROTTLES + [0, pull]
        position, velocity = advance(before, velocity, force, damping)
        physics.step(action)
        if min(position - VEHICLE.radius) > 0 and min(np.array([3, 2]) - VEHICLE.radius - position) > 0:
            np.testing.assert_allclose(physics.velocity, velocity, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("acts", ["center", "rim"])
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5, 4.0])
def test_where_circles_begin_to_act(acts: Acts, angle: float) -> None:
    """Closed form: 0.0001 u inside and outside of each limit, a step from rest has the pull, fog and contact or not.

    The limit of fog and field is the circle's radius, or with the vehicle's; that of an obstacle has it always.
    """
    limits = dict.fromkeys(("fog", "force_up", "force_down"), 0.3 + (0.06 if acts == "rim" else 0.0))
    for effect, limit in {**limits, "obstacle": 0.36}.items():
        layout = world((1.5, 1.0, 0.3, effect), acts=acts)
        for inside in (True, False):
            distance = limit + (-0.0001 if inside else 0.0001)
            place = np.array([1.5, 1.0]) + distance * np.array([math.cos(angle), math.sin(angle)])
            physics = Physics(layout, VEHICLE, place)
            assert physics.in_fog == (inside and effect == "fog")
            assert physics.touching == (inside and effect == "obstacle")
            pull = VEHICLE.force * {"force_up": 1, "force_down": -1}.get(effect, 0) * inside
            _, velocity = advance(place, np.zeros(2), np.array([0.0, pull]), VEHICLE.damping)
            physics.step(REST)
            np.testing.assert_allclose(physics.velocity, velocity, rtol=1e-4, atol=1e-7)


def test_obstacles_are_the_same_under_both_rules() -> None:
    """Bit-equal flights among obstacles, which touch them."""
    layout, actions = Layout.load("layout", "original"), random_actions(2, 200)
    flown = []
    for acts in ("center", "rim"):
        physics = Physics(layout.model_copy(update={"acts": acts}), VEHICLE, np.array([0.2, 0.2]))
        flown.append((*fly(physics, actions), physics.touching))
    for one, other in zip(*flown, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.ptp(flown[0][0], axis=0).min() > 0.5


@pytest.mark.parametrize("effect", ["fog", "none", "key"])
def test_fog_and_meaningless_circles_do_not_block(effect: str) -> None:
    """The flight through the circle is bit-equal to the flight in an empty world."""
    actions = np.tile(RIGHT, (25, 1))
    start = np.array([0.3, 1.0])
    with_circle = Physics(world((1.5, 1.0, 0.3, effect)), VEHICLE, start)
    touched = []
    for action in actions:
        with_circle.step(action)
        touched.append((with_circle.touching, with_circle.in_fog))
    empty = Physics(world(), VEHICLE, start)
    positions, velocities = fly(empty, actions[:20])
    assert positions[-1, 0] > 1.9
    again, velocities_again = fly(Physics(world((1.5, 1.0, 0.3, effect)), VEHICLE, start), actions[:20])
    np.testing.assert_array_equal(again, positions)
    np.testing.assert_array_equal(velocities_again, velocities)
    assert any(in_fog for _, in_fog in touched) == (effect == "fog")
    assert not any(touching for touching, _ in touched[:20])


def test_an_obstacle_blocks() -> None:
    """Golden outcome: the vehicle stops where the two discs touch."""
    physics = Physics(world((1.5, 1.0, 0.3, "obstacle")), VEHICLE, np.array([0.3, 1.0]))
    positions, _ = fly(physics, np.tile(RIGHT, (60, 1)))
    np.testing.assert_allclose(positions[-1], [1.5 - 0.3 - 0.06, 1.0], atol=1.2 * SLOP)
    assert physics.touching and not physics.in_fog


@pytest.mark.parametrize("corner", [(0.06, 0.06), (2.94, 0.06), (0.06, 1.94), (2.94, 1.94)])
def test_pressing_on_borders_stays_within_the_slop(corner: tuple[float, float]) -> None:
    """Box2D's documented slop of 0.005 u, in both directions at once."""
    physics = Physics(world(), VEHICLE, np.array([1.5, 1.0]))
    outward = np.sign(np.array(corner) - [1.5, 1.0])
    throttle = int(np.argmax(THROTTLES @ outward))
    sideways = RIGHT if outward[0] > 0 else np.array([0, 1.0, 1, 0])
    fly(physics, np.tile(sideways, (40, 1)))
    positions, _ = fly(physics, np.tile(np.eye(4)[throttle], (200, 1)))
    np.testing.assert_allclose(positions[-1], corner, atol=1.2 * SLOP)
    assert physics.touching


@quick
@given(seeds)
def test_solid_things_are_never_entered(seed: int) -> None:
    """Geometry: the overlap stays below four slops (Box2D corrects an impact down to three at once)."""
    layout = Layout.load("layout", "original")
    generator = np.random.default_rng(seed)
    start = next(p for p in generator.uniform([0, 0], [3, 2], (100, 2)) if layout.is_free(p, VEHICLE.radius))
    positions, _ = fly(Physics(layout, VEHICLE, start), random_actions(seed, 150))
    walls = np.concatenate([VEHICLE.radius - positions, positions + VEHICLE.radius - np.array([3, 2])], axis=1)
    discs = np.stack([VEHICLE.radius + c.radius - np.linalg.norm(positions - c.center, axis=1) for c in layout.circles])
    assert max(walls.max(), discs.max()) < 4 * SLOP


LIMITS: list[dict[str, float]] = [
    {},
    {"thrust": 120.0, "force": 175.0},  # 1.9 u per step in a step
    {"thrust": 120.0, "force": 175.0, "damping": 0.0, "contact_damping": 0.0},
    {"mass": 0.0008},
    {"velocity_iterations": 1, "position_iterations": 1},
]


def test_vehicles_at_the_limits_of_the_simulator_stay_in_the_arena(tried: Callable[[str, int, str], None]) -> None:
    """The smallest and the usual one, at extreme accelerations, among obstacles and in three fields; the limit of the
    radius is not idle: one of half of it leaves."""
    fields = world(*[(1.5, 1.0, 5.0, "force_up")] * 3)
    layouts = [Layout.load("layout", "original"), fields]
    flights = 0
    for radius in (MIN_RADIUS, VEHICLE.radius):
        for limits in LIMITS:
            vehicle = Vehicle.load("vehicle", "default", radius=radius, **limits)
            for seed, layout in enumerate(layouts):
                positions, _ = fly(Physics(layout, vehicle, np.array([0.2, 0.2])), random_actions(seed, 300))
                assert (positions >= 0).all() and (positions <= layout.size).all(), (radius, limits)
                flights += 1
    tried("flights at the limits of the vehicle's constants", flights, "inside the arena")
    small = VEHICLE.model_construct(**{**dict(VEHICLE), "radius": MIN_RADIUS / 2})
    paths = [fly(Physics(layouts[0], small, np.array([0.2, 0.2])), random_actions(seed, 300))[0] for seed in range(8)]
    assert max(path.max() for path in paths) > 3 or min(path.min() for path in paths) < 0


def test_a_small_obstacle_is_not_tunnelled_through() -> None:
    """At top speed a step is 0.23 u long, the obstacle 0.02 u wide."""
    for shift in np.linspace(0, 0.23, 12):
        start = np.array([0.1 + shift, 1.0])
        physics = Physics(world((4.5, 1.0, 0.01, "obstacle"), size=(6, 2)), VEHICLE, start)
        positions, _ = fly(physics, np.tile(RIGHT, (60, 1)))
        assert positions[:, 0].max() < 4.5 - 0.07 + 4 * SLOP


@pytest.mark.parametrize(("start", "along"), [((2.941, 0.3), 1), ((0.3, 1.941), 0)])
def test_contact_damping_acts_along_a_border(start: tuple[float, float], along: int) -> None:
    """Closed form: sliding along the border, the recursion has the damping of contact; across it there is rest."""
    physics = Physics(world(), VEHICLE, np.array(start))
    velocity = np.zeros(2)
    assert physics.touching
    for _ in range(20):
        physics.step(np.array([1.0, 0, 0, 0]))  # into the border and along it
        _, velocity = advance(np.zeros(2), velocity, np.full(2, math.sqrt(0.5)), VEHICLE.contact_damping)
        assert physics.touching
        assert physics.velocity[along] == pytest.approx(velocity[along], rel=1e-4)
        assert physics.velocity[1 - along] == pytest.approx(0, abs=1e-6)
    kept = 1 - VEHICLE.contact_damping * VEHICLE.time_step_s
    terminal = math.sqrt(0.5) / (VEHICLE.mass * VEHICLE.contact_damping) * VEHICLE.time_step_s * kept
    assert physics.velocity[along] == pytest.approx(terminal, rel=0.01)


def test_contact_damping_acts_around_an_obstacle_and_ends_with_the_contact() -> None:
    """Closed form for the step away from an obstacle, and for the flight after it."""
    physics = Physics(world((1.5, 1.0, 0.3, "obstacle")), VEHICLE, np.array([1.5, 1.3 + 0.06 - 0.001]))
    assert physics.touching
    velocity = np.zeros(2)
    dampings = [VEHICLE.contact_damping] + [VEHICLE.damping] * 8
    for number, damping in enumerate(dampings):
        _, velocity = advance(np.zeros(2), velocity, math.sqrt(2) * np.array([0.0, 1.0]), damping)
        physics.step(UP)
        assert not physics.touching
        assert physics.velocity[1] == pytest.approx(velocity[1], rel=1e-4), number


MIRRORS = {
    "left right": (np.array([-1.0, 1.0]), [1, 0, 3, 2]),
    "up down": (np.array([1.0, -1.0]), [3, 2, 1, 0]),
    "both": (np.array([-1.0, -1.0]), [2, 3, 0, 1]),
}


@pytest.mark.parametrize("mirror", MIRRORS)
@pytest.mark.parametrize("seed", range(5))
def test_mirrored_throttles_fly_the_mirrored_way(mirror: str, seed: int) -> None:
    """Symmetry of throttles, borders and an obstacle in the middle, up to the rounding of float32."""
    layout = world((1.5, 1.0, 0.3, "obstacle"))
    center = np.array([1.5, 1.0])
    signs, order = MIRRORS[mirror]
    actions = np.random.default_rng(seed).uniform(size=(20, 4))
    offset = np.array([0.6, 0.45])
    plain, _ = fly(Physics(layout, VEHICLE, center + offset), actions)
    mirrored, _ = fly(Physics(layout, VEHICLE, center + signs * offset), actions[:, order])
    np.testing.assert_allclose((mirrored - center) * signs, plain - center, atol=1e-4)
    assert np.abs(plain - plain[0]).max() > 0.05


@quick
@given(seeds)
def test_the_same_actions_give_bit_equal_flights(seed: int) -> None:
    """Twice the same, also with another world made and used in between."""
    layout = Layout.load("layout", "original")
    actions = random_actions(seed, 100)
    first, second = (Physics(layout, VEHICLE, np.array([0.2, 0.2])) for _ in range(2))
    positions, velocities = fly(first, actions)
    fly(Physics(layout, VEHICLE, np.array([0.3, 1.7])), actions)
    again, velocities_again = fly(second, actions)
    np.testing.assert_array_equal(positions, again)
    np.testing.assert_array_equal(velocities, velocities_again)


def test_a_bad_value_of_a_vehicle_is_named() -> None:
    """Golden sentences for each field."""
    for key in Vehicle.model_fields:
        bad: Any = -1
        with pytest.raises(ValueError, match=rf"^Vehicle\.load: {key} = -1 is not allowed: it should be gr"):
            Vehicle.load("vehicle", "default", **{key: bad})


DOOR = (1.5, 1.0, 0.3, "door")


def test_a_door_blocks_as_an_obstacle_does() -> None:
    """Bit for bit, as long as no key was visited: one far away, and one that the vehicle's rim touches."""
    start, actions = np.array([0.3, 1.0]), np.tile(RIGHT, (60, 1))
    expected = fly(Physics(world((*DOOR[:3], "obstacle")), VEHICLE, start), actions)
    for key in ((2.5, 1.5, 0.1, "key"), (0.3, 1.12, 0.11, "key")):
        physics = Physics(world(DOOR, key), VEHICLE, start)
        np.testing.assert_array_equal(fly(physics, actions), expected)
        assert physics.touching and physics.layout.obstacles


def test_a_visited_key_opens_all_doors_for_good() -> None:
    """The closed form of free flight through where they were, from the step in which the centre is in the key."""
    layout = world(DOOR, (2.2, 1.0, 0.2, "door"), (0.6, 1.0, 0.1, "key"))
    start, actions = np.array([0.3, 1.0]), np.tile(RIGHT, (20, 1))
    physics = Physics(layout, VEHICLE, start)
    position, velocity = start, np.zeros(2)
    for action in actions:
        physics.step(action)
        position, velocity = advance(position, velocity, np.array([math.sqrt(2), 0.0]), VEHICLE.damping)
        np.testing.assert_allclose(physics.position, position, atol=1e-5)
        assert (physics.layout is layout) == (position[0] < 0.5)
    assert position[0] > 2.4 and physics.layout == layout.opened


def test_a_door_opens_for_a_vehicle_that_presses_on_it() -> None:
    """By a key beside the door: the contact is over in the same step."""
    layout = world((1.5, 1.0, 0.3, "door"), (1.14, 1.0, 0.01, "key"))
    physics = Physics(layout, VEHICLE, np.array([0.9, 1.0]))
    touched = []
    for _ in range(40):
        physics.step(0.1 * RIGHT)
        touched.append((physics.touching, physics.layout is layout))
    assert (True, False) not in touched and touched[-1] == (False, False)


def test_a_copy_has_the_doors_of_the_original() -> None:
    """Before a key and after it, to the same bits; a new flight begins with closed doors."""
    layout = world(DOOR, (0.6, 1.0, 0.1, "key"))
    physics, actions = Physics(layout, VEHICLE, np.array([0.3, 1.0])), np.tile(RIGHT, (12, 1))
    for action in actions:
        physics.step(action)
        again = pickle.loads(pickle.dumps(physics))
        assert again.layout == physics.layout
        np.testing.assert_array_equal(fly(again, actions), fly(copy.deepcopy(physics), actions))
    assert Physics(layout, VEHICLE, np.array([0.3, 1.0])).layout is layout
    assert Physics(layout, VEHICLE, np.array([0.6, 1.0])).layout == layout.opened, "it starts at the key"
