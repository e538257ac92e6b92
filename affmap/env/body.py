"""The vehicle as data: its throttles and physical constants, within the limits of Box2D, which is not imported."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from affmap.settings import Count, Length, Neutral, NonNegative, Positive, Settings, preset, read
from affmap.settings.changes import changed

THROTTLES = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / math.sqrt(2)
"""`[4, 2]`, direction in which each throttle pushes: between the axes, counter-clockwise from the upper right."""

ROUNDING = 1e-6
"""Throttles at most this far outside [0, 1] are clipped: wrappers that scale actions compute in single precision."""

MIN_RADIUS = 0.01
"""u, twice Box2D's slop, by which things may overlap: vehicles of up to one slop fly right through borders."""

MIN_SPEED, MAX_SPEED = 1e-7, 2.0
"""u per step. In single precision, a position in the arena stays the same with less; Box2D moves nothing further."""

Iterations = Annotated[Count, Field(le=1000)]
"""Iterations of a solver; a disc among circles needs a handful."""


class Vehicle(Settings, defaults="vehicle/default"):
    """Physical constants of the vehicle (`conf/vehicle`)."""

    radius: Annotated[Length, Field(ge=MIN_RADIUS)] = preset()
    """Radius, u."""
    mass: Positive = preset()
    """Mass, kg."""
    thrust: Positive = preset()
    """Force of one throttle fully open, N."""
    damping: NonNegative = preset()
    """Linear damping in free flight, 1/s."""
    contact_damping: NonNegative = preset()
    """Linear damping while touching an obstacle or a border, 1/s."""
    force: NonNegative = preset()
    """Strength of a force field, N."""
    fog_std: Annotated[NonNegative, Field(le=1000)] = preset()
    """Standard deviation of the noise on each coordinate of the position reported from inside fog, u."""
    sensor_std: Annotated[NonNegative, Neutral(0.0), Field(le=1000)] = preset()
    """Standard deviation of further noise on each coordinate of every reported position, u."""
    time_step_s: Positive = preset()
    """Duration of a step, s."""
    velocity_iterations: Iterations = preset()
    """Box2D's solver iterations for velocities, a step."""
    position_iterations: Iterations = preset()
    """Box2D's solver iterations for positions, a step."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key in ("damping", "contact_damping"):
            if getattr(self, key) * self.time_step_s >= 1:
                raise ValueError(
                    f"{key} = {getattr(self, key)} with time_step_s = {self.time_step_s} would stop the vehicle for "
                    f"good; it must be below 1 / time_step_s = {1 / self.time_step_s:g}."
                )
        for key, strength in (("thrust", math.sqrt(2) * self.thrust), ("force", self.force)):  # of two throttles
            if (gain := strength / self.mass * self.time_step_s**2) > MAX_SPEED:
                raise ValueError(
                    f"{key} = {getattr(self, key)} with mass = {self.mass} and time_step_s = {self.time_step_s} speeds "
                    f"the vehicle up by {gain:.2g} u per step in a single step; Box2D flies at {MAX_SPEED:g} at most, "
                    f"so make {key} smaller or mass larger."
                )
        if self.top_speed < MIN_SPEED:
            raise ValueError(
                f"thrust = {self.thrust} with mass = {self.mass}, damping = {self.damping} and time_step_s = "
                f"{self.time_step_s} flies at {self.top_speed:.2g} u per step at most, which is lost in rounding; it "
                f"must reach {MIN_SPEED:g}, so make thrust larger or mass smaller."
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


AnyVehicle: TypeAlias = Vehicle | Mapping[str, Any] | str
"""Physical constants; or some of their keys and values; or the name of their file in `conf/vehicle`."""


def load(vehicle: AnyVehicle) -> Vehicle:
    """A vehicle: as it is, by its name in `conf/vehicle`, or from keys and values; others are those of `default`.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    if isinstance(vehicle, str):
        return Vehicle.load("vehicle", vehicle)
    if isinstance(vehicle, Vehicle):
        return vehicle
    return Vehicle.checked(changed("vehicle", read("vehicle", "default"), vehicle), "vehicle")
