"""Runs for the player of the page, packed for display. Knows results; `player.js` draws.

Axes: T recorded steps, H planning horizon, K channels of the view, C context code. Lengths are in units (u).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import interpn

from affmap.env.body import THROTTLES
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.env.scene import LAYERS, NUM_DEVIATIONS, circle_marks
from affmap.report.drawing.colors import readable
from affmap.report.packing import Packed, pack, pack_bits
from affmap.report.painted import map_size
from affmap.results.examples import first_member, middle_runs
from affmap.results.files import Floats
from affmap.results.setting import ALWAYS, CONTEXT_SIZE, LAYOUT, PLANNER, Factor, ReportSettings, Setting
from affmap.results.tables import Results

MAX_RUNS = 24
"""Runs of a page; with more settings than that, one run each."""

LENGTH, DEVIATION, OPENING, NATS, CODE = 1e-3, 1e-4, 1e-2, 1e-2, 1e-4
"""Resolution of displayed values: u, u, share, nats, and the context code's own unit."""


def player(results: Results, settings: ReportSettings) -> dict[str, Any]:
    """Variables of `player.html`: runs of every setting, their caption, and a legend of shape, colour and words."""
    count = max(1, MAX_RUNS // len(results.settings))
    numbers = {layout: sorted(middle_runs(results, layout)[:count]) for layout in results.layouts}
    worlds: dict[Layout, int] = {}
    factors = [LAYOUT, PLANNER, *(f for f in (results.color, results.x) if f not in ALWAYS), CONTEXT_SIZE]
    orders = {
        factor.key: list(dict.fromkeys(each.values[factor.key] for each in results.settings)) for factor in factors
    }
    orders |= {PLANNER.key: [*results.planners], CONTEXT_SIZE.key: [*results.context_sizes]}

    def place(setting: Setting) -> list[int]:
        return [orders[factor.key].index(setting.values[factor.key]) for factor in factors]

    runs = [
        run
        for setting in sorted(results.settings, key=place)
        for run in _runs(results, settings, setting, factors, numbers[setting.layout], worlds)
    ]
    size = map_size(results)
    radius = results.vehicle_radius(results.settings[0])
    data = {
        "first": next((number for number, run in enumerate(runs) if run["choice"][-2] == str(size)), 0),
        "keys": [*(factor.label.capitalize() for factor in factors), "Run"],
        "runs": runs,
        "worlds": [describe(world, radius) for world in worlds],
        "layers": {name: layer._asdict() for name, layer in LAYERS.items()},
        "throttles": THROTTLES.tolist(),
    }
    present = {circle.effect for world in worlds for circle in world.circles}
    caption = _caption(results, max(map(len, numbers.values())), present)
    return {"data": data, "caption": caption, "legend": _legend(present)}


def describe(world: Layout, radius: float) -> dict[str, Any]:
    """Describe a layout for the page: its size, the vehicle's radius (u), the marks of its circles, its channels."""
    circles = [
        {"layer": layer._asdict(), "points": points.tolist(), "radii": None if radii is None else radii.tolist()}
        for layer, points, radii in circle_marks(world)
    ]
    return {"size": world.size, "radius": radius, "circles": circles, "channels": world.channels}


def codes_along(results: Results, job: Setting, member: int, path: Floats, world: Layout) -> Floats | None:
    """Context codes `[T + 1, C]` of the member's affordance map at positions `[T + 1, 2]`, bilinear.

    None without a context, and in a world of which no map was painted.
    """
    if job.context_size == 0 or results.map_layout(job) != world:
        return None
    maps = results.read_maps(job)
    (index,) = np.flatnonzero(maps.member == member)
    codes: Floats = interpn((maps.y, maps.x), maps.codes[index], path[:, ::-1], bounds_error=False)
    return codes


def _runs(
    results: Results,
    settings: ReportSettings,
    job: Setting,
    factors: Sequence[Factor],
    numbers: list[int],
    worlds: dict[Layout, int],
) -> list[dict[str, Any]]:
    """Runs of a job; their worlds are added to `worlds`."""
    paths, layouts = results.trajectories(job), results.run_layouts(job)
    runs = []
    for number in numbers:
        member, index = first_member(paths, number)
        path = paths.position[index]
        world = layouts[index]
        runs.append(
            {
                "choice": [
                    *(readable(str(job.values[factor.key]), settings) for factor in factors),
                    f"run {number} of member {member}",
                ],
                "world": worlds.setdefault(world, len(worlds)),
                "opened": worlds.setdefault(world.opened, len(worlds)),
                "opens": int((~world.are_open(path)).sum()),  # the step from which on doors are gone
                "goal": paths.goal[index].round(3).tolist(),
                "position": pack(path, LENGTH),
                "planned": pack(paths.planned_position[index], LENGTH),
                "std": pack(paths.planned_std[index], DEVIATION),
                "action": pack(paths.action[index], OPENING),
                "error": pack(paths.prediction_error[index], NATS),
                "touching": pack_bits(paths.touching[index]),
                "in_fog": pack_bits(paths.in_fog[index]),
                "reached": pack_bits(paths.reached[index]),
                "view": pack_bits(world.views(path)),
                **_code(job, codes_along(results, job, member, path, world)),
            }
        )
    return runs


def _code(job: Setting, codes: Floats | None) -> dict[str, Packed | str | None]:
    """Context code of a run, or the reason why there is none."""
    if codes is not None:
        return {"code": pack(codes, CODE), "without": ""}
    reason = "no affordance map of this world" if job.context_size else "this model has none"
    return {"code": None, "without": reason}


def _caption(results: Results, count: int, present: set[str]) -> str:
    others = {1: "", 2: " and the next in rank"}.get(count, f" and the next {count - 1} in rank")
    caption = (
        f"Runs of the first member in every setting: for each layout, the run in the figure of trajectories{others}. "
        "Each frame shows the moment of planning: the path so far, the imagined path (ellipses: "
        f"{NUM_DEVIATIONS} standard deviations), the throttles and the view. "
    )
    if "fog" in present:
        caption += "Inside fog, plans start at the noisy reported position. "
    if any(results.map_layout(job) in results.run_layouts(job) for job in results.settings if job.context_size):
        return caption + "The context code is that of the member's affordance map at the true position."
    if max(results.context_sizes):
        return (
            caption + "There are no context codes: runs were not flown in the world whose affordance map was painted."
        )
    return caption + "There are no context codes: no model has a context."


def _legend(present: set[str]) -> list[tuple[str, str, str]]:
    """Shape, colour and words of everything that is drawn."""
    return [
        *((each.sign, each.color, each.label) for each in reversed(LAYERS.values()) if each.label),
        *(("disc", effect.color, effect.label) for name, effect in EFFECTS.items() if name in present),
    ]
