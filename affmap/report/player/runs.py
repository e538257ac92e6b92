"""Runs to be played in the page: which ones, and what is shown of them. Knows results; `player.js` draws.

Axes: T recorded steps, H planning horizon, K channels of the view, C context code. Lengths are in units (u).
"""

from typing import Any

import numpy as np
from scipy.interpolate import interpn

from affmap.env.effects import EFFECTS
from affmap.report import blocks
from affmap.report.drawing.arena import GOAL_COLOR, NUM_DEVIATIONS, VEHICLE_COLOR
from affmap.report.drawing.colors import PLANNER_COLORS, readable
from affmap.report.figures.pictures import map_size
from affmap.report.packing import Packed, pack, pack_bits
from affmap.results.examples import first_member, middle_runs
from affmap.results.files import Floats, Job, Sight, World
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results
from affmap.view import EXTENT, view

MAX_RUNS = 24
"""Runs of a page; where there are more settings than that, each has one."""

THROTTLES = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / np.sqrt(2)
"""`[4, 2]`, direction in which each throttle pushes; those of `affmap.env.physics`, which reports do not import."""

COLORS = {"vehicle": VEHICLE_COLOR, "jet": "#d55e00", "path": "#000000", "plan": PLANNER_COLORS["cem"]}
COLORS |= {"goal": GOAL_COLOR, "frame": "#777777"}

LENGTH, DEVIATION, OPENING, NATS, CODE = 1e-3, 1e-4, 1e-2, 1e-2, 1e-4
"""What is shown is rounded to these: u, u, share, nats, and the context code's own unit."""


def player(results: Results, settings: ReportSettings) -> blocks.Block:
    """The block that plays runs of every setting."""
    count = max(1, MAX_RUNS // len(results.jobs))
    chosen = {layout: sorted(middle_runs(results, layout)[:count]) for layout in results.layouts}
    worlds: dict[tuple[World, Sight], int] = {}
    layouts, planners = results.layouts, results.planners
    jobs = sorted(
        results.jobs, key=lambda job: (layouts.index(job.layout), planners.index(job.planner), job.context_size)
    )
    runs = [run for job in jobs for run in _runs(results, settings, job, chosen[job.layout], worlds)]
    size = map_size(results)
    data = {
        "first": next((place for place, run in enumerate(runs) if run["choice"][2] == str(size)), 0),
        "keys": ["Layout", "Planner", "Context size", "Run"],
        "runs": runs,
        "worlds": [describe(world, sight) for world, sight in worlds],
        "effects": effects(),
        "colors": COLORS,
        "throttles": THROTTLES.tolist(),
        "deviations": NUM_DEVIATIONS,
        "extent": EXTENT,
    }
    present = {circle.effect for world, _ in worlds for circle in world.circles}
    return blocks.player(data, _caption(results, max(map(len, chosen.values())), present), _legend(present))


def describe(world: World, sight: Sight | None = None) -> dict[str, Any]:
    """A world as the page draws it: its size, the vehicle's radius and circles; with a sight the names of channels."""
    return {
        "size": world.size,
        "radius": world.vehicle_radius,
        "circles": [list(circle) for circle in world.circles],
        "channels": sight.channels if sight else (),
    }


def effects() -> list[dict[str, Any]]:
    """What circles do, from the lowest to the highest in a picture: name, colour, and where they pull."""
    return [{"name": name, "color": effect.color, "pull": effect.pull} for name, effect in EFFECTS.items()]


def codes_along(results: Results, job: Job, member: int, path: Floats, world: World) -> Floats | None:
    """Context codes `[T + 1, C]` of the member's affordance map at positions `[T + 1, 2]`, bilinear.

    None where there is none: without a context, and in a world that no map has been painted of.
    """
    if job.context_size == 0 or results.map_world(job) != world:
        return None
    maps = results.maps(job.layout)[job.context_size]
    (index,) = np.flatnonzero(maps.member == member)
    codes: Floats = interpn((maps.y, maps.x), maps.codes[index], path[:, ::-1], bounds_error=False)
    return codes


def _runs(
    results: Results,
    settings: ReportSettings,
    job: Job,
    numbers: list[int],
    worlds: dict[tuple[World, Sight], int],
) -> list[dict[str, Any]]:
    """Runs of a job; their worlds are put into `worlds`, unless they are there."""
    paths, flown, sights = results.trajectories(job), results.worlds(job), results.sights(job)
    found = []
    for number in numbers:
        member, index = first_member(paths, number)
        path = paths.position[index]
        world, sight = flown[index], sights[index]
        found.append(
            {
                "choice": [
                    readable(job.layout, settings),
                    readable(job.planner, settings),
                    str(job.context_size),
                    f"run {number} of member {member}",
                ],
                "world": worlds.setdefault((world, sight), len(worlds)),
                "goal": paths.goal[index].round(3).tolist(),
                "position": pack(path, LENGTH),
                "planned": pack(paths.planned_position[index], LENGTH),
                "std": pack(paths.planned_std[index], DEVIATION),
                "action": pack(paths.action[index], OPENING),
                "error": pack(paths.prediction_error[index], NATS),
                "touching": pack_bits(paths.touching[index]),
                "in_fog": pack_bits(paths.in_fog[index]),
                "reached": pack_bits(paths.reached[index]),
                "view": pack_bits(view(sight.map, path)),
                **_code(job, codes_along(results, job, member, path, world)),
            }
        )
    return found


def _code(job: Job, codes: Floats | None) -> dict[str, Packed | str | None]:
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
        f"imagines (circles: {NUM_DEVIATIONS} standard deviations), its throttles, and what it sees. "
    )
    if "fog" in present:
        found += "Inside fog a plan starts at the noisy position that the vehicle reports. "
    if any(results.map_world(job) in results.worlds(job) for job in results.jobs if job.context_size):
        return found + "The context code is that of the member's affordance map at the true position."
    if max(results.context_sizes):
        return found + "There are no context codes: runs were not flown in the world whose affordance map was painted."
    return found + "There are no context codes: no model has a context."


def _legend(present: set[str]) -> list[tuple[str, str, str]]:
    """Shape, colour and words of what is drawn."""
    return [
        ("disc", COLORS["vehicle"], "vehicle"),
        ("line", COLORS["jet"], "throttles"),
        ("line", COLORS["path"], "past path"),
        ("line", COLORS["plan"], f"imagined path, {NUM_DEVIATIONS} sd"),
        ("cross", COLORS["goal"], "goal"),
        ("square", COLORS["frame"], "what is seen"),
        *(("disc", effect.color, effect.label) for name, effect in EFFECTS.items() if name in present),
    ]
