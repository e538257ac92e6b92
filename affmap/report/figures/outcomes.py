"""Outcomes of runs: arrivals, contact, and the distance if success is measured otherwise."""

import textwrap
from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure

from affmap.report.drawing import numbers
from affmap.report.drawing.colors import Groups, make_groups, name_of
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results.metrics import METRICS, extra_metrics
from affmap.results.setting import LAYOUT, PLANNER, ReportSettings
from affmap.results.tables import Results

FEW = 12
"""Boxes with names that a panel of a third of a page has room for."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def draw(results: Results, settings: ReportSettings) -> Drawn:
    """Draw and caption the figure, which the paper does not have."""
    groups = make_groups(results, settings)
    more = _metrics(settings)
    if _is_wide(results, groups):
        return Drawn(_rows(results, groups, more), _caption(results, settings))
    figure = new_figure(2.6 * -(-(2 + len(more)) // 3))
    share, touching, *others = figure.subplots(-(-(2 + len(more)) // 3), min(3, 2 + len(more)), squeeze=False).ravel()
    numbers.titled(numbers.bars(share, results.runs, "reached", groups, intervals=True), "A  Arrivals")
    numbers.titled(numbers.boxes(touching, results.runs, "steps_touching", groups), "B  Contact")
    for letter, ax, metric in zip(LETTERS[2:], others, more, strict=False):
        numbers.titled(numbers.boxes(ax, results.runs, metric, groups), numbers.panel_title(letter, metric))
    for ax in others[len(more) :]:
        ax.set_axis_off()
    fit = numbers.turn_names if more else numbers.shrink_names  # in panels of a third of a page, or of half a page
    for ax in (share, touching, *others[: len(more)]):
        fit(ax, groups.x_names.values())
        ax.set_ylabel(textwrap.fill(ax.get_ylabel(), 30))
    panels = {"reached": share, "steps_touching": touching, **dict(zip(more, others, strict=False))}
    numbers.baseline_lines(figure, panels, results.baseline_runs, groups)
    return Drawn(figure, _caption(results, settings))


def _is_wide(results: Results, groups: Groups) -> bool:
    """Whether each panel needs the width of the page: for many boxes with names, and layouts by colour."""
    return bool(groups.x_names) and groups.column == LAYOUT.column and len(groups.names) * len(groups.x_names) > FEW


def _rows(results: Results, groups: Groups, more: Sequence[str]) -> Figure:
    """Panels below each other; agents without a learned model stand beside the others, as lines would hide boxes."""
    others = results.baseline_runs
    agents = dict.fromkeys(others[PLANNER.column])
    runs = pd.concat([results.runs, others.assign(**{groups.x.column: others[PLANNER.column]})], ignore_index=True)
    groups = groups._replace(x_names={**groups.x_names, **{agent: str(agent) for agent in agents}})
    metrics = ["reached", "steps_touching", *more]
    figure = new_figure(1.9 * len(metrics))
    panels = figure.subplots(len(metrics), 1, squeeze=False)[:, 0]
    for letter, ax, metric in zip(LETTERS, panels, metrics, strict=False):
        if metric == "reached":
            numbers.titled(numbers.bars(ax, runs, metric, groups, intervals=True), f"{letter}  Arrivals")
        else:
            name = f"{letter}  Contact" if metric == "steps_touching" else numbers.panel_title(letter, metric)
            numbers.titled(numbers.boxes(ax, runs, metric, groups), name)
        ax.set_ylabel(textwrap.fill(ax.get_ylabel(), 22))
        if ax is not panels[-1]:
            ax.set_xlabel("")
        if agents:
            ax.axvline(len(groups.x_names) - len(agents) - 0.5, color="0.6", lw=0.8)
    return figure


def _metrics(settings: ReportSettings) -> list[str]:
    """Further metrics beside arrivals and contact.

    The distance if success is measured otherwise, and all metrics that reports show in addition.
    """
    return [*(["mean_distance"] if settings.outcome != "mean_distance" else []), *extra_metrics()]


def _caption(results: Results, settings: ReportSettings) -> str:
    groups = make_groups(results, settings)
    shares = results.runs.groupby([groups.column, results.x.column], sort=False)["reached"].mean()
    parts = []
    for value, name in groups.names.items():
        values = shares[value]
        first, last = values.index[0], values.index[-1]
        ends = [f"{values[value]:.0%} of the runs at {name_of(results.x, value, settings)}" for value in (first, last)]
        parts.append(f"{name} {' and '.join(dict.fromkeys(ends))}")
    letters = zip(LETTERS[2:], _metrics(settings), strict=False)
    more = "".join(f" ({letter}) {METRICS[metric].label.capitalize()}." for letter, metric in letters)
    beside = " Right: agents without a learned model." if _is_wide(results, groups) and results.baselines else ""
    return (
        "(A) Share of runs that reached the goal, regardless of contact, with 95 % intervals over members: "
        f"{'; '.join(parts)}. (B) Number of steps per run in contact with an obstacle or a border.{more}{beside} The "
        "paper does not report these results."
    )
