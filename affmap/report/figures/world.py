"""The worlds of a report, each once."""

from collections.abc import Collection

from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import first_settings, map_size, painted
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results

NUM_WORLDS = 3
"""How many worlds are shown of a layout whose runs each have a world of their own."""


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    shown = shown_worlds(results, settings)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = new_figure(2.6, width=4.0) if len(shown) == 1 else new_figure(0.4 + 5.4 / columns * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (title, world) in zip(grid.flat, shown.items(), strict=False):
        arena.world_map(ax, world, results.vehicle_radius(results.settings[0]))
        if len(shown) > 1:
            ax.set_title(title, loc="left", fontsize=7)
    for ax in grid.ravel()[len(shown) :]:
        ax.set_axis_off()
    if handles := arena.effect_handles(shown.values()):
        figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return Drawn(figure, _caption(shown.values()))


def shown_worlds(results: Results, settings: ReportSettings) -> dict[str, Layout]:
    """Title -> the worlds of a report, each once: of training, of control, and of the maps."""
    found: dict[Layout, list[str]] = {}
    for job in first_settings(results.settings, "data"):
        for world in results.training_layouts(job):
            found.setdefault(world, []).append("training")
    for job in first_settings(results.settings, "layout"):
        flown = list(dict.fromkeys(results.run_layouts(job)))
        for number, world in enumerate(flown[:NUM_WORLDS]):
            found.setdefault(world, []).append("control" if len(flown) == 1 else f"control, run {number}")
    size = map_size(results)
    for part in painted(results, size) if size else []:
        found.setdefault(part.world, []).append("maps")
    return {
        f"{readable(world.name, settings)} ({', '.join(dict.fromkeys(roles))})": world for world, roles in found.items()
    }


def _caption(worlds: Collection[Layout]) -> str:
    acts = {
        world.acts for world in worlds if any(circle.effect not in ("obstacle", "none") for circle in world.circles)
    }
    where = {"center": "where its centre is inside", "rim": "as soon as it overlaps them"}
    terrains = f" Fog and force fields act on it {' or '.join(where[each] for each in sorted(acts))}." if acts else ""
    return (
        "The worlds: circles by what they do, borders (frame), the squares that starts and goals are drawn from "
        f"(red, dashed), and the vehicle to scale (green).{terrains} Where every run has a world of its own, those of "
        f"the first {NUM_WORLDS} runs are shown."
    )
