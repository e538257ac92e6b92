"""Maps of times to go, and the flights of greedy agents and of one that has such a map."""

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from affmap.control.agent import Agent
from affmap.control.pretrained import read_members
from affmap.control.settings import ControlSettings
from affmap.env.layout import Layout
from affmap.env.scene import circle_marks
from affmap.experiments.exp7.claims import DEAD_ENDS, GUIDED
from affmap.model.lookup import LookupSettings, make_lookup
from affmap.planning.cem import CEMPlanner
from affmap.plot.arena import time_to_go
from affmap.report.drawing import arena
from affmap.report.drawing.colors import Groups, make_groups, readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.setting import LAYOUT, ReportSettings, Setting
from affmap.results.tables import Results
from affmap.threads import limited

PROBLEM = 0
"""Index of the run that is shown: the first member's first one, from the lower left corner."""


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    layouts = [layout for layout in results.layouts if layout in DEAD_ENDS] or results.layouts[:1]
    figure, groups = new_figure(3.9), make_groups(results, settings)
    grid = figure.subplots(2, len(layouts), squeeze=False)
    stories = []
    for (upper, lower), layout in zip(grid.T, layouts, strict=True):
        flown = results.where({LAYOUT.key: layout})
        guided = next((each for each in flown if each.values.get(results.color.key) == GUIDED), flown[-1])
        agent, goal = _agent(results, guided), results.trajectories(guided).goal[PROBLEM]
        if agent.stack.context_size > 0:
            with limited(1):
                time_to_go(agent, goal, ax=upper)
        upper.set_title(readable(layout, settings), loc="left")
        ends = {name: _flight(lower, results, setting, groups, name) for setting, name in _named(flown, groups)}
        arrived = [f"{name} after {end}" for name, end in ends.items() if end]
        stories.append(f"{readable(layout, settings)}: {', '.join(arrived) or 'none'}")
    arena.label_outer(grid, grid.size)
    handles = [Line2D([], [], color=groups.palette[name], label=name) for name in groups.names.values()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return Drawn(figure, _caption(results, "; ".join(stories)))


def _named(flown: list[Setting], groups: Groups) -> list[tuple[Setting, str]]:
    """Settings with the names of their agents."""
    values = [next((value for value in each.values.values() if value in groups.names), None) for each in flown]
    return [(each, groups.names[value]) for each, value in zip(flown, values, strict=True) if value is not None]


def _agent(results: Results, setting: Setting) -> Agent:
    """The first member of a setting, in the world of the run that is shown."""
    world, config = _world(results, setting), results.provenance[setting.control[0]]["config"]
    member = int(results.trajectories(setting).member[PROBLEM])
    folder = setting.train[0]
    stack, losses = read_members(folder.parent, folder.name, [folder.name], [member])
    lookup = make_lookup(LookupSettings.model_validate(config["lookup"]), stack, [world.map])
    control = ControlSettings.model_validate({"device": "cpu", **config["control"]})
    planner = CEMPlanner.model_validate(config["planner"])
    return Agent(stack, lookup, planner, control, world.channels, results.vehicle(setting), losses)


def _world(results: Results, setting: Setting) -> Layout:
    return results.run_layouts(setting)[PROBLEM]


def _flight(ax: Axes, results: Results, setting: Setting, groups: Groups, name: str) -> int:
    """Draw a flight until it arrives; returns the number of steps until then, or 0."""
    paths, world = results.trajectories(setting), _world(results, setting)
    reached = paths.reached[PROBLEM]
    steps = int(reached.argmax()) + 1 if reached.any() else 0
    path = paths.position[PROBLEM][: steps + 1 or None] if steps else paths.position[PROBLEM]
    arena.paint_marks(ax, circle_marks(world))
    ax.plot(*path.T, color=groups.palette[name], lw=1.2, zorder=3)
    ax.plot(*paths.goal[PROBLEM], color="black", ls="", zorder=4, **arena.SIGNS["cross"])
    arena.arena(ax, world)
    return steps


def _caption(results: Results, arrivals: str) -> str:
    member = results.runs["member"].min()
    return (
        f"Top: times to go to the goal (cross), steps and the cost of their uncertainty, as member {member} imagines "
        "them from rest at the nodes of a grid; lines bend around walls because no imagined step gets through. Below "
        "them its affordance map, from which all is made. Bottom: one run of each agent from the lower left corner, "
        f"the first of this member, until it arrives. Arrivals, in steps: {arrivals}."
    )
