"""Beliefs of recorded runs, by hand."""

from typing import Any

import numpy as np

from affmap.results.belief import (
    believed,
    error_after,
    errors,
    filter_error,
    noise_share,
    speeds_in_fog,
    steps_in_fog,
)
from affmap.results.files import Trajectories


def paths(in_fog: list[list[int]], off: list[list[float]], member: list[int]) -> Trajectories:
    """Runs at rest at (1, 1) whose belief after each step is off to the right by some lengths."""
    inside = np.array(in_fog, bool)
    number, steps = inside.shape
    plans = np.ones((number, steps, 2, 2))
    plans[:, :, 0, 0] += off
    plans[:, :, 1] = 7.0  # later positions of a plan are of no importance
    empty: Any = dict.fromkeys(
        ("goal", "planned_std", "action", "prediction_error", "touching", "reached"), np.empty(0)
    )
    return Trajectories(
        position=np.ones((number, steps + 1, 2)),
        planned_position=plans,
        in_fog=inside,
        member=np.array(member),
        run=np.arange(number),
        **empty,
    )


def test_the_belief_is_the_first_position_of_a_plan() -> None:
    runs = paths([[0, 1]], [[0.5, -0.25]], [0])
    np.testing.assert_allclose(believed(runs), [[[1.5, 1.0], [0.75, 1.0]]])
    np.testing.assert_allclose(errors(runs), [[0.5, 0.25]])


def test_steps_in_fog_begin_anew_with_each_entry() -> None:
    runs = paths([[0, 1, 1, 0, 1], [1, 1, 1, 1, 0]], [[0.0] * 5] * 2, [0, 0])
    assert steps_in_fog(runs).tolist() == [[0, 1, 2, 0, 1], [1, 2, 3, 4, 0]]


def test_the_error_of_a_member_is_the_root_of_its_mean_square() -> None:
    """Two moments of member 3, one of member 5, none of member 4."""
    runs = paths(
        [[1, 1, 0, 1, 1], [1, 0, 1, 0, 1], [0, 0, 1, 1, 0]],
        [[9.0, 0.3, 9.0, 9.0, 0.4], [9.0] * 5, [9.0, 9.0, 9.0, -0.2, 9.0]],
        [3, 4, 5],
    )
    np.testing.assert_allclose(error_after(runs, 2), [np.sqrt((0.3**2 + 0.4**2) / 2), np.nan, 0.2])


def test_the_noise_that_was_put_into_beliefs_is_found() -> None:
    """A share for each of two members, and other errors that have nothing of it, to the last digit."""
    rng = np.random.default_rng(0)
    noise, other = rng.normal(size=(50, 2)), rng.normal(size=(50, 2))
    other -= noise * (other * noise).sum() / (noise**2).sum()
    errors = np.array([0.3 * noise + other, 0.9 * noise - 2 * other])
    np.testing.assert_allclose(noise_share(errors, noise), [0.3, 0.9])
    assert np.isnan(noise_share(np.empty((2, 0, 2)), np.empty((0, 2)))).all()


def test_a_filter_s_error_is_that_of_a_simulation() -> None:
    """Many filters beside a vehicle at rest, long after the first report."""
    rng, gains = np.random.default_rng(0), np.array([0.1, 0.3, 1.0])
    beliefs = np.zeros((3, 20_000, 2))
    for _ in range(60):
        beliefs += gains[:, None, None] * (rng.normal(0, 1.5, beliefs.shape[1:]) - beliefs)
    np.testing.assert_allclose(filter_error(gains, 1.5), np.sqrt((beliefs**2).sum(-1).mean(1)), rtol=0.02)


def test_speeds_are_those_of_steps_that_end_in_fog() -> None:
    runs = paths([[0, 1, 1], [1, 0, 0], [0, 0, 0]], [[0.0] * 3] * 3, [2, 2, 4])
    runs.position[0, :, 0] = [0.0, 7.0, 7.1, 7.3]  # the first step ends outside
    runs.position[1, :, 1] = [0.0, 0.3, 5.0, 5.0]
    np.testing.assert_allclose(speeds_in_fog(runs), [(0.1 + 0.2 + 0.3) / 3, np.nan])
