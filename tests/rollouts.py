"""Flights with fixed actions, and how tests compare them."""

from typing import Any

import numpy as np

from affmap.env import VehicleEnv

Step = tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]


def actions(num_steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(size=(num_steps, 4)).round(2).astype(np.float32)


def rollout(env: VehicleEnv, num_steps: int, seed: int | None, **options: Any) -> list[Step]:
    """Reset (given as a step of reward 0) and steps with fixed actions."""
    observation, info = env.reset(seed=seed, options=options)
    return [(observation, 0.0, False, False, info), *(env.step(action) for action in actions(num_steps))]


def assert_bit_equal(first: list[Step], second: list[Step]) -> None:
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        assert one[1:4] == other[1:4]
        for mine, its in ((one[0], other[0]), (one[4], other[4])):
            assert mine.keys() == its.keys()
            for key in mine:
                np.testing.assert_array_equal(mine[key], its[key], err_msg=key)
