"""Flights that policies are trained in: where they begin and end, and what they sense, act and are rewarded with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from affmap.data.collect import free_position
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.rivals.policy import STATE, parts
from affmap.view import PIXELS


def task(layout: Layout, vehicle: Vehicle, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draw a start and a goal, as options of `VehicleEnv.reset`.

    In half of the flights they are in opposite corners, as in tests; in the other half they are any two free places.
    """
    if rng.uniform() < 0.5:
        corner = int(rng.integers(4))
        return {"position": rng.uniform(*layout.corner(corner)), "goal": rng.uniform(*layout.corner(3 - corner))}
    return {key: free_position(layout, vehicle, rng) for key in ("position", "goal")}


class Flights(gymnasium.Env[np.ndarray, np.ndarray]):
    """Flights in some layouts for libraries of reinforcement learning.

    An observation is that of a policy, `[6 + K x 121]`; an action has throttles from -1 (closed) to 1 (open); the
    reward is minus the distance to the goal, u. A flight ends after `num_steps`, in truncation.
    """

    def __init__(self, layouts: Sequence[Layout], vehicle: Vehicle, num_steps: int) -> None:
        """Make an environment that draws a layout for each flight."""
        self._envs = [VehicleEnv(layout, vehicle) for layout in layouts]
        self._num_steps, self._step = num_steps, 0
        num_pixels = len(layouts[0].channels) * PIXELS**2
        self.observation_space = spaces.Box(-np.inf, np.inf, (STATE + num_pixels,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the next flight."""
        super().reset(seed=seed)
        self._env = self._envs[int(self.np_random.integers(len(self._envs)))]
        own = task(self._env.layout, self._env.vehicle, self.np_random)
        observation, info = self._env.reset(seed=int(self.np_random.integers(2**31)), options=own)
        self._step = 0
        return _features(observation), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly for a step."""
        observation, reward, terminated, _, info = self._env.step(np.clip((action + 1) / 2, 0, 1))
        self._step += 1
        return _features(observation), reward, terminated, self._step == self._num_steps, info


def _features(observation: Mapping[str, np.ndarray]) -> np.ndarray:
    """What a policy's network is given, its state and its pixels, `[6 + K x 121]`."""
    state = parts(observation["position"], observation["delta"], observation["goal"])
    return np.concatenate([*state, observation["view"].ravel()], dtype=np.float32, casting="unsafe")
