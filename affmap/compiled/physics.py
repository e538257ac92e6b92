"""The physics of `affmap.env.physics` for many vehicles side by side: Box2D's treatment of a disc, in one loop nest.

In free flight it is Box2D's up to rounding. In contact it takes Box2D's steps, too: velocities are turned along the
surfaces, positions pushed out of them, and a fast vehicle is stopped at a surface and slides for the rest of the step
(continuous collision). It does not have Box2D's order where a vehicle touches several things, nor the impulses that it
keeps from one step to the next. Constants in capitals are Box2D's.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from affmap.compiled.jit import compiled, inlined

Array = np.ndarray

LINEAR_SLOP = 0.005
"""u; things may overlap by this much at rest."""
BAUMGARTE, TOI_BAUMGARTE = 0.2, 0.75
"""Share of an overlap that a correction of positions resolves, at the end of a step and at an impact."""
MAX_CORRECTION = 0.2
"""u"""
MAX_TRANSLATION = 2.0
"""u, a step."""
TOI_CORRECTIONS, MAX_IMPACTS = 20, 8
"""Corrections at an impact, at the most, and impacts of a step on one thing."""
DEPTH, TOLERANCE = 3 * LINEAR_SLOP, LINEAR_SLOP / 4
"""u; an impact is the moment at which shapes overlap by this depth, up to the tolerance."""
TINY = 1e-30
"""u; stands for a distance of zero."""
ADVANCES, ROOTS = 20, 50
"""Iterations of the search for that moment, at the most: directions, and moments for each of them."""


class Body(NamedTuple):
    """The vehicle (`affmap.env.body.Vehicle`)."""

    mass: float
    thrust: float
    damping: float
    contact_damping: float
    force: float
    time_step: float
    velocity_iterations: int
    position_iterations: int
    throttles: Array
    """`[4, 2]`, the direction of each."""


class Worlds(NamedTuple):
    """W worlds, float64; those with fewer things are padded with distances of -inf, which nothing is below."""

    solids: Array
    """`[W, S, 5]`, solid things: a point, whether its distance counts along x and along y (a circle has
    both, a border one of them), and the distance of the vehicle's centre below which it touches, u."""
    fields: Array
    """`[W, F, 6]`: centre, the distance from it below which a field acts (u), the direction of its pull, and a number;
    of fields with the same number that overlap, one acts."""


@compiled
def fly(
    body: Body,
    worlds: Worlds,
    world: Array,
    position: Array,
    velocity: Array,
    actions: Array,
    paths: Array,
) -> None:
    """Let P vehicles fly for H steps.

    Args:
        body: the vehicle.
        worlds: W of them.
        world: `[P]`, the number of each vehicle's world.
        position: `[P, 2]`, u.
        velocity: `[P, 2]`, u/step.
        actions: `[P, H, 4]`.
        paths: `[P, H, 2]`, written: the position after each step, u.
    """
    num_paths, horizon, _ = actions.shape
    contacts, impulses = np.empty((worlds.solids.shape[1], 3)), np.empty(worlds.solids.shape[1])
    for p in range(num_paths):
        solids, fields = worlds.solids[world[p]], worlds.fields[world[p]]
        x, y = position[p]
        speed_x, speed_y = velocity[p] / body.time_step
        for t in range(horizon):
            force_x, force_y = _force(body, fields, x, y, actions[p, t])
            x, y, speed_x, speed_y = _step(body, solids, x, y, speed_x, speed_y, force_x, force_y, contacts, impulses)
            paths[p, t, 0], paths[p, t, 1] = x, y


@compiled
def find_fog(fog: Array, world: Array, position: Array, result: Array) -> None:
    """Write whether vehicles are in fog into `result` `[P]`.

    Args:
        fog: `[W, G, 3]`: centre of each circle, and the distance from it below which a vehicle is in fog, u.
        world: `[P]`, as in `fly`.
        position: `[P, 2]`, u.
        result: `[P]` bool, written.
    """
    for p in range(len(position)):
        result[p] = False
        for x, y, limit in fog[world[p]]:
            result[p] |= math.hypot(position[p, 0] - x, position[p, 1] - y) < limit


@inlined
def _force(body: Body, fields: Array, x: float, y: float, action: Array) -> Any:
    """The force of throttles and fields, N."""
    force_x = force_y = 0.0
    for k in range(4):
        force_x += body.thrust * action[k] * body.throttles[k, 0]
        force_y += body.thrust * action[k] * body.throttles[k, 1]
    for k in range(len(fields)):
        if _acts(fields, k, x, y):
            again = False
            for j in range(k):
                again |= fields[j, 5] == fields[k, 5] and _acts(fields, j, x, y)
            if not again:
                force_x += body.force * fields[k, 3]
                force_y += body.force * fields[k, 4]
    return force_x, force_y


@inlined
def _acts(fields: Array, k: int, x: float, y: float) -> bool:
    """Whether a place is in a field."""
    return math.hypot(x - fields[k, 0], y - fields[k, 1]) < fields[k, 2]


@compiled
def _step(
    body: Body,
    solids: Array,
    x: float,
    y: float,
    speed_x: float,
    speed_y: float,
    force_x: float,
    force_y: float,
    contacts: Array,
    impulses: Array,
) -> Any:
    """Position (u) and velocity (u/s) after a step (b2World::Step); `contacts` and `impulses` are buffers."""
    dt = body.time_step
    touching = _find_contacts(solids, x, y, contacts)
    scale = max(1 - dt * (body.contact_damping if touching else body.damping), 0.0)
    speed_x, speed_y = (speed_x + dt * force_x / body.mass) * scale, (speed_y + dt * force_y / body.mass) * scale
    speed_x, speed_y = _deflect(solids, contacts, touching, impulses, body.velocity_iterations, speed_x, speed_y)
    new_x, new_y, speed_x, speed_y = _move(x, y, speed_x, speed_y, dt)
    new_x, new_y = _push_out(
        solids, contacts, touching, BAUMGARTE, 3 * LINEAR_SLOP, body.position_iterations, new_x, new_y
    )
    # Continuous collision (b2World::SolveTOI), impact by impact.
    begun, impacts = 0.0, 0
    while impacts < MAX_IMPACTS:
        moment = _first_impact(solids, x, y, new_x, new_y)
        if begun + (1 - begun) * moment >= 1 - 1e-6:
            break
        impacts += 1
        begun += (1 - begun) * moment
        x, y = x + moment * (new_x - x), y + moment * (new_y - y)
        touching = _find_contacts(solids, x, y, contacts)
        x, y = _push_out(solids, contacts, touching, TOI_BAUMGARTE, 1.5 * LINEAR_SLOP, TOI_CORRECTIONS, x, y)
        speed_x, speed_y = _deflect(solids, contacts, touching, impulses, body.velocity_iterations, speed_x, speed_y)
        new_x, new_y, speed_x, speed_y = _move(x, y, speed_x, speed_y, (1 - begun) * dt)
    return new_x, new_y, speed_x, speed_y


@inlined
def _away(solids: Array, s: int, x: float, y: float) -> Any:
    """The way from a solid thing to a place, and its length; from the centre of a circle.

    Exactly on it the way has no direction; then it is along x from a circle, as in Box2D, and across a border.
    """
    away_x, away_y = (x - solids[s, 0]) * solids[s, 2], (y - solids[s, 1]) * solids[s, 3]
    distance = math.hypot(away_x, away_y)
    if distance == 0:
        return solids[s, 2] * TINY, (1 - solids[s, 2]) * TINY, TINY
    return away_x, away_y, distance


@inlined
def _find_contacts(solids: Array, x: float, y: float, contacts: Array) -> int:
    """The number of solid things that are touched; `contacts` gets the number of each, and the direction away."""
    count = 0
    for s in range(len(solids)):
        away_x, away_y, distance = _away(solids, s, x, y)
        if distance <= solids[s, 4]:
            contacts[count, 0] = s
            contacts[count, 1], contacts[count, 2] = away_x / distance, away_y / distance
            count += 1
    return count


@inlined
def _deflect(
    solids: Array, contacts: Array, touching: int, impulses: Array, iterations: int, speed_x: float, speed_y: float
) -> Any:
    """The velocity without its part into touched things, by impulses that push and never pull."""
    impulses[:touching] = 0.0
    for _ in range(iterations if touching else 0):
        for c in range(touching):
            into = speed_x * contacts[c, 1] + speed_y * contacts[c, 2]
            change = max(impulses[c] - into, 0.0) - impulses[c]
            impulses[c] += change
            speed_x, speed_y = speed_x + change * contacts[c, 1], speed_y + change * contacts[c, 2]
    return speed_x, speed_y


@inlined
def _move(x: float, y: float, speed_x: float, speed_y: float, duration: float) -> Any:
    """Position and velocity after a straight flight of some seconds."""
    way = duration * math.hypot(speed_x, speed_y)
    if way > MAX_TRANSLATION:
        speed_x, speed_y = speed_x * MAX_TRANSLATION / way, speed_y * MAX_TRANSLATION / way
    return x + duration * speed_x, y + duration * speed_y, speed_x, speed_y


@inlined
def _push_out(
    solids: Array, contacts: Array, touching: int, share: float, enough: float, iterations: int, x: float, y: float
) -> Any:
    """The position, moved out of touched things until it overlaps nothing by more than `enough` (u)."""
    for _ in range(iterations if touching else 0):
        deepest = 0.0
        for c in range(touching):
            s = int(contacts[c, 0])
            away_x, away_y, distance = _away(solids, s, x, y)
            overlap = solids[s, 4] - distance
            deepest = max(deepest, overlap)
            shift = min(max(share * (overlap - LINEAR_SLOP), 0.0), MAX_CORRECTION)
            x, y = x + shift * away_x / distance, y + shift * away_y / distance
        if deepest <= enough:
            break
    return x, y


@inlined
def _first_impact(solids: Array, x: float, y: float, new_x: float, new_y: float) -> float:
    """When, from 0 to 1, a straight way first leads into something; 1 where it does not."""
    first, way = 1.0, math.hypot(new_x - x, new_y - y)
    for s in range(len(solids)):
        _, _, distance = _away(solids, s, x, y)
        target = solids[s, 4] - DEPTH
        if distance - way > target + TOLERANCE:
            continue
        first = min(first, _impact(solids, s, target, x, y, new_x - x, new_y - y))
    return first


@compiled
def _impact(solids: Array, s: int, target: float, x: float, y: float, way_x: float, way_y: float) -> float:
    """The time of impact on one thing (b2TimeOfImpact): conservative advancement along the direction to it."""
    now = 0.0
    for _ in range(ADVANCES):
        away_x, away_y, distance = _away(solids, s, x + now * way_x, y + now * way_y)
        if distance < target + TOLERANCE:
            return now
        # Along the current direction to it the distance changes evenly.
        away_x, away_y = away_x / distance, away_y / distance
        slope = way_x * away_x + way_y * away_y
        at_end = distance + (1 - now) * slope
        if at_end > target + TOLERANCE:
            return 1.0
        now = _root(target, now, distance, at_end) if at_end <= target - TOLERANCE else 1.0
    return now


@inlined
def _root(target: float, now: float, distance: float, at_end: float) -> float:
    """When an even change from `distance` now to `at_end` meets the target: secants and bisections, as Box2D does."""
    low, high, at_low, at_high = now, 1.0, distance, at_end
    moment = low
    for k in range(ROOTS):
        moment = low + (target - at_low) * (high - low) / (at_high - at_low) if k % 2 else (low + high) / 2
        at_moment = distance + (moment - now) / (1 - now) * (at_end - distance)
        if abs(at_moment - target) < TOLERANCE:
            break
        if at_moment > target:
            low, at_low = moment, at_moment
        else:
            high, at_high = moment, at_moment
    return moment
