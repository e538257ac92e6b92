"""The environment proves its contract: Gymnasium's checker, bit-equal rollouts, what is reported and rewarded."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from rollouts import actions, assert_bit_equal, rollout

from affmap.env import Layout, VehicleEnv, procedural
from affmap.env.layout import Acts
from affmap.env.vector import VehicleVectorEnv
from affmap.settings import ConfigError
from affmap.view import view

quick = settings(max_examples=40, deadline=None, derandomize=True)
seeds = st.integers(0, 2**31 - 1)


def world(*circles: tuple[float, float, float, str], acts: Acts = "rim") -> Layout:
    things = [{"center": [x, y], "radius": r, "effect": effect, "channel": "solid"} for x, y, r, effect in circles]
    return Layout.load("layout", "original", circles=things, acts=acts)


# Gymnasium's checker warns of unbounded positions (fog reports any) and, without a render mode, that it cannot render.
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("render_mode", [None, "rgb_array"])
def test_gymnasium_s_checker_has_no_complaint(render_mode: str | None) -> None:
    check_env(VehicleEnv(render_mode=render_mode), skip_render_check=render_mode is None)


def test_without_views_all_else_is_the_same() -> None:
    """One flight with and without views, and an observation in its space."""
    seeing, blind = VehicleEnv(), VehicleEnv(views=False)
    steps = [(env.reset(seed=3), env.step(np.array([0.2, 0.9, 0.4, 0.1]))) for env in (seeing, blind)]
    for (seen, *rest), (felt, *others) in zip(*steps, strict=True):
        assert set(seen) - set(felt) == {"view"} and blind.observation_space.contains(felt)
        for key, value in felt.items():
            np.testing.assert_array_equal(value, seen[key])
        assert str(rest) == str(others)


def test_make_truncates_after_exactly_200_steps_and_never_terminates() -> None:
    """Issue 2; also when the goal is reached in every step."""
    env = gymnasium.make("affmap/Vehicle-v0", goal_radius=5.0)
    env.reset(seed=0)
    for number in range(1, 201):
        _, _, terminated, truncated, info = env.step(np.zeros(4, np.float32))
        assert info["reached"] and not terminated
        assert truncated == (number == 200)
    env.close()


def test_the_same_seed_gives_a_bit_equal_rollout_and_another_seed_another() -> None:
    """In a world of fog, so that the noise counts too."""
    layout = world((1.5, 1.0, 2.0, "fog"))
    first = rollout(VehicleEnv(layout), 50, seed=3)
    assert_bit_equal(first, rollout(VehicleEnv(layout), 50, seed=3))
    with pytest.raises(AssertionError):
        assert_bit_equal(first, rollout(VehicleEnv(layout), 50, seed=4))
    env = VehicleEnv(layout)
    rollout(env, 20, seed=3)
    with pytest.raises(AssertionError, match="position"):
        assert_bit_equal(first, rollout(env, 50, seed=None))


def test_reset_in_the_middle_is_as_good_as_a_fresh_environment() -> None:
    """Same alone: nothing of the last world is left, not even the order of Box2D's contacts."""
    env = VehicleEnv()
    for number in (7, 33, 50):
        rollout(env, number, seed=number)
    env.planned_positions = np.ones((2, 2))
    assert_bit_equal(rollout(env, 50, seed=3), rollout(VehicleEnv(), 50, seed=3))
    assert env.planned_positions is None


def test_reward_is_minus_the_distance_of_the_true_position() -> None:
    """Closed form, in fog; so the paper's mean distance is minus the mean reward."""
    for layout in (Layout.load("layout", "original"), world((1.5, 1.0, 2.0, "fog"))):
        env = VehicleEnv(layout)
        steps = rollout(env, 40, seed=5)[1:]
        goal = env.goal
        distances = [math.hypot(*(info["position"] - goal)) for *_, info in steps]
        np.testing.assert_allclose([reward for _, reward, *_ in steps], np.negative(distances), rtol=1e-12)
        np.testing.assert_allclose(-np.mean([reward for _, reward, *_ in steps]), np.mean(distances), rtol=1e-12)
        assert all(type(reward) is float for _, reward, *_ in steps)


@quick
@given(seeds, st.sampled_from([None, 0, 1, 2, 3]))
def test_a_run_starts_in_a_corner_s_square_and_ends_in_the_opposite_one(seed: int, corner: int | None) -> None:
    """Against the squares written out: 0.2 u wide, 0.1 u from the borders, left or right, below or above."""
    env = VehicleEnv()
    observation, info = env.reset(seed=seed, options=None if corner is None else {"corner": corner})
    start, goal = info["position"], observation["goal"]
    lows = [(0.1, 0.1), (2.7, 0.1), (0.1, 1.7), (2.7, 1.7)]
    inside = [((start >= np.array(low) - 1e-6) & (start <= np.array(low) + 0.2 + 1e-6)).all() for low in lows]
    assert sum(inside) == 1
    number = inside.index(True)
    assert corner in (None, number)
    assert ((goal >= np.array(lows[3 - number]) - 1e-6) & (goal <= np.array(lows[3 - number]) + 0.2 + 1e-6)).all()
    np.testing.assert_array_equal(goal, env.goal.astype(np.float32))


def test_all_corners_occur_and_squares_are_filled() -> None:
    """Statistics of 400 fixed seeds: uniform over four corners and over each square."""
    env = VehicleEnv()
    starts = np.stack([env.reset(seed=seed)[1]["position"] for seed in range(400)])
    right, upper = starts[:, 0] > 1.5, starts[:, 1] > 1.0
    counts = np.bincount(right + 2 * upper, minlength=4)
    assert counts.min() > 70  # expected 100, standard deviation 8.7
    in_square = starts - np.stack([np.where(right, 2.7, 0.1), np.where(upper, 1.7, 0.1)], axis=1)
    for axis in (0, 1):
        assert np.histogram(in_square[:, axis], 4, (0, 0.2))[0].min() > 70


def test_options_place_vehicle_and_goal() -> None:
    env = VehicleEnv()
    observation, info = env.reset(seed=0, options={"position": [1.0, 1.0], "goal": [2.5, 0.75]})
    np.testing.assert_allclose(info["position"], [1.0, 1.0])
    np.testing.assert_array_equal(observation["position"], [1.0, 1.0])
    np.testing.assert_array_equal(observation["goal"], [2.5, 0.75])
    np.testing.assert_array_equal(observation["delta"], [0.0, 0.0])


def test_an_option_does_not_change_the_other_draws() -> None:
    """Same alone: with the position given, the goal is the one drawn without it."""
    env = VehicleEnv()
    plain = env.reset(seed=8, options={"corner": 1})[0]["goal"]
    np.testing.assert_array_equal(env.reset(seed=8, options={"corner": 1, "position": [1, 1]})[0]["goal"], plain)


def test_goals_at_a_distance_are_free_and_lie_in_all_directions() -> None:
    """Starts are those without the option. From the centre 0.6 u to any side are within the arena."""
    env = VehicleEnv()
    start = env.reset(seed=8, options={"corner": 1})[1]["position"]
    np.testing.assert_array_equal(env.reset(seed=8, options={"corner": 1, "distance": 1.0})[1]["position"], start)
    options = {"position": [1.5, 1.0], "distance": 0.6}
    goals = np.array([env.reset(seed=seed, options=options)[0]["goal"] for seed in range(200)], float)
    np.testing.assert_allclose(np.linalg.norm(goals - [1.5, 1.0], axis=1), 0.6, atol=1e-6)
    assert env.layout.is_free(goals, env.vehicle.radius).all()
    above, right = goals[:, 1] > 1, goals[:, 0] > 1.5
    assert np.histogram2d(above, right, 2)[0].min() > 25


def test_noise_of_the_sensors_is_on_every_reported_position_and_on_no_true_one() -> None:
    """Against the same flight without it: equal truth, and deviations with the standard deviation asked for."""
    flights = []
    for std in (0.0, 0.05):
        env = VehicleEnv(vehicle={"sensor_std": std})
        steps = [env.reset(seed=3, options={"corner": 0})]
        for _ in range(400):
            observation, *_, info = env.step(np.array([0.5, 0.5, 0.5, 0.4]))
            steps.append((observation, info))
        flights.append([np.array([each[key] for each, _ in steps]) for key in ("position", "delta")])
        flights[-1].append(np.array([info["position"] for _, info in steps]))
    (plain, _, truth), (noisy, delta, same) = flights
    np.testing.assert_array_equal(truth, same)
    np.testing.assert_array_equal(plain, truth.astype(np.float32))
    assert (noisy - truth).std() == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(delta[1:], np.diff(noisy, axis=0), atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"corner": 4}, "corner = 4 is not one of 0, 1, 2, 3"),
        ({"corner": -1}, "corner = -1 is not one of 0, 1, 2, 3"),
        ({"corner": "left"}, "corner = 'left' is not one of 0, 1, 2, 3"),
        ({"start": [1, 1]}, r"options \['start'\] are unknown; give corner, or position, and goal or distance"),
        ({"position": [0.75, 0.5]}, r"position = \[0.75, 0.5\] is not free"),
        ({"position": [0.01, 1.0]}, r"position = \[0.01, 1.0\] is not free"),
        ({"position": [math.nan, 1.0]}, r"position = \[nan, 1.0\] is not a point of the arena"),
        ({"position": [1.0]}, r"position = \[1.0\] is not a point of the arena"),
        ({"position": [1.0, 1.0, 1.0]}, r"position = \[1.0, 1.0, 1.0\] is not a point of the arena"),
        ({"goal": [3.5, 1.0]}, r"goal = \[3.5, 1.0\] is not a point of the arena \[3.0, 2.0\]"),
        ({"goal": [1.0, math.nan]}, r"goal = \[1.0, nan\] is not a point of the arena"),
        ({"goal": 1.0}, r"goal = 1.0 is not a point of the arena"),
        ({"goal": [1.0, 1.0], "distance": 1.0}, r"have both goal and distance; give one of them"),
        ({"distance": -1.0}, r"distance = -1.0 is not allowed: it should be greater than 0 and finite"),
        ({"distance": math.nan}, r"distance = nan is not allowed"),
        ({"distance": 4.0}, r"distance = 4.0: no place so far from .* is free for a goal"),
    ],
)
def test_bad_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VehicleEnv().reset(seed=0, options=options)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"render_mode": "ansi"}, r"render_mode = 'ansi' is not one of \['rgb_array', 'human'\]"),
        ({"goal_radius": 0.0}, "goal_radius = 0.0 is not allowed: it should be greater than 0"),
        ({"goal_radius": math.nan}, "goal_radius = nan is not allowed"),
        ({"layout": "moon"}, r"conf/layout/moon.yaml does not exist; conf/layout holds: .*original"),
        ({"vehicle": "moon"}, r"conf/vehicle/moon.yaml does not exist; conf/vehicle holds: .*default"),
        ({"layout": world((0.2, 0.2, 0.1, "obstacle"))}, r"circles\[0\] .* blocks the start corner"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VehicleEnv(**arguments)
    assert issubclass(ConfigError, ValueError)


@pytest.mark.parametrize("layout", [3, None, ["original"], 1.5])
@pytest.mark.parametrize("make", [VehicleEnv, VehicleVectorEnv, procedural.load])
def test_what_is_no_layout_is_refused(make: Callable[..., object], layout: object) -> None:
    """A golden sentence, from all that take a layout."""
    with pytest.raises(ConfigError) as caught:
        make(layout=layout)
    assert str(caught.value) == (
        f"layout = {layout!r} is not allowed: give the name of a file in conf/layout, or the keys and values of a "
        "layout."
    )


BAD_ACTIONS: list[Any] = [[math.nan, 0, 0, 0], [-0.1, 0, 0, 0], [0, 0, 0, 1.1], [-2e-6, 0, 0, 0], [0, 0, 1.000002, 0]]
BAD_ACTIONS += [[0, 0, 0], [[0, 0, 0, 0]], [0, 0, 0, math.inf], [], [0, 0, 0, 0.5j], "abcd", list("0000"), None]
BAD_ACTIONS += [{"a": 1}, [0, 0, 0, None], [0, [0, 0], 0, 0]]


@pytest.mark.parametrize("bad", BAD_ACTIONS, ids=str)
def test_a_bad_action_is_refused_and_nothing_is_lost(bad: Any) -> None:
    """Same as the run, and the picture, without it."""
    layout = world((1.5, 1.0, 2.0, "fog"))
    env, reference = (VehicleEnv(layout, render_mode="rgb_array") for _ in range(2))
    rollout(env, 5, seed=1)
    rollout(reference, 5, seed=1)
    with pytest.raises(ValueError, match=r"^action = .* is not allowed: give four numbers in \[0, 1\]\.$"):
        env.step(bad)
    np.testing.assert_array_equal(env.render(), reference.render())
    assert_bit_equal([env.step(action) for action in actions(9)], [reference.step(action) for action in actions(9)])


@pytest.mark.filterwarnings("ignore::UserWarning")  # Gymnasium's, on limits in double precision
@pytest.mark.parametrize(("low", "high"), [(-0.3, 0.7), (0.1, 0.3), (-2.3, 1.7)])
def test_throttles_that_rounding_puts_outside_their_limits_are_clipped(low: float, high: float) -> None:
    """The flight with throttles of 0 and 1, which Gymnasium's own wrapper computes to 1.0000001 and -0.00000001."""
    env, reference = VehicleEnv(), VehicleEnv()
    scaled = gymnasium.wrappers.RescaleAction(env, np.float64(low), np.float64(high))
    raw = [scaled.func(np.full(4, limit)) for limit in (low, high, *(scaled.action_space.high[:1]))]
    assert min(map(np.min, raw)) < 0 or max(map(np.max, raw)) > 1
    rollout(env, 5, seed=1)
    rollout(reference, 5, seed=1)
    for number in range(24):
        throttles = np.roll([0.0, 1.0, 1.0, 0.0], number // 8)
        _, reward, *_ = scaled.step(np.where(throttles, scaled.action_space.high if number % 2 else high, low))
        assert ((env.action >= 0) & (env.action <= 1)).all()
        assert reward == pytest.approx(reference.step(throttles)[1], abs=1e-5)


def test_an_action_changed_afterwards_is_not_changed_in_the_environment() -> None:
    """The picture shows the action that was taken, also when the caller reuses its array."""
    env = VehicleEnv(render_mode="rgb_array")
    env.reset(seed=0)
    action = np.ones(4)
    env.step(action)
    before = env.render()
    action[:] = 0
    np.testing.assert_array_equal(env.render(), before)


def test_delta_is_the_difference_of_reported_positions() -> None:
    """From step to step, in and out of fog."""
    steps = rollout(VehicleEnv(world((0.4, 0.4, 0.4, "fog"))), 60, seed=0, position=[0.3, 0.3])
    positions = np.stack([observation["position"] for observation, *_ in steps]).astype(float)
    deltas = np.stack([observation["delta"] for observation, *_ in steps])
    np.testing.assert_allclose(deltas[1:], np.diff(positions, axis=0), atol=1e-6)
    np.testing.assert_array_equal(deltas[0], 0)


def test_without_fog_the_reported_position_is_the_true_one() -> None:
    for observation, *_, info in rollout(VehicleEnv(), 60, seed=0):
        np.testing.assert_array_equal(observation["position"], info["position"].astype(np.float32))
        assert not info["in_fog"]


@pytest.mark.parametrize(("acts", "reach"), [("rim", 0.06), ("center", 0.0)])
def test_noise_is_where_the_fog_is(acts: Acts, reach: float) -> None:
    """Geometry: reported and true position differ when and only when disc or centre is in the fog, from reset on."""
    center, radius = np.array([1.5, 1.0]), 0.4
    env = VehicleEnv(world((*center, radius, "fog"), acts=acts))
    seen = set()
    for x in (0.5, 1.5):
        observation, info = env.reset(seed=0, options={"position": [x, 1.0]})
        for number in range(25):
            overlaps = math.hypot(*(info["position"] - center)) < radius + reach
            differs = bool((observation["position"] != info["position"].astype(np.float32)).any())
            assert overlaps == differs == info["in_fog"], (x, number, info["position"])
            seen.add(overlaps)
            observation, *_, info = env.step(np.array([1.0, 0, 0, 1]))
    assert seen == {True, False}


@pytest.mark.parametrize(
    ("acts", "distances"), [("rim", {0.455: True, 0.465: False}), ("center", {0.395: True, 0.405: False, 0.455: False})]
)
def test_a_vehicle_at_rest_is_in_fog_or_not(acts: Acts, distances: dict[float, bool]) -> None:
    """By hand: a disc of 0.06 u at some distances from the centre of fog of 0.4 u, for ten steps with closed throttles.

    A field of the same place pulls by the same rule, and its mirror image as much the other way: the vehicle rests.
    """
    pulls = [(1.5, 1.0, 0.4, "force_up"), (1.5, 1.0, 0.4, "force_down")]
    env = VehicleEnv(world((1.5, 1.0, 0.4, "fog"), *pulls, acts=acts))
    for distance, expected in distances.items():
        observation, info = env.reset(seed=1, options={"position": [1.5 + distance, 1.0]})
        for _ in range(10):
            assert info["in_fog"] is expected
            assert (observation["position"] != info["position"].astype(np.float32)).all() == expected
            observation, *_, info = env.step(np.zeros(4))
            np.testing.assert_allclose(info["position"], [1.5 + distance, 1.0], atol=1e-6)


def test_fog_that_all_but_meets_the_rim_acts() -> None:
    """By hand: `TOUCH`, ten roundings of single precision, around the distance of 0.46 u."""
    env = VehicleEnv(world((1.0, 1.0, 0.4, "fog")))
    for gap, in_fog in ((0.5 * 10 * 2**-23, True), (2 * 10 * 2**-23, False)):
        _, info = env.reset(seed=0, options={"position": [1.46 + gap, 1.0]})
        assert info["in_fog"] is in_fog


def test_noise_is_standard_normal_and_doubles_its_variance_in_deltas() -> None:
    """Section 4.1: standard deviation 1 on each coordinate, sqrt(2) on the difference of two steps (fixed seeds)."""
    env = VehicleEnv(world((1.5, 1.0, 2.0, "fog")))
    noise, deltas = [], []
    for seed in range(20):
        steps = rollout(env, 200, seed=seed)
        true = np.stack([info["position"] for *_, info in steps])
        noise.append(np.stack([observation["position"] for observation, *_ in steps]) - true)
        deltas.append(np.stack([observation["delta"] for observation, *_ in steps])[1:] - np.diff(true, axis=0))
    flat, flat_deltas = np.concatenate(noise), np.concatenate(deltas)  # 4020 and 4000 samples
    np.testing.assert_allclose(flat.std(axis=0), 1, atol=0.04)
    np.testing.assert_allclose(flat.mean(axis=0), 0, atol=0.06)
    assert abs(np.corrcoef(flat.T)[0, 1]) < 0.05
    np.testing.assert_allclose(np.quantile(flat, [0.1587, 0.8413]), [-1, 1], atol=0.06)
    np.testing.assert_allclose(flat_deltas.std(axis=0), math.sqrt(2), atol=0.06)
    following = [np.corrcoef(run[1:, axis], run[:-1, axis])[0, 1] for run in deltas for axis in (0, 1)]
    assert np.mean(following) == pytest.approx(-0.5, abs=0.03)  # of differences of independent numbers


@pytest.mark.parametrize("layout", ["original", world((0.4, 0.4, 0.4, "fog"))])
def test_view_is_the_probe_at_the_true_position(layout: Layout | str) -> None:
    """Against `view`, the look-up's function; also where the reported position is elsewhere."""
    env = VehicleEnv(layout)
    pictures = set()
    for observation, *_, info in rollout(env, 60, seed=2, position=[0.3, 0.3]):
        expected = view(env.layout.map, info["position"])
        np.testing.assert_array_equal(observation["view"], expected)
        np.testing.assert_array_equal(env.probe(info["position"]), expected)
        assert observation["view"].dtype == np.int8
        pictures.add(expected.tobytes())
    assert len(pictures) > 3


def test_probe_takes_lists_integers_and_any_shape() -> None:
    """Each alone."""
    env = VehicleEnv()
    batch = env.probe([[[0, 0], [1, 1]], [[3, 2], [9, 9]]])  # type: ignore[arg-type]
    assert batch.shape == (2, 2, 1, 11, 11)
    np.testing.assert_array_equal(batch[1, 0], env.probe(np.array([3.0, 2.0])))
    assert batch[1, 1].all() and batch[0, 0].any() and not batch[0, 0].all()


def test_info_tells_contact_and_arrival() -> None:
    """Geometry: touching within rounding of the wall; reached when nearer than `goal_radius`."""
    env = VehicleEnv(goal_radius=0.25)
    env.reset(seed=0, options={"position": [2.0, 1.0], "goal": [2.5, 1.0]})
    seen = set()
    for _ in range(30):
        *_, info = env.step(np.array([1.0, 0, 0, 1]))
        assert info["reached"] == (math.hypot(*(info["position"] - [2.5, 1.0])) < 0.25)
        assert info["touching"] == (info["position"][0] > 2.94)
        assert type(info["reached"]) is type(info["touching"]) is type(info["in_fog"]) is bool
        seen.add((info["reached"], info["touching"]))
    assert seen == {(False, False), (True, False), (False, True)}


def test_a_goal_at_the_radius_is_not_reached() -> None:
    """By hand, in binary fractions: reached is what is nearer than `goal_radius`."""
    env = VehicleEnv(goal_radius=0.25)
    for x, reached in ((2.25, False), (2.25 - 2**-20, True)):
        _, info = env.reset(seed=0, options={"position": [2.0, 1.0], "goal": [x, 1.0]})
        assert info["reached"] is reached


def test_a_step_before_reset_asks_for_reset() -> None:
    env = VehicleEnv(render_mode="rgb_array")
    for call in (lambda: env.step(np.zeros(4)), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
            call()


def test_closing_twice_is_fine() -> None:
    env = VehicleEnv(render_mode="rgb_array")
    env.close()
    env.reset(seed=0)
    picture = env.render()
    env.close()
    env.close()
    np.testing.assert_array_equal(env.render(), picture)


def pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))


WEDGE = world((0.12, 0.62, 0.1, "obstacle"), (0.8, 0.5, 0.4, "fog"), (0.6, 0.9, 0.4, "force_down"))
"""A vehicle at (0.06, 0.46) is wedged between border and obstacle; to the right lie fog and a field."""


def test_a_copy_in_flight_flies_on_to_the_same_bits(tried: Callable[[str, int, str], None]) -> None:
    """The undisturbed flight, noise included, however the original and further copies fly in the meantime.

    The vehicle is pressed into the wedge at first, by forces that Box2D keeps from step to step.
    """
    flight = [*[np.array([0.1, 0.7, 0.6, 0.2])] * 20, *[np.array([1.0, 0.2, 0.1, 0.9])] * 20, *actions(40, seed=5)]
    envs = [VehicleEnv(WEDGE) for _ in range(2)]
    for env in envs:
        env.reset(seed=4, options={"position": [0.06, 0.46]})
    expected = [envs[0].step(action) for action in flight]
    felt = {(info["touching"], info["in_fog"]) for *_, info in expected}
    assert felt >= {(True, False), (False, True), (False, False)}
    for number in range(60):
        for copied in (copy.deepcopy, pickled):
            other, further = copied(envs[1]), copied(envs[1])
            further.step(np.zeros(4))
            assert_bit_equal([other.step(action) for action in flight[number : number + 20]], expected[number:][:20])
        assert_bit_equal([envs[1].step(flight[number])], [expected[number]])
    tried("a copy or a pickle of an environment in contacts, in fog and in a field", 120, "the bits of the original")


@pytest.mark.parametrize("copied", [copy.deepcopy, pickled])
def test_a_copy_of_a_wrapped_environment_goes_on_as_the_original(copied: Callable[[Any], Any]) -> None:
    """Pictures, further resets of a drawn world, and the end of the episode; an environment before its reset, too."""
    env = copied(gymnasium.make("affmap/ProceduralHard-v0", render_mode="rgb_array", max_episode_steps=12))
    rollout(env, 5, seed=4)
    env.render()
    other = copied(env)
    flights = []
    for one in (env, other):
        steps = [one.step(action) for action in actions(7)]
        flights.append([*steps, *rollout(one, 3, seed=None)])
    assert_bit_equal(*flights)
    assert flights[0][6][3], "truncated"
    np.testing.assert_array_equal(env.render(), other.render())
    other.close()
    env.render()


def test_a_door_that_has_opened_is_not_there() -> None:
    """In layout, view and picture; a reset closes it, and a copy has what the original has."""
    env = VehicleEnv(world((1.5, 1.0, 0.3, "door"), (1.5, 0.6, 0.05, "key")), render_mode="rgb_array")
    start = {"position": [1.3, 0.6]}
    observation, _ = env.reset(seed=0, options=start)
    closed, before = env.layout, env.render()
    assert observation["view"].any()
    while env.layout is closed:
        observation, *_, info = env.step(np.array([1.0, 0, 0, 1.0]))
    assert env.layout == closed.opened == pickled(env).layout
    np.testing.assert_array_equal(observation["view"], view(closed.opened.map, info["position"]))
    assert before is not None
    np.testing.assert_array_equal(env.probe([1.5, 1.0]), np.zeros((1, 11, 11)))
    env.reset(seed=0, options=start)
    assert env.layout == closed
    np.testing.assert_array_equal(env.render(), before)
