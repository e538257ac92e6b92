"""Whether a world can be crossed: a flood fill over the places where the vehicle can be and steer."""

import math

import numpy as np
from scipy import ndimage

from affmap.env.body import Vehicle
from affmap.env.effects import PULLS
from affmap.env.layout import Layout

STEP = 0.01
"""Grid spacing, u."""


def crossable(layout: Layout, vehicle: Vehicle, start: np.ndarray, goal: np.ndarray) -> bool:
    """Whether the vehicle can get from `start` to `goal` `[2]` (u) steering freely all the way.

    It must touch no obstacle and no border, stay out of fog, and pass only places where two throttles can push against
    the force fields that its disc overlaps there. That is sufficient, up to the grid, on which start and goal count at
    their nearest points; it is not necessary: a vehicle may also be carried through a field, or find its way in fog.
    """
    x, y = (np.arange(round(side / STEP) + 1) * STEP for side in layout.size)
    inside_x, inside_y = (
        (axis >= vehicle.radius) & (axis <= side - vehicle.radius)
        for axis, side in zip((x, y), layout.size, strict=True)
    )
    passable = np.logical_and.outer(inside_x, inside_y)
    pull = np.zeros((*passable.shape, 2))  # N
    for circle in layout.circles:
        center_x, center_y = circle.center
        overlaps = np.hypot.outer(x - center_x, y - center_y) < circle.radius + vehicle.radius
        if circle.effect in ("obstacle", "fog"):
            passable &= ~overlaps
        elif circle.effect in PULLS:
            pull += overlaps[..., None] * vehicle.force * np.array(PULLS[circle.effect])
    passable &= np.linalg.norm(pull, axis=-1) <= math.sqrt(2) * vehicle.thrust
    areas, _ = ndimage.label(passable)  # neighbours to the sides only: no squeezing through diagonally
    nearest = np.clip(np.round(np.stack([start, goal]) / STEP).astype(int), 0, np.array(areas.shape) - 1)
    start_area, goal_area = areas[tuple(nearest.T)]
    return bool(start_area == goal_area != 0)
