"""The worlds of a report."""

from collections.abc import Collection

from affmap.env.effects import INERT, SOLID
from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import first_settings, map_size, maps_of_size
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results

NUM_WORLDS = 3
"""Worlds worlds of a layout whose runs each have their own world."""


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    worlds = shown_worlds(results, settings)
    columns = min(3, len(worlds))
    rows = -(-len(worlds) // columns)
    figure = new_figure(2.6, width=4.0) if len(worlds) == 1 else new_figure(0.4 + 5.4 / columns * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (title, world) in zip(grid.flat, worlds.items(), strict=False):
        arena.world_map(ax, world, results.vehicle_radius(results.settings[0]))
        if len(worlds) > 1:
            ax.set_title(title, loc="left", fontsize=7)
    for ax in grid.ravel()[len(worlds) :]:
        ax.set_axis_off()
    if handles := arena.effect_handles(worlds.values()):
        figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return Drawn(figure, _caption(worlds.values()))


def shown_worlds(results: Results, settings: ReportSettings) -> dict[str, Layout]:
    """Title -> layout, for the worlds of training, of control and of the maps, each once."""
    roles_of: dict[Layout, list[str]] = {}
    for job in first_settings(results.settings, "data"):
        for world in results.training_layouts(job):
            roles_of.setdefault(world, []).append("training")
    for job in first_settings(results.settings, "layout"):
        layouts = list(dict.fromkeys(results.run_layouts(job)))
        for number, world in enumerate(layouts[:NUM_WORLDS]):
            roles_of.setdefault(world, []).append("control" if len(layouts) == 1 else f"control, run {number}")
    size = map_size(results)
    for part in maps_of_size(results, size) if size else []:
        roles_of.setdefault(part.world, []).append("maps")
    return {
        f"{readable(world.name, settings)} ({', '.join(dict.fromkeys(roles))})": world
        for world, roles in roles_of.items()
    }


def _caption(worlds: Collection[Layout]) -> str:
    acts = {world.acts for world in worlds if any(circle.effect not in SOLID | INERT for circle in world.circles)}
    where = {"center": "when its centre is inside them", "rim": "as soon as it overlaps them"}
    terrains = f" Fog and force fields act on it {' or '.join(where[each] for each in sorted(acts))}." if acts else ""
    return (
        "The worlds: circles coloured by effect, borders (frame), the squares from which starts and goals are drawn "
        f"(red, dashed), and the vehicle to scale (green).{terrains} If every run has its own world, those of the "
        f"first {NUM_WORLDS} runs are shown."
    )
