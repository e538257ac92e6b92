"""Figures of numbers: the main results, outcomes, and failures."""

from collections.abc import Mapping

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D

from affmap.report.drawing import arena
from affmap.report.drawing import numbers as panels
from affmap.report.drawing.colors import Groups, make_groups, name_of, readable, x_names_of
from affmap.report.figures import pictures
from affmap.report.figures.files import new_figure
from affmap.results import failures as failing
from affmap.results.examples import MAX_ROWS
from affmap.results.files import EVERYWHERE, KINDS
from affmap.results.metrics import extra_metrics
from affmap.results.setting import LAYOUT, PLANNER, ReportSettings
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
                f"{letter}  Map: {readable(part.world.name, settings)}, C = {part.setting.context_size}", loc="left"
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
    _baselines(figure, {"prediction_error": error, settings.outcome: outcome}, results, groups)
    return figure


def _baselines(figure: Figure, panels_of: Mapping[str, Axes], results: Results, groups: Groups) -> None:
    """Draw lines of agents without a learned model into panels, metric -> panel, and a legend below the figure."""
    entries: dict[str, Artist] = {}
    for metric, ax in panels_of.items():
        for handle in panels.baselines(ax, results.baseline_runs, metric, groups):
            entries.setdefault(str(handle.get_label()), handle)
    if entries:
        heading = Line2D([], [], ls="", label="agents without a learned model:")
        handles = [heading, *entries.values()]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


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
    """Learning curves, side by side where models were trained for each layout, or value that colours tell apart."""
    paper = settings.axes.get("validation_nll")
    column = results.color.column if results.color.column in results.trainings else LAYOUT.column
    factor = results.training_factor
    names = x_names_of(results, settings) if factor == results.x and isinstance(results.x_values[0], str) else {}
    alone = column == results.color.column and results.validation[factor.column].nunique() == 1
    if column == factor.column or (alone and results.color != LAYOUT):  # a panel for each curve would say no more
        groups, factor = make_groups(results, settings), results.color if alone else factor
        colors = {value: groups.palette[name] for value, name in groups.names.items()} if alone else None
        ax = panels.learning_curves(
            figure.add_subplot(cell), results.validation, paper, factor, groups.names if alone else names, colors
        )
        ax.set_title(f"A  Loss by {factor.label}", loc="left")
        return
    trained = set(results.validation[column])
    known = [*results.layouts, *results.color_values]
    values = list(dict.fromkeys(value for value in known if value in trained))
    columns = min(3, len(values))
    grid = cell.subgridspec(-(-len(values) // columns), columns).subplots(sharey=True, squeeze=False)
    for ax, value in zip(grid.ravel(), values, strict=False):
        of_value = results.validation[results.validation[column] == value]
        panels.learning_curves(ax, of_value, paper, factor, names)
        ax.label_outer()
        if ax not in grid[0]:
            ax.set_ylabel("")
        if value != values[-1]:
            ax.get_legend().remove()
        if len(values) > 1:
            name = (
                readable(str(value), settings) if column == LAYOUT.column else name_of(results.color, value, settings)
            )
            ax.text(0.98, 0.98, name, ha="right", va="top", transform=ax.transAxes)
    for ax in grid.ravel()[len(values) :]:
        ax.set_axis_off()
    grid[0, 0].set_title(f"A  Loss by {factor.label}", loc="left")


def outcomes(results: Results, settings: ReportSettings) -> Figure:
    """Arrivals and contact, and the distance where success is measured otherwise; the paper does not show them."""
    groups = make_groups(results, settings)
    more = shown_outcomes(settings)
    figure = new_figure(2.6 * -(-(2 + len(more)) // 3))
    share, touching, *others = figure.subplots(-(-(2 + len(more)) // 3), min(3, 2 + len(more)), squeeze=False).ravel()
    panels.bars(share, results.runs, "reached", groups, intervals=True).set_title("A", loc="left")
    panels.boxes(touching, results.runs, "steps_touching", groups).set_title("B", loc="left")
    for letter, ax, metric in zip("CDEFGHIJKLMNOPQRSTUVWXYZ", others, more, strict=False):
        panels.boxes(ax, results.runs, metric, groups).set_title(letter, loc="left")
    for ax in others[len(more) :]:
        ax.set_axis_off()
    shown = {"reached": share, "steps_touching": touching, **dict(zip(more, others, strict=False))}
    _baselines(figure, shown, results, groups)
    return figure


def shown_outcomes(settings: ReportSettings) -> list[str]:
    """The metrics of the figure of outcomes beside arrivals and contact.

    The distance where success is measured otherwise, and those that reports show in addition.
    """
    return [*(["mean_distance"] if settings.outcome != "mean_distance" else []), *extra_metrics()]


def steps(results: Results, settings: ReportSettings) -> Figure:
    """Validation losses by kind of step: at the end of training, and what each kind adds to the mean over epochs."""
    table = results.steps[results.steps["world"] == EVERYWHERE]
    factor = results.training_factor
    first = table[table[LAYOUT.column] == table[LAYOUT.column].iloc[-1]]  # of the layout that an experiment is about
    last = first[first["epoch"] == first["epoch"].max()]
    kinds = [kind for kind in KINDS if kind in set(last["kind"])]
    values = list(dict.fromkeys(last[factor.column]))
    grown = list(dict.fromkeys([values[0], values[len(values) // 2], values[-1]]))
    several = first["epoch"].nunique() > 1
    figure = new_figure(2.3 * (1 + several))
    grid = figure.add_gridspec(1 + several, 1)
    top = grid[0].subgridspec(1, len(kinds)).subplots(squeeze=False)[0]
    for ax, kind in zip(top, kinds, strict=True):
        panels.step_losses(ax, last, kind, factor).set_title(kind, loc="left")
    top[0].set_ylabel("loss of a step (nats)")
    figure.legend(*top[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    if several:
        bottom = grid[1].subgridspec(1, len(grown)).subplots(squeeze=False)[0]
        for ax, value in zip(bottom, grown, strict=True):
            panels.contributions(ax, first[first[factor.column] == value], kinds)
            ax.set_title(factor.format(value), loc="left")
        bottom[0].set_ylabel("part of the mean loss (nats)")
        bottom[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, handlelength=0.9)
    return figure


def failures(results: Results, settings: ReportSettings) -> Figure | None:
    """Why runs fail, and where: a row of panels for each planner or layout."""
    if not failing.are_of_interest(results):
        return None
    runs = failing.with_reasons(results)
    groups = make_groups(results, settings)
    num_rows = min(MAX_ROWS, len(groups.names))
    fog = any(failing.has_fog(results, setting) for setting in results.settings)
    figure = new_figure(0.5 + 1.9 * num_rows)
    rows = figure.subplots(num_rows, 3 + fog, squeeze=False, width_ratios=(1.0, 1.15, 1.15, *[1.0] * fog))
    for (bars, middle, right, *rest), (value, name) in zip(rows, groups.names.items(), strict=False):
        panels.reasons(bars, runs[runs[groups.column] == value], results.x)
        same = {PLANNER.key: results.planners[0], LAYOUT.key: results.layouts[0], results.color.key: value}
        row = results.where({key: each for key, each in same.items() if key != results.x.key})
        row = sorted(row, key=lambda setting: results.x_values.index(setting.values[results.x.key]))
        flown = results.worlds(row[0])
        bars.set_title(f"{name}: failed runs" if len(groups.names) > 1 else "Failed runs", loc="left")
        if len(set(flown)) == 1:
            found = failing.places(results, row)
            arena.heat(middle, found.fog, flown[0]).set_title(f"fog first entered ({len(found.fog)})", loc="left")
            arena.heat(right, found.ended, flown[0]).set_title(f"never arrived: ends ({len(found.ended)})", loc="left")
        else:  # a place in the arena says nothing where every run has a world of its own
            things = failing.with_nearest(results, row)
            panels.nearest(middle, things, results.x).set_title("never arrived: nearest", loc="left")
            steps = failing.step_errors(results, row)
            panels.step_errors(right, steps, results.x).set_title("errors outside fog", loc="left")
        for ax in rest:
            panels.fog_distances(ax, failing.end_distances(results, row), results.x_values, results.x)
            ax.set_title("distance to fog", loc="left")
    entries: dict[str, Artist] = {}
    for ax in rows[:, :2].ravel():
        entries |= {name: handle for handle, name in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4, frameon=False)
    return figure
