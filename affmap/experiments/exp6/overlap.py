"""Errors of steps by the number of properties that act: the cost of overlaps for a model trained on one at a time."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.env.geometry import circle_distance
from affmap.env.layout import Layout
from affmap.results.files import Floats
from affmap.results.setting import Setting
from affmap.results.tables import Results


def num_properties(positions: Floats, layout: Layout, radius: float) -> NDArray[np.int64]:
    """Number of different effects of circles that a vehicle of `radius` (u) at `positions` `[..., 2]` is in: `[...]`.

    A circle that blocks counts up to a tenth of a unit around the vehicle, where it decides what a step does.
    """
    acting: dict[str, NDArray[np.bool_]] = {}
    for circle in layout.circles:
        reach = radius + CONTACT if circle.effect == "obstacle" else layout.reach(circle, radius)
        inside = circle_distance(positions, circle) <= reach
        acting[circle.effect] = acting.get(circle.effect, np.zeros(inside.shape, bool)) | inside
    return np.sum(list(acting.values()), axis=0) if acting else np.zeros(positions.shape[:-1], np.int64)


CONTACT = 0.1
"""u; the vehicle moves less than that in a step."""


def error_by_properties(results: Results, setting: Setting) -> pd.DataFrame:
    """Mean prediction error of each member's steps that begin where one property acts, and where several do.

    Returns:
        A row a member, columns `one` and `several`, nats; NaN without such steps.
    """
    paths, layouts, radius = (
        results.trajectories(setting),
        results.run_layouts(setting),
        results.vehicle_radius(setting),
    )
    if len(layouts) == 1:
        layouts = layouts * len(paths.run)
    number = np.stack(
        [num_properties(way[:-1], layout, radius) for way, layout in zip(paths.position, layouts, strict=True)]
    )
    steps = pd.DataFrame(
        {
            "member": np.repeat(paths.member, number.shape[1]),
            "number": number.ravel(),
            "error": paths.prediction_error.ravel(),
        }
    )
    acting = steps[steps["number"] > 0]
    kind = np.where(acting["number"] == 1, "one", "several")
    table = acting.groupby(["member", kind])["error"].mean().unstack()
    return table.reindex(index=np.unique(paths.member), columns=["one", "several"])
