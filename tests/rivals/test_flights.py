"""Flights in which policies are trained."""

import numpy as np
import pytest

from affmap.control.controller import Observation
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.rivals.flights import Flights, task
from affmap.rivals.policy import pixels_of, state_of

VEHICLE = Vehicle.load("vehicle", "default")


def test_half_of_the_flights_are_from_corner_to_corner_and_all_are_free(world: Layout) -> None:
    """Counted; the other half begin and end anywhere, so that few of them are in corners."""
    rng = np.random.default_rng(0)
    tasks = [task(world, VEHICLE, rng) for _ in range(2000)]
    for key in ("position", "goal"):
        assert all(world.is_free(each[key], VEHICLE.radius) for each in tasks)
    corners = [[world.corner(corner) for corner in pair] for pair in ((0, 3), (1, 2), (2, 1), (3, 0))]

    def inside(place: np.ndarray, square: tuple[np.ndarray, np.ndarray]) -> bool:
        return bool(((place >= square[0]) & (place <= square[1])).all())

    across = [any(inside(own["position"], one) and inside(own["goal"], two) for one, two in corners) for own in tasks]
    assert np.mean(across) == pytest.approx(0.5, abs=0.04)
    assert len({tuple(own["goal"].round(1)) for own in tasks}) > 300


@pytest.mark.parametrize("names", [["original"], ["training_fog", "training_force_up"]])
def test_a_flight_is_what_the_environment_and_a_policy_say(names: list[str]) -> None:
    """The environment flown by hand with the same actions, and the inputs of a network."""
    layouts = [Layout.load("layout", name) for name in names]
    flights, rng = Flights(layouts, VEHICLE, 5), np.random.default_rng(1)
    seen, info = flights.reset(seed=3)
    again, _ = Flights(layouts, VEHICLE, 5).reset(seed=3)
    np.testing.assert_array_equal(seen, again)
    env = VehicleEnv(flights._env.layout, VEHICLE)
    env.reset(seed=0, options={"position": info["position"], "goal": flights._env.goal})
    for step in range(5):
        action = rng.uniform(-1.2, 1.2, 4).astype(np.float32)
        seen, reward, terminated, truncated, info = flights.step(action)
        expected, _, _, _, own = env.step(((action + 1) / 2).clip(0, 1))
        assert reward == -np.linalg.norm(info["position"] - env.goal)
        assert (terminated, truncated) == (False, step == 4)
        np.testing.assert_allclose(info["position"], own["position"])
        if not info["in_fog"]:
            one = Observation.of([expected])
            np.testing.assert_allclose(seen, np.concatenate([state_of(one)[0], pixels_of(one)[0]]), atol=1e-5)


def test_layouts_take_turns_at_random() -> None:
    """Each of two is drawn in about half of the flights."""
    layouts = [Layout.load("layout", name) for name in ("original", "two_obstacles")]
    flights = Flights(layouts, VEHICLE, 5)
    flights.reset(seed=0)
    drawn = []
    for _ in range(100):
        flights.reset()
        drawn.append(flights._env.layout.name)
    assert 30 < drawn.count("original") < 70
