"""Goals of agents that learn online."""

import numpy as np

from affmap.data.collect import free_position
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.learning.goals import Goals, is_reached

VEHICLE = Vehicle.load("vehicle", "default")


def test_goals_are_random_free_places_and_move_on_once_they_are_reached(world: Layout) -> None:
    """`free_position` with the same generators; the second agent is 0.11 u away from its goal, and keeps it."""
    goals = Goals(world, VEHICLE, 0.1, [np.random.default_rng(seed) for seed in (0, 1)])
    first, second = np.random.default_rng(0), np.random.default_rng(1)
    expected = np.array([free_position(world, VEHICLE, rng) for rng in (first, second)], np.float32)
    np.testing.assert_array_equal(goals.position, expected)
    goals.move_on(expected + np.array([[0.0, 0.09], [0.11, 0.0]], np.float32))
    expected[0] = free_position(world, VEHICLE, first)
    np.testing.assert_array_equal(goals.position, expected)
    assert world.is_free(goals.position, VEHICLE.radius).all()


def test_a_goal_is_reached_below_its_radius() -> None:
    """Closed form: sides of 3 and 4 have a hypotenuse of 5."""
    position, goal = np.array([[0.0, 0.0], [0.3, 0.4]]), np.array([0.3, 0.4])
    assert is_reached(position, goal, 0.51).tolist() == [True, True]
    assert is_reached(position, goal, 0.49).tolist() == [False, True]
