"""Coverage of the arena by the data sets."""

from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.report.drawing.colors import readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import first_settings
from affmap.results.files import Floats
from affmap.results.numbers import listed
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure."""
    parts = explored(results)
    columns = min(2, len(parts))
    rows = -(-len(parts) // columns)
    figure = new_figure(2.6, width=4.6) if len(parts) == 1 else new_figure(2.1 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax, (counts, free, coverage, world) in zip(grid.flat, parts, strict=False):
        title = f"coverage: {coverage:.1%} of the free cells"
        if len(parts) > 1:
            title = f"{readable(world.name, settings)}: {coverage:.1%} covered"
        arena.visits(ax, counts, free, world).set_title(title, loc="left")
    for ax in grid.ravel()[len(parts) :]:
        ax.set_axis_off()
    covered = [f"{coverage:.1%} in {readable(world.name, settings)}" for _, _, coverage, world in parts]
    total = sum(int(counts.sum()) for counts, _, _, _ in parts)
    return Drawn(
        figure,
        f"Coverage of the arena by the data for training and validation, {total} recorded positions in total. Share of "
        f"the free cells that were visited: {listed(covered)}; unvisited free cells are red.",
    )


def explored(results: Results) -> list[tuple[Floats, Floats, float, Layout]]:
    """Counts, free cells, coverage and layout for every training world of every data set."""
    parts: list[tuple[Floats, Floats, float, Layout]] = []
    for job in first_settings(results.settings, "data"):
        data = results.exploration(job)
        parts += zip(data.counts, data.free, data.coverage, results.training_layouts(job), strict=True)
    return parts
