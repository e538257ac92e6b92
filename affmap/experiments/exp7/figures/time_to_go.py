"""Maps of times to go, and the flights of greedy agents and of one that has such a map."""

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from affmap.control.agent import Agent
from affmap.control.pretrained import read_members
from affmap.control.settings import ControlSettings
from affmap.env.scene import circle_marks
from affmap.experiments.exp7.claims import DEAD_ENDS, GUIDED, LOOKAHEAD
from affmap.model.lookup import LookupSettings, make_lookup
from affmap.planning.cem import CEMPlanner
from affmap.plot.arena import time_to_go
from affmap.report.drawing import arena
from affmap.report.drawing.colors import group_colors, name_of, readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.setting import LAYOUT, ReportSettings, Setting
from affmap.results.tables import Results
from affmap.threads import limited

PROBLEM = 0
"""Index of the run that is shown: the first member's first one, from the lower left corner."""


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    layouts = [layout for layout in results.layouts if layout in DEAD_ENDS] or results.layouts[:1]
    values = dict.fromkeys(each.values.get(LOOKAHEAD.key, "") for each in results.settings)
    names = {value: name_of(LOOKAHEAD, value, settings) for value in values}
    colors, figure = group_colors(names), new_figure(3.9)
    grid = figure.subplots(2, len(layouts), squeeze=False)
    stories = []
    for (upper, lower), layout in zip(grid.T, layouts, strict=True):
        flown = {names[each.values.get(LOOKAHEAD.key, "")]: each for each in results.where({LAYOUT.key: layout})}
        setting = flown.get(names.get(GUIDED, ""), next(iter(flown.values())))
        agent, goal = agent_of_run(results, setting), results.trajectories(setting).goal[PROBLEM]
        if agent.stack.context_size > 0:
            with limited(1):
                time_to_go(agent, goal, ax=upper)
        upper.set_title(readable(layout, settings), loc="left")
        ends = {name: _flight(lower, results, each, colors[name]) for name, each in flown.items()}
        arrived = [f"{name} after {end}" for name, end in ends.items() if end]
        stories.append(f"{readable(layout, settings)}: {', '.join(arrived) or 'none'}")
    arena.label_outer(grid, grid.size)
    handles = [Line2D([], [], color=color, label=name) for name, color in colors.items() if name in names.values()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return Drawn(figure, _caption(results, "; ".join(stories)))


def agent_of_run(results: Results, setting: Setting) -> Agent:
    """The first member of a setting, in the world of the run that is shown."""
    world, config = results.run_layouts(setting)[PROBLEM], results.provenance[setting.control[0]]["config"]
    member, folder = int(results.trajectories(setting).member[PROBLEM]), setting.train[0]
    stack, losses = read_members(folder.parent, folder.name, [folder.name], [member])
    lookup = make_lookup(LookupSettings.model_validate(config["lookup"]), stack, [world.map])
    control = ControlSettings.model_validate({"device": "cpu", **config["control"]})
    planner = CEMPlanner.model_validate(config["planner"])
    return Agent(stack, lookup, planner, control, world.channels, results.vehicle(setting), losses)


def _flight(ax: Axes, results: Results, setting: Setting, color: str) -> int:
    """Draw a flight until it arrives; returns the number of steps until then, or 0."""
    paths, world = results.trajectories(setting), results.run_layouts(setting)[PROBLEM]
    reached = paths.reached[PROBLEM]
    steps = int(reached.argmax()) + 1 if reached.any() else 0
    arena.paint_marks(ax, circle_marks(world))
    ax.plot(*paths.position[PROBLEM][: steps + 1 if steps else None].T, color=color, lw=1.2, zorder=3)
    ax.plot(*paths.goal[PROBLEM], color="black", ls="", zorder=4, **arena.SIGNS["cross"])
    arena.arena(ax, world)
    return steps


def _caption(results: Results, arrivals: str) -> str:
    member = results.runs["member"].min()
    return (
        "Top: lines of equal times to go to the goal (cross), in steps and the cost of their uncertainty, as member "
        f"{member} imagines them from rest at the nodes of a grid. They follow the corridors, because no imagined step "
        "gets through a wall. Below them its affordance map, of which all is made. Bottom: one run of each agent from "
        "the lower left corner, the first of this member, until it arrives. Arrivals, in steps: "
        f"{arrivals}."
    )
