"""Reasons and places of failures: pure functions of the results."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.env.effects import EFFECTS, INERT, SOLID
from affmap.env.geometry import affected, circle_distance, surface_distance
from affmap.env.layout import Layout
from affmap.lazy import stats
from affmap.results.files import Floats
from affmap.results.halo import fog_distance
from affmap.results.setting import CONTEXT_SIZE, Setting
from affmap.results.tables import Results

REASONS = {
    "fog": "was in fog",
    "stuck": "never arrived: stuck",
    "other": "never arrived: other",
}
"""Reason -> its name. A run that was in fog counts as such, also if it did not arrive."""

SURFACE = "surface"

MANY = 3
"""Counts of acting circles are capped here: it stands for this many or more."""


class Places(NamedTuple):
    """Places where runs of one layout went wrong, in u. A run may be in both."""

    fog: Floats
    """`[F, 2]` first places in fog."""
    ended: Floats
    """`[E, 2]` last places of runs that never arrived."""


def are_of_interest(results: Results) -> bool:
    """Whether runs can fail for several reasons: there is fog, or each run has a layout of its own."""
    return results.has_own_layouts() or any(has_fog(results, setting) for setting in results.settings)


def has_fog(results: Results, setting: Setting) -> bool:
    """Whether there is fog in the layouts of a setting's runs."""
    return any(circle.effect == "fog" for layout in results.run_layouts(setting) for circle in layout.circles)


def with_reasons(results: Results) -> pd.DataFrame:
    """The runs with the column `reason`: a key of `REASONS`, or empty for a success.

    Stuck: the positions of the last quarter of the run are all nearer to their mean than the vehicle's diameter.
    """
    runs = results.runs
    diameter = 2 * results.vehicle_radius(results.settings[0])
    conditions = [runs["success"].astype(bool), runs["steps_in_fog"] > 0, runs["final_spread"] < diameter]
    return runs.assign(reason=np.select(conditions, ["", "fog", "stuck"], "other"))


def shares(runs: pd.DataFrame, column: str, kinds: Iterable[str], by: str = CONTEXT_SIZE.column) -> pd.DataFrame:
    """Shares of the runs with each of some values in a column: one row per value of `by`, one column per value."""
    counts = runs.groupby(by, sort=False)[column].value_counts(normalize=True).unstack(fill_value=0)
    return counts.reindex(columns=list(kinds), fill_value=0).astype(float)


def with_nearest(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """The x value of each run, and the thing nearest to its end: a key of `things`, or empty if it arrived."""
    tables = []
    for setting in settings:
        paths = results.trajectories(setting)
        ends = zip(paths.position[:, -1], results.run_layouts(setting), np.any(paths.reached, axis=1), strict=True)
        names = ["" if arrived else nearest(position, layout) for position, layout, arrived in ends]
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], "nearest": names}))
    return pd.concat(tables, ignore_index=True)


def things() -> dict[str, str]:
    """Thing that a vehicle can be nearest to -> its name."""
    terrains = {name: effect.label for name, effect in EFFECTS.items() if name not in SOLID | INERT}
    return {SURFACE: "obstacle or border", **terrains}


def nearest(position: Floats, layout: Layout) -> str:
    """The thing nearest to a place `[2]` (u), or deepest around it: a key of `things`."""
    distances = {SURFACE: float(surface_distance(position, layout))}
    for circle in layout.circles:
        if circle.effect not in SOLID | INERT:
            distance = float(circle_distance(position, circle))
            distances[circle.effect] = min(distance, distances.get(circle.effect, distance))
    return min(distances, key=lambda thing: distances[thing])


def end_distances(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """Distances from fog at the end of runs that never arrived.

    Returns:
        The value on the x axis, and `distance` (u; negative inside), of each of these runs in a layout with fog.
    """
    tables = []
    for setting in settings:
        paths, radius = results.trajectories(setting), results.vehicle_radius(setting)
        ends = zip(paths.position[:, -1], results.run_layouts(setting), np.any(paths.reached, axis=1), strict=True)
        distances = [float(fog_distance(position, layout, radius)) for position, layout, arrived in ends if not arrived]
        finite = [distance for distance in distances if np.isfinite(distance)]
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], "distance": finite}))
    return pd.concat(tables, ignore_index=True)


def step_errors(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """Prediction errors of single steps, and the number of circles acting on the vehicle when they began.

    Returns:
        The value on the x axis, `acting` (at most `MANY`, for that many or more) and `prediction_error` (nats) of
        each step of each run, but for those that begin or end in fog, where reported positions are noise.
    """
    tables = []
    for setting in settings:
        paths = results.trajectories(setting)
        prediction = stats.norm(paths.planned_position[:, :, 0], paths.planned_std[:, :, 0])
        errors = -np.sum(prediction.logpdf(paths.position[:, 1:]), axis=-1)
        runs = zip(paths.position, results.run_layouts(setting), strict=True)
        radius = results.vehicle_radius(setting)
        counts = [acting(positions[:-1], layout, radius) for positions, layout in runs]
        clear = ~paths.in_fog
        clear[:, 1:] &= ~paths.in_fog[:, :-1]
        values = {"acting": np.minimum(counts, MANY)[clear], "prediction_error": errors[clear]}
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], **values}))
    return pd.concat(tables, ignore_index=True)


def acting(positions: Floats, layout: Layout, radius: float) -> NDArray[np.integer]:
    """Number of circles that act on a vehicle of `radius` (u) at `positions` `[..., 2]` (u): `[...]`."""
    circles = [circle for circle in layout.circles if circle.effect not in INERT]
    inside = [affected(positions, layout, circle, radius) for circle in circles]
    return np.sum(inside, axis=0) if inside else np.zeros(positions.shape[:-1], int)


def places(results: Results, settings: Sequence[Setting]) -> Places:
    """Places where runs went wrong, over all context sizes above 0 (over 0 if there is no other)."""
    fog, ended = [], []
    for setting in [setting for setting in settings if setting.context_size > 0] or settings:
        paths = results.trajectories(setting)
        any_fog = paths.in_fog.any(axis=1)
        first = paths.in_fog[any_fog].argmax(axis=1) + 1  # a step's end is the next position
        fog.append(paths.position[any_fog, first])
        ended.append(paths.position[~paths.reached.any(axis=1), -1])
    return Places(np.concatenate(fog), np.concatenate(ended))
