"""Times to go while a door is closed and once it is open, and the way over the key."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.lines import Line2D

from affmap.control.time_to_go import TimeToGo
from affmap.env.layout import Layout
from affmap.env.scene import LAYERS, circle_marks
from affmap.experiments.exp7.claims import GUIDED, LOOKAHEAD
from affmap.experiments.exp7.figures.time_to_go import PROBLEM, agent_of_run
from affmap.model.palette import Palette
from affmap.plot.arena import map_of
from affmap.report.drawing import arena
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results
from affmap.threads import limited


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if no agent with a map flew."""
    guided = [each for each in results.where({LOOKAHEAD.key: GUIDED}) if each.context_size > 0]
    if not guided:
        return None
    paths, world = results.trajectories(guided[0]), results.run_layouts(guided[0])[PROBLEM]
    agent, start, goal = agent_of_run(results, guided[0]), paths.position[PROBLEM, 0], paths.goal[PROBLEM]
    figure = new_figure(2.6)
    panels = figure.subplots(1, 2)
    with limited(1):
        closed = TimeToGo.imagine(agent, goal)
        codes = [map_of(one).codes[0].numpy() for one in (agent, agent.elsewhere([world.opened.map]))]
    palette = Palette.fit(np.concatenate([each.reshape(-1, each.shape[-1]) for each in codes]))
    (way,) = closed.paths(start[None])
    at_key = world.are_open(way)  # [points], from the key on
    key = int(at_key.argmax()) if at_key.any() else len(way) - 1
    parts = (closed, world, way[: key + 1], "closed"), (closed.opened or closed, world.opened, way[key:], "open")
    for ax, each, (made, layout, part, name) in zip(panels, codes, parts, strict=True):
        x, y = (np.linspace(0, side, count) for side, count in zip(world.size, each.shape[1::-1], strict=True))
        arena.affordance_map(ax, palette(each), x, y, layout.map)
        arena.paint_marks(ax, circle_marks(_without_walls(layout), filled=False))
        arena.times_to_go(ax, made.clear(), made.x, made.y, made.levels())
        ax.plot(*part.T, color=LAYERS["way"].color, lw=LAYERS["way"].width)
        ax.plot(*goal, color=LAYERS["goal"].color, ls="", zorder=4, **arena.SIGNS["cross"])
        ax.set_title(f"the door is {name}", loc="left")
    panels[0].plot(*start, ls="", **arena.SIGNS["square"], color=LAYERS["start"].color, ms=4)
    arena.label_outer(np.array([panels]), 2)
    handles: list[Artist] = [*arena.effect_handles([_without_walls(world)])]
    if len(way) > 1:
        handles.append(Line2D([], [], color=LAYERS["way"].color, lw=LAYERS["way"].width, label="imagined way"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return Drawn(figure, caption(results.runs["member"].min(), len(way) > 1, bool(at_key.any())))


def caption(member: int, is_way: bool, to_key: bool) -> str:
    """Caption of a member's figure, by whether it imagines a way from the start, and one that leads to a key."""
    if to_key:
        way = (
            "Left: while the door is closed, its way from the start (square; mauve line) leads to a key. Right: from "
            "there it goes on in the map of the opened world."
        )
    elif is_way:
        way = (
            "Left: while the door is closed. Its way from the start (square; mauve line) leads to no key. Right: the "
            "opened world."
        )
    else:
        way = "Left: while the door is closed. From the start (square) it knows no way. Right: the opened world."
    return (
        f"Lines of equal times to go to the goal (cross), as member {member} imagines them before its first run: in "
        f"steps and the cost of their uncertainty, over its affordance map. {way}"
    )


def _without_walls(layout: Layout) -> Layout:
    return layout.model_copy(update={"circles": tuple(each for each in layout.circles if each.effect != "obstacle")})
