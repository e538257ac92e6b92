"""A disc with four throttles in a Box2D world: forces in, position out.

Knows no observations, rewards or pictures. A `Physics` is one Box2D world from start to end; make a new one for a new
start, because removing bodies does not restore a Box2D world. A copy or a pickle flies all steps again, because
Box2D keeps forces of contacts from step to step where nobody can read them: so it goes on to the same bits.
"""

from __future__ import annotations

import math
from typing import Any

import Box2D
import numpy as np

from affmap.env.body import THROTTLES, Vehicle
from affmap.env.effects import EFFECTS, INERT, SOLID, check_effect, force_at, pulls
from affmap.env.layout import Layout

TOUCH = 10 * float(np.finfo(np.float32).eps)
"""u; Box2D counts shapes nearer than this as overlapping. So do we for terrains, which are no part of its world."""


class Physics:
    """One vehicle in one world.

    Attributes:
        vehicle: its physical constants.
        layout: the world as it is now: once the vehicle has been at a key, without its doors.
    """

    def __init__(self, layout: Layout, vehicle: Vehicle, position: np.ndarray) -> None:
        """Put the vehicle at rest at `position` `[2]` (u)."""
        self.vehicle, self.layout = vehicle, layout
        self._start = layout, vehicle, np.array(position, float)
        self._actions = bytearray()  # of all steps so far, 32 bytes each
        self._world = Box2D.b2World(gravity=(0, 0))
        width, height = layout.size
        corners = [(0, 0), (width, 0), (width, height), (0, height)]
        for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
            # Box2D gives edges a thickness of 0.01; without it the vehicle touches where the border is drawn.
            edge = Box2D.b2EdgeShape(vertices=[begin, end], radius=0.0)
            self._add(edge)
        self._doors: list[Box2D.b2Body] = []
        for circle in layout.obstacles:
            body = self._add(Box2D.b2CircleShape(pos=circle.center, radius=circle.radius))
            if circle.effect == "door":
                self._doors.append(body)
        self._terrains = [
            (*circle.center, circle.radius + layout.reach(circle, vehicle.radius) + TOUCH, circle.effect)
            for circle in layout.circles
            if circle.effect not in SOLID | INERT
        ]
        self._pulls = pulls()
        forces = {name: EFFECTS[check_effect(name)].force for *_, name in self._terrains}
        self._forces = [(*circle, force) for circle in self._terrains if (force := forces[circle[3]])]
        density = vehicle.mass / (math.pi * vehicle.radius**2)
        shape = Box2D.b2FixtureDef(shape=Box2D.b2CircleShape(radius=vehicle.radius), density=density, friction=0)
        self._body = self._world.CreateDynamicBody(
            position=(float(position[0]), float(position[1])), fixedRotation=True, allowSleep=False, fixtures=shape
        )
        self._feel()

    def _add(self, shape: Box2D.b2Shape) -> Box2D.b2Body:
        return self._world.CreateStaticBody(fixtures=Box2D.b2FixtureDef(shape=shape, friction=0, restitution=0))

    @property
    def position(self) -> np.ndarray:
        """Centre of the vehicle, `[2]` in u."""
        return np.array(self._body.position.tuple)

    @property
    def velocity(self) -> np.ndarray:
        """`[2]` in u per step."""
        return np.array(self._body.linearVelocity.tuple) * self.vehicle.time_step_s

    def step(self, action: np.ndarray) -> None:
        """Apply the throttles `action` `[4]`, each in [0, 1], for one time step.

        Damping and force fields are those of the vehicle's place at the beginning of the step.
        """
        vehicle, action = self.vehicle, np.asarray(action, float)
        effects = self._effects
        force = vehicle.thrust * action @ THROTTLES
        for effect, direction in self._pulls.items():
            if effects[effect]:
                force = force + effects[effect] * vehicle.force * np.array(direction)
        for x, y, limit, effect, function in self._forces:
            if math.hypot(*(offset := self.position - (x, y))) < limit:
                force = force + force_at(effect, function, offset, self.velocity / vehicle.time_step_s)
        self._actions += action.tobytes()
        self._body.linearDamping = vehicle.contact_damping if effects["obstacle"] else vehicle.damping
        self._body.ApplyForceToCenter((float(force[0]), float(force[1])), True)
        self._world.Step(vehicle.time_step_s, vehicle.velocity_iterations, vehicle.position_iterations)
        self._feel()

    def __reduce__(self) -> tuple[Any, ...]:
        return _replay, (*self._start, np.frombuffer(bytes(self._actions)).reshape(-1, 4))

    def _feel(self) -> None:
        """Open the doors if the vehicle is at a key; count the things of each effect that act on it at its place."""
        if self._doors and self.layout.map.at_key(self.position):
            for door in self._doors:
                self._world.DestroyBody(door)
            self._doors, self.layout = [], self.layout.opened
        # Box2D finds contacts at the beginning of a step; a step of no time finds the current ones and moves nothing.
        self._world.Step(0.0, self.vehicle.velocity_iterations, self.vehicle.position_iterations)
        effects = self._effects = dict.fromkeys(EFFECTS, 0)
        effects["obstacle"] = sum(edge.contact.touching for edge in self._body.contacts)
        x, y = self._body.position
        for center_x, center_y, limit, effect in self._terrains:
            effects[effect] += math.hypot(x - center_x, y - center_y) < limit
        self.touching, self.in_fog = effects["obstacle"] > 0, effects["fog"] > 0


def _replay(layout: Layout, vehicle: Vehicle, position: np.ndarray, actions: np.ndarray) -> Physics:
    """A new world after steps with `actions` `[T, 4]`."""
    physics = Physics(layout, vehicle, position)
    for action in actions:
        physics.step(action)
    return physics
