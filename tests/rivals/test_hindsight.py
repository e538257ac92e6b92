"""Steps whose goals are chosen in hindsight, against a loop over all steps and later moments."""

import numpy as np

from affmap.rivals.hindsight import Hindsight

RNG = np.random.default_rng(0)
DATA = {
    "position": RNG.uniform(0, 2, (3, 8, 2)).astype(np.float32),
    "view": RNG.integers(2, size=(3, 7, 2, 11, 11)).astype(bool),
    "action": RNG.uniform(size=(3, 7, 4)).astype(np.float32),
}


def test_every_later_moment_is_drawn_and_no_other() -> None:
    """Among the first six steps, up to three steps away, and not after the end."""
    drawn = Hindsight(DATA).draw(5000, 6, 3, np.random.default_rng(1))
    expected = {
        (sequence, step, later)
        for sequence in range(3)
        for step in range(6)
        for later in range(step + 1, min(step + 3, 7) + 1)
    }
    assert {*zip(*(part.tolist() for part in drawn), strict=True)} == expected


def test_sensations_are_those_before_a_step() -> None:
    """Read from the arrays; at its beginning, a sequence has not moved."""
    data = Hindsight(DATA)
    sequence, step = np.array([0, 2, 1]), np.array([0, 3, 6])
    seen = data.observation(sequence, step, data.position[sequence, step + 1])
    for row, (one, now) in enumerate(zip(sequence, step, strict=True)):
        position = DATA["position"][one]
        np.testing.assert_array_equal(seen.position[row], position[now])
        np.testing.assert_array_equal(seen.delta[row], position[now] - position[now - 1] if now else np.zeros(2))
        np.testing.assert_array_equal(seen.view[row], DATA["view"][one, now])
        np.testing.assert_array_equal(seen.goal[row], position[now + 1])
