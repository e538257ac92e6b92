"""Beliefs of recorded runs, by hand."""

from typing import Any

import numpy as np

from affmap.results.belief import believed, error_after, errors, steps_in_fog
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
