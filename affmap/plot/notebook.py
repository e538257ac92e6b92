"""Pictures of objects in notebooks, with captions: HTML that holds a PNG. None where there is nothing to draw."""

import base64
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from affmap.env.effects import EFFECTS
from affmap.env.layout import Arena, Layout
from affmap.env.procedural import Procedural
from affmap.env.rules import Rules
from affmap.plot import arena
from affmap.plot.canvas import LAYOUT
from affmap.random import generator
from affmap.report.drawing.files import DPI, style
from affmap.results.numbers import counted, listed

if TYPE_CHECKING:  # need torch
    from affmap.control.agent import Agent
    from affmap.control.episodes import Runs
    from affmap.model.lookup import AffordanceMap

WIDTH, HEIGHT = 3.9, 2.3
"""Inches, of a picture of one arena."""

NUM_WORLDS = 3
"""Example worlds of rules."""

NUM_ROWS = 8
"""Rows of a table of runs."""

PIXELS_PER_INCH = 96
"""Of a browser, whatever its screen has."""

Draw = Callable[[Axes], object]
"""Draws on Axes."""


def layout(world: Layout) -> str:
    """A layout with its name, size and circles."""
    counts = Counter(circle.effect for circle in world.circles)
    circles = listed([f"{effect.label} ({counts[name]})" for name, effect in EFFECTS.items() if counts[name]])
    return _figure([partial(_world, world)], f"{_place(world)} Circles: {circles}.")


def rules(rules: Rules) -> str | None:
    """The first worlds that member 0 flies in under some rules; None if no world obeys them."""
    try:
        worlds = [rules.draw(generator(0, "world", run)) for run in range(NUM_WORLDS)]
    except ValueError:
        return None
    facts = f"{_place(rules)} Rules for worlds with {_contents(rules)}. The first of member 0:"
    return _figure([partial(_world, world) for world in worlds], facts)


def _contents(rules: Rules) -> str:
    if not isinstance(rules, Procedural):
        return f"things at random places: {listed([EFFECTS[effect].label for effect in rules.effects])}"
    low, high = rules.count
    kinds = listed([f"{EFFECTS[effect].label}" for effect in rules.effects])
    return f"{low} to {high} circles {'of each kind' if rules.count_of == 'property' else 'in all'}: {kinds}"


def affordance_map(painted: "AffordanceMap") -> str | None:
    """The first map, with its size and the meaning of colours; None without codes."""
    number, num_rows, num_columns, context_size = painted.codes.shape
    if context_size == 0:
        return None
    facts = f"Affordance map, context size {context_size}, {num_columns} × {num_rows} nodes. {_colors(number)}"
    return _figure([lambda ax: arena.affordance_map(painted, ax=ax)], facts)


def agent(agent: "Agent") -> str | None:
    """The map of an agent's first member, in the world that it is in; None without codes."""
    if agent.stack.context_size == 0:
        return None
    painted = arena.map_of(agent)
    members = f"member{'' if len(agent.seeds) == 1 else 's'} {listed([*map(str, agent.seeds)])}"
    facts = (
        f"Agent, {members}; {agent.stack.settings.name}; {type(agent.planner).__name__}, horizon "
        f"{agent.planner.horizon}. {_colors(len(painted.codes))}"
    )
    return _figure([lambda ax: arena.affordance_map(painted, ax=ax)], facts)


def runs(runs: "Runs") -> str | None:
    """The trajectories of the runs in the first layout, and the first rows of the table; None without runs."""
    if runs.table.empty:
        return None
    world, number = runs.layouts[0], runs.layouts.count(runs.layouts[0])
    facts = f"{counted(number, 'run')} in {world.name}"
    if number < len(runs.layouts):
        facts += f", of {len(runs.layouts)} in several worlds"
    facts += f"; the first {NUM_ROWS} rows of their table." if len(runs.table) > NUM_ROWS else "."
    rows = runs.table.head(NUM_ROWS).to_html(index=False, float_format="{:.3g}".format, border=0)
    picture = _figure([lambda ax: arena.trajectories(runs, world, ax=ax)], facts)
    return f'{picture}<div style="overflow-x: auto">{rows}</div>'


def _world(world: Layout, ax: Axes) -> Axes:
    return arena.layout(world, ax=ax)


def _place(arena: Arena) -> str:
    """Name and size of an arena."""
    width, height = arena.size
    return f"{arena.name}, {width:g} × {height:g} u."


def _colors(number: int) -> str:
    """The meaning of colours, and which of several maps is shown."""
    which = f" The first of {number} maps." if number > 1 else ""
    return f"Three principal components of the context codes are red, green and blue.{which}"


def _figure(draws: Sequence[Draw], caption: str) -> str:
    """Pictures side by side, below a caption."""
    with style():
        figure = Figure(figsize=(WIDTH * len(draws), HEIGHT), layout=LAYOUT)
        for draw, ax in zip(draws, figure.subplots(1, len(draws), squeeze=False)[0], strict=True):
            draw(ax)
        png = BytesIO()
        figure.savefig(png, format="png", dpi=DPI)
    source = base64.b64encode(png.getvalue()).decode()
    width = round(PIXELS_PER_INCH * figure.get_figwidth())
    picture = f'<img alt="{escape(caption)}" width="{width}" src="data:image/png;base64,{source}">'
    return f'<figure style="margin: 0"><figcaption>{escape(caption)}</figcaption>{picture}</figure>'
