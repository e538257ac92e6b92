"""The paper's main figure: learning curves, an affordance map, prediction error and the outcome of control."""

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from affmap.report.drawing import arena, losses, numbers
from affmap.report.drawing.colors import make_groups, name_of, readable
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import Painted, map_size, maps_of_size, of_part, paint, several_worlds
from affmap.results import examples
from affmap.results.numbers import counted, listed, span
from affmap.results.setting import LAYOUT, PLANNERS, ReportSettings, short_name
from affmap.results.tables import Results

BOXES = (
    "Boxes: median and quartiles; whiskers extend to the last point within 1.5 interquartile ranges; outliers are not "
    "drawn."
)

MAX_MAPS = 6
"""Maps of one panel, in two rows from three on."""


MAX_VALUES = 16
"""Values on the x axis that a panel of half a page has room for."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if there are too many values on the x axis.

    If the report has maps of the same models in several worlds, maps of new worlds replace curves and map.
    """
    if len(results.x_values) > MAX_VALUES:
        return None
    figure = new_figure(5.2)
    grid = figure.add_gridspec(2, 2)
    worlds = several_worlds(results)[:2]
    if worlds:
        for cell, part, colors, letter in zip((0, 1), worlds, paint(worlds, 0), "AB", strict=True):
            ax = figure.add_subplot(grid[0, cell])
            arena.affordance_map(ax, colors, part.maps.x, part.maps.y, part.world.map)
            ax.set_title(
                f"{letter}  Map: {readable(part.world.name, settings)}, C = {part.setting.context_size}", loc="left"
            )
    else:
        _curves(figure, grid[0, 0], results, settings)
        _maps(figure, grid[0, 1], results, settings)
    groups = make_groups(results, settings)
    error, outcome = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    numbers.boxes(error, results.runs, "prediction_error", groups, settings.axes.get("prediction_error"))
    numbers.titled(error, numbers.panel_title("C", "prediction_error"))
    panel = numbers.boxes if settings.outcome == "mean_distance" else numbers.bars
    panel(outcome, results.runs, settings.outcome, groups, settings.axes.get(settings.outcome))
    numbers.titled(outcome, numbers.panel_title("D", settings.outcome))
    for ax in (error, outcome):
        numbers.shrink_names(ax, groups.x_names.values())
    both = {"prediction_error": error, settings.outcome: outcome}
    numbers.baseline_lines(figure, both, results.baseline_runs, groups)
    return Drawn(figure, _caption(results, settings, worlds))


def _maps(figure: Figure, cell: SubplotSpec, results: Results, settings: ReportSettings) -> None:
    """Draw a map of each training, side by side."""
    size = map_size(results)
    if size is None:
        ax = figure.add_subplot(cell)
        ax.set_title("B  Affordance map", loc="left")
        ax.text(0.5, 0.5, "no context size above 0 was run", ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    parts = _shown_maps(results, size)
    title = f"B  Affordance map{'s' if len(parts) > 1 else ''} (C = {size}, member {parts[0].maps.member[0]})"
    if len(parts) == 1:
        ax = figure.add_subplot(cell)
        arena.affordance_map(ax, paint(parts, 0)[0], parts[0].maps.x, parts[0].maps.y, parts[0].world.map)
        ax.set_title(title, loc="left")
        return
    names = [of_part(results, part, parts, settings).removeprefix(": ") for part in parts]
    columns = 2 if len(parts) <= 4 else 3
    panel = figure.add_subfigure(cell)
    panel.suptitle(title, x=0.02, ha="left", fontsize=mpl.rcParams["axes.titlesize"])
    grid = panel.subplots(-(-len(parts) // columns), columns, sharex=True, sharey=True, squeeze=False)
    for ax, part, name in zip(grid.flat, parts, names, strict=False):
        arena.affordance_map(ax, paint([part], 0)[0], part.maps.x, part.maps.y, part.world.map)
        ax.set_title(name, loc="left")
        if len(parts) > 2:  # the room of labels is better used by the maps; other figures have them
            ax.set(xlabel="", ylabel="", xticks=[], yticks=[])
    arena.label_outer(grid, len(parts))


def _shown_maps(results: Results, size: int) -> list[Painted]:
    """The maps of `_maps_of_panel` that have room: the first, such as the paper's, and the last ones."""
    return examples.first_and_last(_maps_of_panel(results, size), MAX_MAPS)


def _maps_of_panel(results: Results, size: int) -> list[Painted]:
    """Maps of a context size in the last layout, the one that an experiment is about: one of each training."""
    parts = maps_of_size(results, size)
    return [part for part in parts if part.setting.layout == parts[-1].setting.layout]


def _curves(figure: Figure, cell: SubplotSpec, results: Results, settings: ReportSettings) -> None:
    """Draw learning curves, side by side if models were trained for each layout or each value shown by colour."""
    paper = settings.axes.get("validation_nll")
    column = results.color.column if results.color.column in results.trainings else LAYOUT.column
    factor = results.training_factor
    names = make_groups(results, settings).x_names
    alone = column == results.color.column and results.validation[factor.column].nunique() == 1
    if column == factor.column or (alone and results.color != LAYOUT):  # one panel per curve would add nothing
        groups, factor = make_groups(results, settings), results.color if alone else factor
        colors = {value: groups.palette[name] for value, name in groups.names.items()} if alone else None
        ax = losses.learning_curves(
            figure.add_subplot(cell), results.validation, paper, factor, groups.names if alone else names, colors
        )
        numbers.titled(ax, f"A  Loss by {factor.label}")
        return
    trained = set(results.validation[column])
    known = [*results.layouts, *results.color_values]
    values = list(dict.fromkeys(value for value in known if value in trained))
    columns = min(3, len(values))
    grid = cell.subgridspec(-(-len(values) // columns), columns).subplots(sharey=True, squeeze=False)
    for ax, value in zip(grid.ravel(), values, strict=False):
        of_value = results.validation[results.validation[column] == value]
        losses.learning_curves(ax, of_value, paper, factor, names)
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
    numbers.titled(grid[0, 0], f"A  Loss by {factor.label}")


def _caption(results: Results, settings: ReportSettings, worlds: Sequence[Painted]) -> str:
    parts = []
    size = map_size(results)
    member = results.runs["member"].min()
    if worlds:
        names = listed([readable(part.world.name, settings) for part in worlds])
        parts.append(
            f"(A, B) Affordance maps of member {member} at C = {size} in the worlds {names}, in a common basis: "
            "equal colours mean equal codes. The models are the same in all worlds."
        )
    else:
        members = results.last_epoch["member"].nunique()
        parts.append(
            f"(A) Validation loss: mean and standard deviation (shade) over {counted(members, 'member')}; curves that "
            "leave the axis are labelled."
        )
        code = "(B) The largest context size is 0, so there is no map."
        if size:
            maps = _shown_maps(results, size)
            world = readable(maps[0].world.name, settings)
            every = len(_maps_of_panel(results, size))
            some = "Affordance maps" if every == len(maps) else f"{len(maps)} of {every} affordance maps"
            kind = "Affordance map" if len(maps) == 1 else f"{some}, of which colours are not comparable,"
            code = (
                f"(B) {kind} of member {member} at C = {size} in the world “{world}”: the context code at each "
                "position, three principal components as red, green and blue, circles outlined."
            )
        parts.append(code)
    parts.append(f"(C) Prediction error in control, {_per_box(results, settings)} runs a box. {BOXES}")
    if settings.outcome == "success":
        parts.append(
            "(D) Share of successful runs, which reach the goal and never enter fog: mean and standard deviation "
            "(black lines, which end at 0 and 1) over members."
        )
    else:
        parts.append("(D) Mean distance to the goal in control.")
    if results.baselines:
        seen = any(each.planner == "seen" for each in results.baselines)
        parts.append(
            "Dashed and dotted lines: agents without a learned model on the same runs; the oracle has true physics"
            + (", and “seen” is an oracle that knows no more of the world than views show." if seen else ".")
        )
    if len(results.planners) > 1:
        methods = [f"{short_name(kind)}: {PLANNERS[kind].method}" for kind in results.planners if kind in PLANNERS]
        parts.append(f"{', '.join(methods)}." if methods else "")
    if settings.axes:
        parts.append("Grey dotted lines: lowest and highest tick of the paper's axis, if in view.")
    return " ".join(filter(None, parts))


def _per_box(results: Results, settings: ReportSettings) -> str:
    return span(results.runs.groupby([results.x.column, make_groups(results, settings).column]).size())
