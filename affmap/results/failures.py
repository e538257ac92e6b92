"""Why runs fail, and where: pure functions of the results."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.env.effects import EFFECTS
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
"""Reason -> its name. A run that was in fog counts there, also where it did not arrive."""


SURFACE = "surface"

_TERRAINS = {name: effect.label for name, effect in EFFECTS.items() if name not in ("obstacle", "none")}

NEAREST = {SURFACE: "obstacle or border", **_TERRAINS}
"""What a vehicle can be nearest to -> its name."""


MANY = 3
"""Counts of acting circles are capped here: it stands for this many or more."""


class Places(NamedTuple):
    """Where runs of one layout went wrong; positions in u. A run may be in both."""

    fog: Floats
    """`[F, 2]` where runs were when they first were in fog."""
    ended: Floats
    """`[E, 2]` where runs that never arrived were at their end."""


def are_of_interest(results: Results) -> bool:
    """Whether runs can fail for several reasons: there is fog, or a world of its own for each run."""
    return any(has_fog(results, setting) or len(set(results.worlds(setting))) > 1 for setting in results.settings)


def has_fog(results: Results, setting: Setting) -> bool:
    """Whether there is fog where the runs of a setting fly."""
    return any(circle.effect == "fog" for world in results.worlds(setting) for circle in world.circles)


def with_reasons(results: Results) -> pd.DataFrame:
    """The runs with the column `reason`: a key of `REASONS`, or empty for a success.

    Stuck: the positions of the last quarter of the run are all nearer to their mean than the vehicle's diameter.
    """
    runs = results.runs
    diameter = 2 * results.vehicle_radius(results.settings[0])
    conditions = [runs["success"].astype(bool), runs["steps_in_fog"] > 0, runs["final_spread"] < diameter]
    return runs.assign(reason=np.select(conditions, ["", "fog", "stuck"], "other"))


def shares(runs: pd.DataFrame, column: str, kinds: Iterable[str], by: str = CONTEXT_SIZE.column) -> pd.DataFrame:
    """Share of the runs with each of some values in a column: one row per value of `by`, one column per value."""
    counts = runs.groupby(by, sort=False)[column].value_counts(normalize=True).unstack(fill_value=0)
    return counts.reindex(columns=list(kinds), fill_value=0).astype(float)


def with_nearest(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """The x value of each run, and the thing nearest to its end: a key of `NEAREST`, or empty if it arrived."""
    tables = []
    for setting in settings:
        paths = results.trajectories(setting)
        ends = zip(paths.position[:, -1], results.worlds(setting), np.any(paths.reached, axis=1), strict=True)
        things = ["" if arrived else nearest(position, world) for position, world, arrived in ends]
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], "nearest": things}))
    return pd.concat(tables, ignore_index=True)


def nearest(position: Floats, world: Layout) -> str:
    """What is nearest to a place `[2]` (u), or lies around it deepest: a key of `NEAREST`."""
    distances = {SURFACE: float(surface_distance(position, world))}
    for circle in world.circles:
        if circle.effect in _TERRAINS:
            now = float(circle_distance(position, circle))
            distances[circle.effect] = min(now, distances.get(circle.effect, now))
    return min(distances, key=lambda thing: distances[thing])


def end_distances(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """How far runs that never arrived were from fog at their end.

    Returns:
        The value on the x axis, and `distance` (u; negative inside) of each of these runs in a world with fog.
    """
    tables = []
    for setting in settings:
        paths, radius = results.trajectories(setting), results.vehicle_radius(setting)
        ends = zip(paths.position[:, -1], results.worlds(setting), np.any(paths.reached, axis=1), strict=True)
        distances = [float(fog_distance(position, world, radius)) for position, world, arrived in ends if not arrived]
        finite = [distance for distance in distances if np.isfinite(distance)]
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], "distance": finite}))
    return pd.concat(tables, ignore_index=True)


def step_errors(results: Results, settings: Sequence[Setting]) -> pd.DataFrame:
    """Prediction errors of single steps, and how many circles acted on the vehicle when they began.

    Returns:
        The value on the x axis, `acting` (at most `MANY`, for that many or more) and `prediction_error` (nats) of
        each step of each run, but for those that begin or end in fog, where what the vehicle reports is noise.
    """
    tables = []
    for setting in settings:
        paths = results.trajectories(setting)
        predicted = stats.norm(paths.planned_position[:, :, 0], paths.planned_std[:, :, 0])
        errors = -np.sum(predicted.logpdf(paths.position[:, 1:]), axis=-1)
        runs = zip(paths.position, results.worlds(setting), strict=True)
        radius = results.vehicle_radius(setting)
        counts = [acting(positions[:-1], world, radius) for positions, world in runs]
        clear = ~paths.in_fog
        clear[:, 1:] &= ~paths.in_fog[:, :-1]
        values = {"acting": np.minimum(counts, MANY)[clear], "prediction_error": errors[clear]}
        tables.append(pd.DataFrame({results.x.column: setting.values[results.x.key], **values}))
    return pd.concat(tables, ignore_index=True)


def acting(positions: Floats, world: Layout, radius: float) -> NDArray[np.integer]:
    """Number of circles that act on a vehicle of `radius` (u) at `positions` `[..., 2]` (u): `[...]`."""
    circles = [circle for circle in world.circles if circle.effect != "none"]
    inside = [affected(positions, world, circle, radius) for circle in circles]
    return np.sum(inside, axis=0) if inside else np.zeros(positions.shape[:-1], int)


def places(results: Results, settings: Sequence[Setting]) -> Places:
    """Where runs went wrong, over all context sizes above 0 (over 0 where no other was run)."""
    chosen = [setting for setting in settings if setting.context_size > 0] or settings
    fog, ended = [], []
    for setting in chosen:
        paths = results.trajectories(setting)
        entered = paths.in_fog.any(axis=1)
        first = paths.in_fog[entered].argmax(axis=1) + 1  # a step's end is the next position
        fog.append(paths.position[entered, first])
        ended.append(paths.position[~paths.reached.any(axis=1), -1])
    return Places(np.concatenate(fog), np.concatenate(ended))
