"""The vehicle as a Gymnasium environment: observations, actions, rewards. Knows no models and no planners."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from affmap.env.body import ROUNDING, AnyVehicle
from affmap.env.body import load as load_vehicle
from affmap.env.layout import Layout
from affmap.env.physics import Physics
from affmap.env.procedural import AnyLayout, load
from affmap.env.rules import Rules
from affmap.settings import Settings
from affmap.settings.messages import format_value
from affmap.view import PIXELS, view

RENDER_FPS = 30

GOALS = 1000
"""Directions that are tried for a goal at a given distance."""


class PlainSpec:
    """An environment whose specification in Gymnasium has plain values for settings, so that it can be stored."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """The specification that the environment was made from; None if it was made without Gymnasium."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            kwargs = {key: value.plain if isinstance(value, Settings) else value for key, value in spec.kwargs.items()}
            spec = replace(spec, kwargs=kwargs)
        self._spec = spec


class VehicleEnv(PlainSpec, gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """A round vehicle flies through an arena to a goal (Section 4.1 of the paper).

    ## Actions

    `Box(0, 1, [4])`: opening of each throttle; they push to the upper right, upper left, lower left and lower right.

    ## Observations

    | observation | space | unit | meaning |
    |---|---|---|---|
    | position | Box(-inf, inf, [2]) | u | reported position; it carries noise in fog, and with `sensor_std` anywhere |
    | delta | Box(-inf, inf, [2]) | u/step | change of the reported position in the last step |
    | view | MultiBinary([K, 11, 11]) | - | the 0.5 x 0.5 u around the true position, a channel for each kind of look |
    | goal | Box(0, size of the arena, [2]) | u | where to fly |

    | info | type | meaning |
    |---|---|---|
    | position | [2] | true position, u |
    | touching | bool | an obstacle, a closed door or a border is being touched |
    | in_fog | bool | the vehicle is in fog: its centre, or any part of it where the layout says `acts: rim` |
    | reached | bool | the distance to the goal is below `goal_radius` |

    ## Rewards

    Minus the distance between true position and goal, in u.

    ## Starting state

    At rest, in the square of a random corner, with its goal in the opposite one. `reset(options=...)` takes `corner`
    (0 to 3: lower left, lower right, upper left, upper right), or `position` and `goal` (`[2]`, u). Instead of a goal,
    `distance` (u) makes it a random free place so far from the start. If the layout is procedural, every reset draws
    another one, which like all else follows from the seed; not each of them can be crossed.

    ## Episode end

    An episode never terminates; environments made by `gymnasium.make` truncate it after 200 steps.

    ## Versions

    v0: the first.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": RENDER_FPS}

    def __init__(
        self,
        layout: AnyLayout = "original",
        vehicle: AnyVehicle = "default",
        goal_radius: float = 0.1,
        render_mode: str | None = None,
        views: bool = True,
    ) -> None:
        """Make an environment.

        Args:
            layout: a layout, or rules for layouts, or the keys and values of either, or the name of a file in
                `conf/layout` that holds them.
            vehicle: the physical constants; or some of their keys and values; or the name of a file in `conf/vehicle`.
            goal_radius: distance below which the goal counts as reached, u.
            render_mode: None, "rgb_array" or "human".
            views: whether observations hold the view, which is a third of the cost of a step. For the views of many
                vehicles, or of a whole flight, `probe` cuts all of them at once.

        Raises:
            ConfigError: no such file, or a value in it is not allowed, or an obstacle is in a start corner.
            ValueError: an unknown render mode, or a bad goal radius.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r} is not one of {self.metadata['render_modes']} or None.")
        if not 0 < goal_radius < np.inf:
            raise ValueError(f"goal_radius = {goal_radius} is not allowed: it should be greater than 0 and finite.")
        self._arena = load(layout)
        self.vehicle = load_vehicle(vehicle)
        self._layout = self._arena if isinstance(self._arena, Layout) else None
        if self._layout is not None:
            self._layout.check_corners(self.vehicle.radius)
        self.goal_radius = goal_radius
        self.render_mode = render_mode
        self._views = views
        self.planned_positions: np.ndarray | None = None
        """`[H, 2]` in u, drawn by `render` when given."""
        self.action_space = spaces.Box(0.0, 1.0, (4,), np.float32)
        parts: dict[str, spaces.Space] = {
            "position": spaces.Box(-np.inf, np.inf, (2,), np.float32),
            "delta": spaces.Box(-np.inf, np.inf, (2,), np.float32),
            "view": spaces.MultiBinary([len(self._arena.channels), PIXELS, PIXELS]),
            "goal": spaces.Box(np.zeros(2, np.float32), np.array(self._arena.size, np.float32)),
        }
        if not views:
            del parts["view"]
        self.observation_space = spaces.Dict(parts)  # type: ignore[assignment]  # typed as a Dict of anything
        self._physics: Physics | None = None
        self._canvas: Any = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin a new episode, the vehicle at rest.

        Raises:
            ValueError: invalid options, or no layout obeys the rules.
        """
        super().reset(seed=seed)
        options = options or {}
        if unknown := set(options) - {"corner", "position", "goal", "distance"}:
            raise ValueError(f"options {sorted(unknown)} are unknown; give corner, or position, and goal or distance.")
        if {"goal", "distance"} <= options.keys():
            raise ValueError("options have both goal and distance; give one of them.")
        layout = self._arena
        if isinstance(layout, Rules):
            layout = layout.draw(self.np_random)
            layout.check_corners(self.vehicle.radius)
        corner = options.get("corner")
        corner = int(self.np_random.integers(4)) if corner is None else corner
        if corner not in range(4):
            raise ValueError(f"corner = {corner!r} is not one of 0, 1, 2, 3.")
        start, goal = (self.np_random.uniform(*layout.corner(index)) for index in (corner, 3 - corner))
        position, goal = np.array(options.get("position", start), float), np.array(options.get("goal", goal), float)
        for key, point in (("position", position), ("goal", goal)):
            if point.shape != (2,) or not ((point >= 0) & (point <= layout.size)).all():
                raise ValueError(f"{key} = {point.tolist()} is not a point of the arena {list(layout.size)} (u).")
        if not layout.is_free(position, self.vehicle.radius):
            raise ValueError(f"position = {position.tolist()} is not free: the vehicle would overlap something solid.")
        if "distance" in options:
            goal = self._goal_at(layout, position, float(options["distance"]))
        self.goal = goal
        self.action = np.zeros(4)
        self.planned_positions = None
        self._physics = Physics(layout, self.vehicle, position)
        self._sense()
        if self.render_mode == "human":
            self.render()
        return self._observation(np.zeros(2)) | self._view(), self._info(self._distance())

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Fly for one time step.

        Raises:
            ValueError: a throttle outside [0, 1] by more than rounding, or not four of them.
            gymnasium.error.ResetNeeded: there was no `reset` before.
        """
        observation, reward, terminated, truncated, info = self.advance(action)
        return observation | self._view(), reward, terminated, truncated, info

    def advance(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Fly as in `step`, without a view: a vector of environments cuts out all views at once."""
        action = _throttles(action)
        self._running().step(action)
        self.action = action
        last = self._reported
        self._sense()
        if self.render_mode == "human":
            self.render()
        distance = self._distance()
        return self._observation(self._reported - last), -distance, False, False, self._info(distance)

    @property
    def layout(self) -> Layout:
        """The current layout; once the vehicle has been at a key, that without its doors.

        Raises:
            gymnasium.error.ResetNeeded: it is drawn by `reset`, which was not called.
        """
        if self._layout is None:
            raise gymnasium.error.ResetNeeded("Call reset() first: it draws the layout.")
        return self._layout

    def probe(self, positions: np.ndarray) -> np.ndarray:
        """Views at any `positions` `[..., 2]` (u), as in the paper's look-up map: `[..., K, 11, 11]` bool."""
        return view(self.layout.map, np.asarray(positions, float))

    def render(self) -> np.ndarray | None:
        """Draw the current moment: `[400, 600, 3]` uint8 for "rgb_array"; for "human" it goes to a window."""
        from affmap.env.rendering import Canvas
        from affmap.env.scene import Scene

        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without a render_mode; make the environment with one.")
            return None
        if self._canvas is None:
            self._canvas = Canvas(self._arena.size, window=self.render_mode == "human")
        physics = self._running()
        scene = Scene(self.layout, self.vehicle.radius, physics.position, self.goal, self.goal_radius, self.action)
        self._canvas.draw(scene._replace(path=self.planned_positions, in_fog=physics.in_fog))
        return self._canvas.show(RENDER_FPS) if self.render_mode == "human" else self._canvas.array()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_canvas": None}  # a copy draws by itself

    def _running(self) -> Physics:
        if self._physics is None:
            raise gymnasium.error.ResetNeeded("Call reset() before the first step() or render().")
        return self._physics

    def _goal_at(self, layout: Layout, position: np.ndarray, distance: float) -> np.ndarray:
        """A random place, free for the vehicle, at a distance (u) from a position `[2]` (u): `[2]` in u.

        Raises:
            ValueError: none was found, or the distance is none.
        """
        if not 0 < distance < math.inf:
            raise ValueError(f"distance = {distance} is not allowed: it should be greater than 0 and finite.")
        angles = self.np_random.uniform(0, 2 * math.pi, GOALS)
        places = position + distance * np.column_stack([np.cos(angles), np.sin(angles)])
        free = layout.is_free(places, self.vehicle.radius)
        if not free.any():
            raise ValueError(f"distance = {distance}: no place so far from {position.tolist()} is free for a goal.")
        return np.asarray(places[free.argmax()])

    def _sense(self) -> None:
        """Update the true position and the one reported by the vehicle's sensors."""
        physics = self._running()
        self._layout = physics.layout
        noise = self.np_random.normal(0, self.vehicle.fog_std, 2) if physics.in_fog else 0.0
        if self.vehicle.sensor_std:
            noise = noise + self.np_random.normal(0, self.vehicle.sensor_std, 2)
        self._position = physics.position
        self._reported = self._position + noise

    def _distance(self) -> float:
        """Distance from the true position to the goal, u."""
        gap = self._position - self.goal
        return math.sqrt(gap @ gap)  # three times as fast as NumPy's norm

    def _observation(self, delta: np.ndarray) -> dict[str, np.ndarray]:
        return {
            "position": self._reported.astype(np.float32),
            "delta": delta.astype(np.float32),
            "goal": self.goal.astype(np.float32),
        }

    def _view(self) -> dict[str, np.ndarray]:
        return {"view": self.probe(self._position).view(np.int8)} if self._views else {}

    def _info(self, distance: float) -> dict[str, Any]:
        physics = self._running()
        return {
            "position": self._position.copy(),
            "touching": physics.touching,
            "in_fog": physics.in_fog,
            "reached": distance < self.goal_radius,
        }


def _throttles(action: np.ndarray) -> np.ndarray:
    """An action as an array of its own, `[4]` float64; throttles that rounding has put outside [0, 1] are clipped.

    Raises:
        ValueError: more than rounding, or not four real numbers.
    """
    try:
        array = np.asarray(action)
    except (TypeError, ValueError):  # rows of several lengths
        array = np.array(repr(action))
    if array.shape == (4,) and array.dtype.kind in "biuf":
        throttles = array.astype(float)
        if all(0 <= throttle <= 1 for throttle in throttles.tolist()):
            return throttles
        clipped = throttles.clip(0, 1)
        if (abs(throttles - clipped) <= ROUNDING).all():
            return clipped
    raise ValueError(f"action = {format_value(array.tolist())} is not allowed: give four numbers in [0, 1].")
