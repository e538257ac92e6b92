"""The halo of fog: places just outside that models mistake for fog. Pure functions of the predicted deviations."""

import numpy as np

from affmap.env.geometry import Mask, circle_distance, reachable
from affmap.env.layout import Layout
from affmap.results.files import Deviations, Floats

WIDTH = 0.05
"""u beyond the edge of fog, about a pixel of the view."""

UNCERTAIN = 0.1
"""u; a place with a larger predicted deviation is mistaken for fog, whose noise is ten times as large."""


def fog_distance(positions: Floats, layout: Layout, radius: float) -> Floats:
    """Distance to fog of a vehicle of `radius` (u) at `positions` `[..., 2]`: `[...]` in u.

    Negative in fog, infinite if there is none.
    """
    fog = [circle for circle in layout.circles if circle.effect == "fog"]
    distances = [circle_distance(positions, circle) - layout.reach(circle, radius) for circle in fog]
    return np.min(distances, axis=0) if distances else np.full(positions.shape[:-1], np.inf)


def halo(deviations: Deviations, layout: Layout, radius: float) -> Floats:
    """Share of the places just outside fog that each member mistakes for fog, `[M]`; steps from there have no noise."""
    distance = fog_distance(deviations.nodes, layout, radius)
    return _uncertain(deviations, layout, radius, (distance >= 0) & (distance <= WIDTH))


def beyond(deviations: Deviations, layout: Layout, radius: float) -> Floats:
    """Share of the places farther than `WIDTH` from fog that each member mistakes for fog, `[M]`."""
    return _uncertain(deviations, layout, radius, fog_distance(deviations.nodes, layout, radius) > WIDTH)


def _uncertain(deviations: Deviations, layout: Layout, radius: float, places: Mask) -> Floats:
    """Share of reachable nodes among `places` with a large deviation along x or y, `[M]`; NaN if there are none."""
    std = deviations.std[:, places & reachable(deviations.nodes, layout, radius)]  # [M, nodes, 2]
    if not std.shape[1]:
        return np.full(len(std), np.nan)
    return np.asarray((std.max(-1) > UNCERTAIN).mean(1))
