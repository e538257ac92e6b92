"""The vehicle as data: its throttles and physical constants. Knows no simulator."""

import math
from typing import Self

import numpy as np
from pydantic import model_validator

from affmap.settings import Count, NonNegative, Positive, Settings

THROTTLES = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / math.sqrt(2)
"""`[4, 2]`, direction in which each throttle pushes: between the axes, counter-clockwise from the upper right."""


class Vehicle(Settings):
    """Physical constants (`conf/vehicle`)."""

    radius: Positive
    """u."""
    mass: Positive
    """kg."""
    thrust: Positive
    """Force of one throttle fully open, N."""
    damping: NonNegative
    """Linear damping in free flight, 1/s."""
    contact_damping: NonNegative
    """Linear damping while touching an obstacle or a border, 1/s."""
    force: NonNegative
    """Strength of a force field, N."""
    fog_std: NonNegative
    """Standard deviation of the noise on each coordinate of the position reported from inside fog, u."""
    time_step_s: Positive
    """Duration of a step, s."""
    velocity_iterations: Count
    """Box2D's solver iterations for velocities, a step."""
    position_iterations: Count
    """Box2D's solver iterations for positions, a step."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key in ("damping", "contact_damping"):
            if getattr(self, key) * self.time_step_s >= 1:
                raise ValueError(
                    f"{key} = {getattr(self, key)} with time_step_s = {self.time_step_s} would stop the vehicle for "
                    f"good; it must be below 1 / time_step_s = {1 / self.time_step_s:g}."
                )
        return self

    @property
    def top_speed(self) -> float:
        """Speed at which damping balances two neighbouring throttles fully open, u per step."""
        if self.damping == 0:
            return math.inf
        # In a step Box2D adds the thrust, then scales by 1 - damping * time step.
        scale = 1 - self.damping * self.time_step_s
        return math.sqrt(2) * self.thrust / (self.mass * self.damping) * self.time_step_s * scale
