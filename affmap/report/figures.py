"""Whole figures out of panels, and their files: PNG to look at, PDF (vector) to print, the same bytes every time."""

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from affmap.report import claims, panels
from affmap.report.tables import Results, Trajectories

WIDTH = 7.0
"""Inches: the text width of the report's page, so that nothing is scaled and fonts keep their size."""

NUM_MEMBERS = 6
"""How many members' maps are shown side by side."""

STYLE: Any = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 7.5,
    "pdf.fonttype": 42,  # text stays text
}

EXAMPLE_RULE = (
    "the first member, of its runs the one whose mean distance to the goal, averaged over the context sizes shown, is "
    "the lower median, and the first step at which at most half of the initial distance is left (where that never "
    "happens: the step that comes closest)"
)
"""How Figure 5's runs and moments are chosen."""


class Example(NamedTuple):
    """The run of one setting that Figure 5 shows, chosen by `EXAMPLE_RULE`."""

    context_size: int
    member: int
    run: int
    problem: int
    """Its place among the B runs in `paths`."""
    step: int
    paths: Trajectories


def draw_all(results: Results, folder: Path, notice: str | None) -> dict[str, float]:
    """Draw every figure the results allow, save each as PNG and PDF, and return their names and widths in inches."""
    folder.mkdir(parents=True, exist_ok=True)
    widths = {}
    with mpl.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw(results)
            if figure is not None:
                _save(figure, folder / name, notice)
                widths[name] = float(figure.get_figwidth())
    return widths


def draw_lookups(table: pd.DataFrame, runs: pd.DataFrame, folder: Path, notice: str | None) -> None:
    """Draw and save what `comparison.compare` has found about look-ups, as `lookup_spacing.png` and `.pdf`.

    Args:
        table: what it returned.
        runs: the runs that it compared.
        folder: where the files go.
        notice: what must stand on the figure, or None.
    """
    folder.mkdir(parents=True, exist_ok=True)
    spacings = list(runs["lookup_spacing"].unique())
    with mpl.rc_context(STYLE):
        figure = _figure(2.3)
        metrics = list(table["metric"].unique())
        error, *axes = figure.subplots(1, 1 + len(metrics))
        panels.lookup_errors(error, runs, spacings)
        for ax, metric in zip(axes, metrics, strict=True):
            panels.lookup_differences(ax, table[table["metric"] == metric], spacings)
        _save(figure, folder / "lookup_spacing", notice)


def _save(figure: Figure, path: Path, notice: str | None) -> None:
    if notice:
        lines = textwrap.wrap(notice, round(11 * figure.get_figwidth()))
        figure.suptitle("\n".join(lines), color="red", fontsize=8, fontweight="bold")
    figure.savefig(path.with_name(f"{path.name}.png"), dpi=200, metadata={"Software": None})
    figure.savefig(path.with_name(f"{path.name}.pdf"), metadata={"CreationDate": None})


def figure4(results: Results) -> Figure:
    """The paper's Figure 4: learning curves, an affordance map, prediction error and mean distance."""
    figure = _figure(5.2)
    (loss, code), (error, distance) = figure.subplots(2, 2)
    panels.learning_curves(loss, results.validation, claims.PAPER_RANGES["validation_nll"]).set_title(
        "A  Loss by context size", loc="left"
    )
    code.set_title("B  Affordance map", loc="left")
    if results.maps:
        size = max(results.maps)
        panels.affordance_map(code, results.maps[size], 0, results.world)
        code.set_title(f"B  Affordance map (C = {size}, member {results.maps[size].member[0]})", loc="left")
    else:
        code.text(0.5, 0.5, "no context size above 0 was run", ha="center", va="center", transform=code.transAxes)
        code.set_axis_off()
    for ax, metric in ((error, "prediction_error"), (distance, "mean_distance")):
        panels.boxes(ax, results.runs, metric, claims.PAPER_RANGES[metric])
    error.set_title("C  Prediction error", loc="left")
    distance.set_title("D  Mean distance", loc="left")
    return figure


def figure5(results: Results) -> Figure | None:
    """The paper's Figure 5: one moment of a run, at the smallest and at the largest context size (EB)."""
    examples = choose_examples(results)
    if not examples:
        return None
    figure = _figure(3.0)
    axes = figure.subplots(1, len(examples), squeeze=False)[0]
    for ax, example in zip(axes, examples, strict=True):
        panels.trajectory(ax, example.paths, example.problem, example.step, results.world)
        ax.set_title(f"context size {example.context_size}, step {example.step}", loc="left")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def choose_examples(results: Results) -> list[Example]:
    """The runs of EB that Figure 5 shows, by `EXAMPLE_RULE`; none where EB was not run."""
    runs = results.runs[results.runs["planner"] == "cem"]
    sizes = sorted({int(runs["context_size"].min()), int(runs["context_size"].max())}) if len(runs) else []
    runs = runs[runs["context_size"].isin(sizes) & (runs["member"] == runs["member"].min())]
    distances = runs.groupby("run")["mean_distance"].mean().sort_values(kind="stable")
    examples = []
    for size in sizes:
        paths = results.trajectories(size, "cem")
        assert paths is not None  # the runs of this setting were read a moment ago
        member, run = int(runs["member"].iloc[0]), int(distances.index[(len(distances) - 1) // 2])
        index = int(np.flatnonzero((paths.member == member) & (paths.run == run))[0])
        examples.append(Example(size, member, run, index, _half_way(paths, index), paths))
    return examples


def _half_way(paths: Trajectories, index: int) -> int:
    """First step with at most half of the initial distance left; where there is none, the closest one."""
    steps = paths.planned_position.shape[1]
    distance = np.linalg.norm(paths.position[index, :steps] - paths.goal[index], axis=-1)  # [T]
    arrived = distance <= distance[0] / 2
    return int(arrived.argmax() if arrived.any() else distance.argmin())


def affordance_maps(results: Results) -> Figure | None:
    """Maps of several members at the largest context size, and of one member at every context size."""
    if not results.maps:
        return None
    size = max(results.maps)
    first = results.maps[size].member[0]
    members = [(f"member {m}", results.maps[size], i) for i, m in enumerate(results.maps[size].member[:NUM_MEMBERS])]
    sizes = [(f"C = {size}", arrays, 0) for size, arrays in results.maps.items()]
    groups = {f"Members at context size {size}": (members, 3), f"Member {first} at each context size": (sizes, 4)}
    rows = [-(-len(shown) // columns) for shown, columns in groups.values()]
    heights = [0.5 + 1.65 * rows[0], 0.75 + 1.25 * rows[1]]
    figure = _figure(sum(heights))
    parts = figure.subfigures(2, 1, height_ratios=heights, squeeze=False).ravel()
    for part, (title, (shown, columns)), num_rows in zip(parts, groups.items(), rows, strict=True):
        part.suptitle(title, x=0.01, ha="left", fontsize=9)
        grid = part.subplots(num_rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax, (name, arrays, index) in zip(grid.flat, shown, strict=False):
            panels.affordance_map(ax, arrays, index, results.world).set_title(name, loc="left")
            ax.label_outer()
        for ax in grid.ravel()[len(shown) :]:
            ax.set_axis_off()
    return figure


def world(results: Results) -> Figure:
    """The layout."""
    figure = _figure(2.6, width=4.0)
    panels.world_map(figure.subplots(), results.world)
    return figure


def exploration(results: Results) -> Figure:
    """Where the data set has been."""
    figure = _figure(2.6, width=4.6)
    ax = panels.visits(figure.subplots(), results.exploration, results.world)
    ax.set_title(f"coverage: {results.exploration.coverage:.1%} of the free cells", loc="left")
    return figure


def outcomes(results: Results) -> Figure:
    """Success and collisions, which the paper does not show for Experiment I."""
    figure = _figure(2.6)
    share, touching = figure.subplots(1, 2)
    panels.success_share(share, results.runs).set_title("A  Goal reached", loc="left")
    panels.boxes(touching, results.runs, "steps_touching").set_title("B  Contact", loc="left")
    return figure


def _figure(height: float, width: float = WIDTH) -> Figure:
    return Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.07, h_pad=0.06))


FIGURES: dict[str, Callable[[Results], Figure | None]] = {
    "figure4": figure4,
    "figure5": figure5,
    "maps": affordance_maps,
    "world": world,
    "exploration": exploration,
    "outcomes": outcomes,
}
