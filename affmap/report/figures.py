"""The figures of a report: those of numbers, and the files of all; PNG to look at, PDF to print, SVG for the page.

The same results give the same bytes.
"""

import textwrap
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import ConstrainedLayoutEngine

from affmap.report import arena, contrasts, panels, pictures, trials
from affmap.report import failures as failing
from affmap.report.groups import make_groups, readable
from affmap.report.pictures import new_figure
from affmap.report.settings import ReportSettings
from affmap.report.tables import Results

DPI = 200
"""Of the PNG files."""

STYLE: Any = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 7.5,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "path",  # a reader's browser may lack the font, and labels would not fit
    "svg.hashsalt": "affmap",  # identifiers are random without it
}

MAX_SVG = 1_500_000
"""Bytes; a figure that would be larger as SVG has none, and the page shows its PNG: thousands of marks load slowly."""

SPACING = "lookup.spacing"
"""The key of compared look-ups, whose context codes have errors."""


def draw_all(results: Results, settings: ReportSettings, folder: Path, notice: str | None) -> list[str]:
    """Draw every figure the results allow, save each as PNG, PDF and SVG in `folder`, and return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    with mpl.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw(results, settings)
            if figure is not None:
                _save(figure, folder / name, notice)
                _save_svg(figure, folder / f"{name}.svg")
                names.append(name)
    return names


def draw_differences(table: pd.DataFrame, runs: pd.DataFrame, key: str, path: Path, notice: str | None) -> None:
    """Draw and save what `comparison.compare` has found.

    Args:
        table: what it returned.
        runs: the runs that it compared.
        key: what was compared.
        path: of the files, without their ending.
        notice: what must stand on the figure, or None.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lookups = key == SPACING
    values = list(dict.fromkeys([*table["a"], *table["b"]]))
    names = [value.replace("_", " ") if isinstance(value, str) else f"{value:g}" for value in values]
    if lookups:
        names = ["exact" if value == 0 else name for value, name in zip(values, names, strict=True)]
    metrics = list(table["metric"].unique())
    count = len(metrics) + lookups
    rows = -(-count // 4)
    with mpl.rc_context(STYLE):
        figure = new_figure(0.3 + rows * (1.75 + 0.05 * max(map(len, names))))
        axes = figure.subplots(rows, -(-count // rows), squeeze=False).ravel()
        for ax in axes[count:]:
            ax.set_axis_off()
        for ax, metric in zip(axes[lookups:], metrics, strict=False):
            contrasts.differences(ax, table[table["metric"] == metric], values)
        if lookups:
            contrasts.code_errors(axes[0], runs, values)
        for ax in axes[:count]:
            contrasts.value_axis(ax, names, "map spacing (u)" if lookups else key)
        handles, settings = axes[count - 1].get_legend_handles_labels()
        if len(settings) > 1:
            figure.legend(handles, settings, loc="outside lower center", ncols=5, frameon=False)
        _save(figure, path, notice)


def draw_search(
    table: pd.DataFrame, objective: str, used: int | None, log_keys: Collection[str], path: Path, notice: str | None
) -> None:
    """Draw and save the trials of a search: in their order, and by each of the values that were searched.

    Args:
        table: the trials, as `searches.read` gives them.
        objective: the metric that the search was for.
        used: the trial of the values in use, or None.
        log_keys: keys with a logarithmic axis.
        path: of the files, without their ending.
        notice: what must stand on the figure, or None.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    keys = list(table.columns[4:])
    columns = min(3, 1 + len(keys))
    rows = -(-(1 + len(keys)) // columns)
    with mpl.rc_context(STYLE):
        figure = new_figure(0.4 + 2.0 * rows)
        axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        trials.history(axes[0], table, objective, used)
        for ax, key in zip(axes[1:], keys, strict=False):
            trials.by_value(ax, table, objective, used, key, key in log_keys)
        for ax in axes[1 + len(keys) :]:
            ax.remove()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
        _save(figure, path, notice)


def _save(figure: Figure, path: Path, notice: str | None) -> None:
    if notice:
        lines = textwrap.wrap(notice, round(11 * figure.get_figwidth()))
        height = figure.get_figheight() + 0.16 * len(lines)
        figure.set_figheight(height)
        engine = figure.get_layout_engine()
        assert isinstance(engine, ConstrainedLayoutEngine)
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - 0.16 * len(lines) / height))  # subfigures make no room for a title
        top = 1.0 - 0.04 / height
        style: dict[str, Any] = {
            "color": "red",
            "fontsize": 8,
            "fontweight": "bold",
            "parse_math": False,
        }  # a dollar is a dollar
        figure.text(0.5, top, "\n".join(lines), ha="center", va="top", **style)
    figure.savefig(path.with_name(f"{path.name}.png"), dpi=DPI, metadata={"Software": None})
    figure.set_layout_engine("none")  # as it was laid out for the first file, once
    figure.savefig(path.with_name(f"{path.name}.pdf"), metadata={"CreationDate": None})


def _save_svg(figure: Figure, path: Path) -> None:
    """Save a figure as it was laid out for the other files, unless it is larger than `MAX_SVG`."""
    figure.savefig(path, metadata={"Date": None, "Creator": None})
    if path.stat().st_size > MAX_SVG:
        path.unlink()


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


FIGURES: dict[str, Callable[[Results, ReportSettings], Figure | None]] = {
    "results": main_results,
    "trajectories": pictures.trajectories,
    "maps": pictures.affordance_maps,
    "growth": pictures.growth,
    "world": pictures.worlds,
    "exploration": pictures.exploration,
    "outcomes": outcomes,
    "failures": failures,
}
"""Name of the files -> what draws them."""
