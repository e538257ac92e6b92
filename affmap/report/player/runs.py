"""Runs to be played in the page: which ones, and what is shown of them. Knows results; `player.js` draws.

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
from affmap.view import view

MAX_RUNS = 24
"""Runs of a page; where there are more settings than that, each has one."""

LENGTH, DEVIATION, OPENING, NATS, CODE = 1e-3, 1e-4, 1e-2, 1e-2, 1e-4
"""What is shown is rounded to these: u, u, share, nats, and the context code's own unit."""


def player(results: Results, settings: ReportSettings) -> dict[str, Any]:
    """What `player.html` shows: runs of every setting, their caption, and a legend of shape, colour and words."""
    count = max(1, MAX_RUNS // len(results.settings))
    chosen = {layout: sorted(middle_runs(results, layout)[:count]) for layout in results.layouts}
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
        for run in _runs(results, settings, setting, factors, chosen[setting.layout], worlds)
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
    caption = _caption(results, max(map(len, chosen.values())), present)
    return {"data": data, "caption": caption, "legend": _legend(present)}


def describe(world: Layout, radius: float) -> dict[str, Any]:
    """A layout as the page draws it: its size, the vehicle's radius (u), the marks of its circles, and its channels."""
    circles = [
        {"layer": layer._asdict(), "points": points.tolist(), "radii": None if radii is None else radii.tolist()}
        for layer, points, radii in circle_marks(world)
    ]
    return {"size": world.size, "radius": radius, "circles": circles, "channels": world.channels}


def codes_along(results: Results, job: Setting, member: int, path: Floats, world: Layout) -> Floats | None:
    """Context codes `[T + 1, C]` of the member's affordance map at positions `[T + 1, 2]`, bilinear.

    None where there is none: without a context, and in a world that no map has been painted of.
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
    """Runs of a job; their worlds are put into `worlds`, unless they are there."""
    paths, flown = results.trajectories(job), results.run_layouts(job)
    found = []
    for number in numbers:
        member, index = first_member(paths, number)
        path = paths.position[index]
        world = flown[index]
        found.append(
            {
                "choice": [
                    *(readable(str(job.values[factor.key]), settings) for factor in factors),
                    f"run {number} of member {member}",
                ],
                "world": worlds.setdefault(world, len(worlds)),
                "goal": paths.goal[index].round(3).tolist(),
                "position": pack(path, LENGTH),
                "planned": pack(paths.planned_position[index], LENGTH),
                "std": pack(paths.planned_std[index], DEVIATION),
                "action": pack(paths.action[index], OPENING),
                "error": pack(paths.prediction_error[index], NATS),
                "touching": pack_bits(paths.touching[index]),
                "in_fog": pack_bits(paths.in_fog[index]),
                "reached": pack_bits(paths.reached[index]),
                "view": pack_bits(view(world.map, path)),
                **_code(job, codes_along(results, job, member, path, world)),
            }
        )
    return found


def _code(job: Setting, codes: Floats | None) -> dict[str, Packed | str | None]:
    """The context code of a run, or why there is none."""
    if codes is not None:
        return {"code": pack(codes, CODE), "without": ""}
    reason = "no affordance map of this world" if job.context_size else "this model has none"
    return {"code": None, "without": reason}


def _caption(results: Results, count: int, present: set[str]) -> str:
    others = {1: "", 2: " and the next in rank"}.get(count, f" and the {count - 1} next in rank")
    found = (
        f"Runs of the first member: in each layout the one that the figure of trajectories shows{others}, in every "
        "setting. A picture shows the moment at which a plan is made: the path so far, the path that the vehicle "
        f"imagines (ellipses: {NUM_DEVIATIONS} standard deviations), its throttles, and what it sees. "
    )
    if "fog" in present:
        found += "Inside fog a plan starts at the noisy position that the vehicle reports. "
    if any(results.map_layout(job) in results.run_layouts(job) for job in results.settings if job.context_size):
        return found + "The context code is that of the member's affordance map at the true position."
    if max(results.context_sizes):
        return found + "There are no context codes: runs were not flown in the world whose affordance map was painted."
    return found + "There are no context codes: no model has a context."


def _legend(present: set[str]) -> list[tuple[str, str, str]]:
    """Shape, colour and words of what is drawn."""
    return [
        *((each.sign, each.color, each.label) for each in reversed(LAYERS.values()) if each.label),
        *(("disc", effect.color, effect.label) for name, effect in EFFECTS.items() if name in present),
    ]
