"""Plots of what happens in the arena: layouts, affordance maps, flights and plans. Lengths are in u."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from affmap.env.body import AnyVehicle
from affmap.env.body import load as load_vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import AnyLayout, first_layout
from affmap.env.scene import LAYERS, Scene, circle_marks
from affmap.plot.canvas import canvas, legend_beside
from affmap.report.drawing import arena
from affmap.report.drawing.colors import GROUP_COLORS
from affmap.results.files import Trajectories
from affmap.results.setting import ReportSettings
from affmap.settings import ConfigError
from affmap.settings.messages import format_value
from affmap.threads import limited

if TYPE_CHECKING:  # need torch
    from affmap.control.agent import Agent
    from affmap.control.episodes import Runs
    from affmap.control.time_to_go import TimeToGo
    from affmap.model.lookup import AffordanceMap

END = "o"
"""Sign of the place where a run ended."""

FEW, FAINT = 12, 0.2
"""Paths of more runs are transparent, down to this opacity, so that those below stay visible."""


def layout(layout: AnyLayout, *, vehicle: AnyVehicle | None = None, ax: Axes | None = None) -> Axes:
    """Draw a layout: circles coloured by effect, the squares where runs start and end, and the vehicle to scale.

    Args:
        layout: as `affmap.fly` takes it; of rules for worlds, the first world of member 0 is drawn.
        vehicle: such as `agent.vehicle`; or some of its keys and values; or the name of its file in `conf/vehicle`; by
            default that of `conf/vehicle/default.yaml`.
        ax: where to draw.

    Raises:
        ConfigError: there is no such layout or vehicle.
    """
    world, radius = first_layout(layout, seed=0), load_vehicle("default" if vehicle is None else vehicle).radius
    with canvas(ax) as axes:
        arena.world_map(axes, world, radius)
        legend_beside(axes, arena.effect_handles([world]))
    return axes


def affordance_map(source: Agent | AffordanceMap, *, index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw an affordance map: the codes' first three principal components as red, green and blue, circles outlined.

    Keys and doors that they open have colours of their own.

    Args:
        source: a map; or an agent, whose map is painted where it looks up codes exactly.
        index: of the map among those of all members (and worlds).
        ax: where to draw.

    Raises:
        ConfigError: there is no such map, or it has no codes because the context size is 0.
    """
    painted = map_of(source)
    number, num_rows, num_columns, context_size = painted.codes.shape
    if context_size == 0:
        raise ConfigError("models of context size 0 have no codes, and so no affordance map; take another size.")
    if index not in range(number):
        raise ConfigError(f"index = {format_value(index)} is not allowed: there are {number} maps, 0 to {number - 1}.")
    world = painted.worlds[index if len(painted.worlds) > 1 else 0]
    x, y = (np.linspace(0, side, num) for side, num in zip(world.size, (num_columns, num_rows), strict=True))
    with canvas(ax) as axes:
        arena.affordance_map(axes, painted.picture(index), x, y, world)
        arena.lock(axes, world)
    return axes


def time_to_go(agent: Agent, goal: ArrayLike | TimeToGo, *, index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw times to go to a goal as lines over an affordance map: what actions do here, and in the whole arena.

    Numbers are steps and what their uncertainty costs (`affmap.TimeToGo`); the goal is a cross. With doors they are
    those before a key is visited; those after it are drawn of an agent in the opened world and of `ways.opened`.

    Args:
        agent: an agent with a context code.
        goal: `[2]`, u; or the times to go that this agent has imagined already, which takes seconds.
        index: of the map among those of all members (and worlds).
        ax: where to draw.

    Raises:
        ConfigError: there is no such map, the context size is 0, or the goal is outside the arena.
    """
    from affmap.control.time_to_go import TimeToGo  # needs torch

    painted = map_of(agent)
    with canvas(ax) as axes:
        affordance_map(painted, index=index, ax=axes)
        made = goal
        if not isinstance(made, TimeToGo):
            made = TimeToGo.imagine(agent, np.broadcast_to(made, (len(painted.codes), 2)))
        if index >= len(made.goals):
            raise ConfigError(f"index = {index} is not allowed: there are times to go to {len(made.goals)} goals only.")
        arena.times_to_go(axes, made.clear(index), made.x, made.y, made.levels(index))
        layer = LAYERS["goal"]
        axes.plot(*made.goals[index], color=layer.color, ls="", zorder=4, **arena.SIGNS["cross"])
    return axes


def map_of(source: Agent | AffordanceMap) -> AffordanceMap:
    """The map of an agent; for one that looks up codes exactly, a map as fine as those of reports is painted.

    Raises:
        ConfigError: the agent knows no codes of places.
    """
    from affmap.control.agent import Agent
    from affmap.model.lookup import AffordanceMap, ExactLookup

    lookup = source.lookup if isinstance(source, Agent) else source
    if isinstance(lookup, AffordanceMap):
        return lookup
    if isinstance(source, Agent) and isinstance(lookup, ExactLookup):
        with limited(1):
            spacing = ReportSettings.load("report", "default").map_spacing
            return AffordanceMap.paint(source.stack, lookup.worlds, spacing)
    raise ConfigError(f"{type(source).__name__} has no affordance map; give a map, or an agent with a trained model.")


def trajectories(runs: Runs, layout: AnyLayout | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the paths of runs in their layout, coloured by the number of the run.

    Args:
        runs: of `affmap.fly`, for instance.
        layout: of those that the runs flew in; may be left out if all runs share theirs.
        ax: where to draw.

    Raises:
        ConfigError: no run flew in that layout, or they flew in several and none is named; or there are no runs.
    """
    _check(runs)
    world = _world(runs, layout)
    chosen = [index for index, each in enumerate(runs.layouts) if each == world]
    paths = Trajectories(**{key: array[chosen] for key, array in runs.trajectories.items()})
    opacity = max(FAINT, min(1.0, FEW / len(chosen)))
    with canvas(ax) as axes:
        arena.paint_marks(axes, circle_marks(world))
        for path, goal, run in zip(paths.position, paths.goal, paths.run, strict=True):
            color = GROUP_COLORS[run % len(GROUP_COLORS)]
            looks = {LAYERS[name]: LAYERS[name]._replace(color=color, opacity=opacity) for name in ("past", "start")}
            looks[LAYERS["goal"]] = LAYERS["goal"]
            marks = Scene(world, 0.0, path[-1], goal, past=path, start=path[0]).marks()
            arena.paint_marks(axes, [mark._replace(layer=looks[mark.layer]) for mark in marks if mark.layer in looks])
            axes.plot(*path[-1], marker=END, ms=4, color=color, zorder=3)
        signs = {"start": arena.SIGNS["square"], "end": {"marker": END, "ms": 4}, "goal": arena.SIGNS["cross"]}
        colors = {"goal": LAYERS["goal"].color}
        handles = [
            Line2D([], [], ls="", color=colors.get(name, "black"), label=name, **sign) for name, sign in signs.items()
        ]
        legend_beside(axes, [*handles, *arena.effect_handles([world])])
        arena.arena(axes, world)
    return axes


def plan(
    runs: Runs, index: int = 0, step: int = 0, *, vehicle: AnyVehicle | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the plan of a step: imagined positions with their uncertainty, the way there, vehicle and goal.

    Args:
        runs: of `affmap.fly`, for instance.
        index: of the run among all B.
        step: number of the step, from 0.
        vehicle: as for `layout`; by default that of the runs.
        ax: where to draw.

    Raises:
        ConfigError: there is no such run, step or vehicle, or there are no runs.
    """
    _check(runs)
    paths = Trajectories(**runs.trajectories)
    num_runs, num_steps = paths.prediction_error.shape
    for name, value, number in (("index", index, num_runs), ("step", step, num_steps)):
        if value not in range(number):
            raise ConfigError(f"{name} = {format_value(value)} is not allowed: give a number from 0 to {number - 1}.")
    radius = load_vehicle(runs.vehicle if vehicle is None else vehicle).radius
    moment = paths.scene(index, step, runs.layouts[index], radius)._replace(action=None)
    with canvas(ax) as axes:
        arena.scene(axes, moment)
        legend_beside(axes, arena.handles([moment]))
    return axes


def _check(runs: Any) -> None:
    """Make sure that runs are those of a flight, and no agent, for instance.

    Raises:
        ConfigError: they are none.
    """
    from affmap.control.episodes import Runs

    if not isinstance(runs, Runs):
        raise ConfigError(f"runs = {format_value(runs)} is not allowed; give runs of affmap.fly.")


def _world(runs: Runs, layout: AnyLayout | None) -> Layout:
    """The layout to draw, of those that the runs flew in."""
    flown = list(dict.fromkeys(runs.layouts))
    if layout is None and len(flown) == 1:
        return flown[0]
    if layout is None:
        raise ConfigError(f"the runs flew in {len(flown)} layouts; choose one, such as layout=runs.layouts[0].")
    world = first_layout(layout, seed=0)
    if world not in flown:
        names = ", ".join(dict.fromkeys(each.name for each in flown))
        raise ConfigError(f"no run flew in this layout {world.name!r}; they flew in {names}.")
    return world
