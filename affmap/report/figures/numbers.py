"""Figures of numbers: the main results, outcomes, and failures."""

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from affmap.report.drawing import arena
from affmap.report.drawing import numbers as panels
from affmap.report.drawing.colors import make_groups, readable
from affmap.report.figures import pictures
from affmap.report.figures.files import new_figure
from affmap.results import failures as failing
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def main_results(results: Results, settings: ReportSettings) -> Figure:
    """The paper's main figure: learning curves, an affordance map, prediction error and the outcome of control.

    Where the same models are shown in several worlds, maps of new worlds take the places of both.
    """
    figure = new_figure(5.2)
    grid = figure.add_gridspec(2, 2)
    if worlds := pictures.several_worlds(results)[:2]:
        for cell, part, colors, letter in zip((0, 1), worlds, pictures.paint(worlds, 0), "AB", strict=True):
            ax = arena.affordance_map(figure.add_subplot(grid[0, cell]), colors, part.maps, part.world)
            ax.set_title(
                f"{letter}  Map: {readable(part.world.name, settings)}, C = {part.job.context_size}", loc="left"
            )
    else:
        _curves(figure, grid[0, 0], results, settings)
        _map(figure.add_subplot(grid[0, 1]), results)
    groups = make_groups(results, settings)
    error, outcome = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    panels.boxes(error, results.runs, "prediction_error", groups, settings.axes.get("prediction_error"))
    error.set_title("C", loc="left")
    draw = panels.boxes if settings.outcome == "mean_distance" else panels.bars
    draw(outcome, results.runs, settings.outcome, groups, settings.axes.get(settings.outcome))
    outcome.set_title("D", loc="left")
    return figure


def _map(ax: Axes, results: Results) -> None:
    """The map of the last layout: the one that an experiment is about."""
    size = pictures.map_size(results)
    if size is None:
        ax.set_title("B  Affordance map", loc="left")
        ax.text(0.5, 0.5, "no context size above 0 was run", ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    part = pictures.painted(results, size)[-1]
    arena.affordance_map(ax, pictures.paint([part], 0)[0], part.maps, part.world)
    ax.set_title(f"B  Affordance map (C = {size}, member {part.maps.member[0]})", loc="left")


def _curves(figure: Figure, cell: SubplotSpec, results: Results, settings: ReportSettings) -> None:
    """Learning curves, side by side where models were trained for each layout."""
    trained = results.validation["layout"].unique()
    layouts = [layout for layout in results.layouts if layout in trained]
    axes = cell.subgridspec(1, len(layouts)).subplots(sharey=True, squeeze=False)[0]
    for ax, layout in zip(axes, layouts, strict=True):
        of_layout = results.validation[results.validation["layout"] == layout]
        panels.learning_curves(ax, of_layout, settings.axes.get("validation_nll"))
        ax.label_outer()
        if ax is not axes[-1]:
            ax.get_legend().remove()
        if len(layouts) > 1:
            ax.text(0.98, 0.98, readable(layout, settings), ha="right", va="top", transform=ax.transAxes)
    axes[0].set_title("A  Loss by context size", loc="left")


def outcomes(results: Results, settings: ReportSettings) -> Figure:
    """Arrivals and contact, and the distance where success is measured otherwise; the paper does not show them."""
    groups = make_groups(results, settings)
    metrics = ["reached", "steps_touching", *(["mean_distance"] if settings.outcome != "mean_distance" else [])]
    figure = new_figure(2.6)
    share, touching, *distance = figure.subplots(1, len(metrics))
    panels.bars(share, results.runs, "reached", groups, intervals=True).set_title("A", loc="left")
    panels.boxes(touching, results.runs, "steps_touching", groups).set_title("B", loc="left")
    for ax in distance:
        panels.boxes(ax, results.runs, "mean_distance", groups).set_title("C", loc="left")
    return figure


def failures(results: Results, settings: ReportSettings) -> Figure | None:
    """Why runs fail, and where: a row of panels for each planner or layout."""
    if not failing.are_of_interest(results):
        return None
    runs = failing.with_reasons(results)
    groups = make_groups(results, settings)
    figure = new_figure(0.5 + 1.9 * len(groups.names))
    rows = figure.subplots(len(groups.names), 3, squeeze=False, width_ratios=(1.0, 1.15, 1.15))
    for (bars, middle, right), (value, name) in zip(rows, groups.names.items(), strict=True):
        panels.reasons(bars, runs[runs[groups.column] == value])
        layout, planner = (value, results.planners[0]) if groups.column == "layout" else (results.layouts[0], value)
        flown = results.worlds(next(job for job in results.jobs if (job.layout, job.planner) == (layout, planner)))
        bars.set_title(f"{name}: failed runs" if len(groups.names) > 1 else "Failed runs", loc="left")
        if len(set(flown)) == 1:
            found = failing.places(results, layout, planner)
            arena.heat(middle, found.fog, flown[0]).set_title(f"fog first touched ({len(found.fog)})", loc="left")
            arena.heat(right, found.ended, flown[0]).set_title(f"never arrived: ends ({len(found.ended)})", loc="left")
        else:  # a place in the arena says nothing where every run has a world of its own
            things = failing.with_nearest(results, layout, planner)
            panels.nearest(middle, things).set_title("never arrived: nearest thing", loc="left")
            steps = failing.step_errors(results, layout, planner)
            panels.step_errors(right, steps).set_title("errors outside fog", loc="left")
    entries: dict[str, Artist] = {}
    for ax in rows[:, :2].ravel():
        entries |= {name: handle for handle, name in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4, frameon=False)
    return figure
