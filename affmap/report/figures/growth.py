"""Affordance map of one member in the course of a longer training, in a common basis."""

from affmap.report.drawing import arena
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.figures.maps import COLORS
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None without such a training."""
    if results.growth is None or results.growth_maps is None or not results.growth_maps.snapshots:
        return None
    world = results.map_layout(results.growth)
    snapshots = results.growth_maps.snapshots
    radius = results.vehicle_radius(results.growth)
    colors = arena.paint([(arrays, world) for arrays in snapshots.values()], radius, 0)
    rows = -(-len(snapshots) // 3)
    figure = new_figure(0.4 + 1.65 * rows)
    grid = figure.subplots(rows, 3, sharex=True, sharey=True, squeeze=False)
    for ax, (epoch, arrays), picture in zip(grid.flat, snapshots.items(), colors, strict=False):
        title = f"after {epoch} epoch{'' if epoch == 1 else 's'}"
        arena.affordance_map(ax, picture, arrays.x, arrays.y, world.map).set_title(title, loc="left")
    arena.label_outer(grid, len(snapshots))
    return Drawn(
        figure,
        "Affordance map of one member in the course of a longer training, in a common basis: colours are comparable "
        f"across panels. {COLORS}",
    )
