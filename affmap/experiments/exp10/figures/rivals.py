"""Mean distance of the agent and of its rivals in each layout, with paired differences from the agent."""

from typing import NamedTuple

from matplotlib.axes import Axes

from affmap.experiments.exp10.pairs import AGENT, paired, scores
from affmap.report.drawing.files import Drawn, new_figure
from affmap.results import statistics
from affmap.results.numbers import number
from affmap.results.setting import ReportSettings, reader_name
from affmap.results.tables import Results

METRIC, SHARE = "mean_distance", "reached"

COLUMNS = {"distance": 0.0, "difference": 0.24, "reached": 0.86}
"""Columns of a panel and their places, from 0 to 1."""

HEADS = {"distance": "distance", "difference": "minus agent", "reached": "arrived"}


class Row(NamedTuple):
    """The cells of a controller in a layout."""

    distance: str
    difference: str
    reached: str


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the table; None without runs of the agent and of others."""
    names = controllers(results)
    if AGENT not in names or len(names) < 2:
        return None
    layouts = results.layouts
    members = {name: max(len(scores(results, name, layout, METRIC)) for layout in layouts) for name in names}
    figure = new_figure(0.22 * len(names) + 0.7)
    panels = figure.subplots(1, len(layouts), squeeze=False, sharey=True)[0]
    for ax, layout in zip(panels, layouts, strict=True):
        _panel(ax, [row(results, name, layout) for name in names])
        ax.set_title(reader_name(layout, settings.names), loc="left", fontsize=8)
    labels = [f"{reader_name(name, settings.names)} ({members[name]})" for name in names]
    panels[0].set_yticks(range(len(names)), labels, fontsize=7)
    return Drawn(
        figure,
        "Mean distance to the goal (u, mean over members), its difference from that of the agent, paired by member, "
        "with 95 % interval, and the share of runs that reached the goal. Left: number of members; differences are of "
        "those that both have.",
    )


def controllers(results: Results) -> list[str]:
    """Names of all that flew, the agent first, then its rivals in the order of the experiment, then the others."""
    rivals = [setting.planner for setting in results.settings]
    baselines = [setting.planner for setting in results.baselines]
    names = dict.fromkeys([*rivals, *baselines])
    return sorted(names, key=lambda name: name != AGENT)


def row(results: Results, name: str, layout: str) -> Row:
    """The cells of a controller in a layout; dashes where it did not fly."""
    own, there = (scores(results, name, layout, metric) for metric in (METRIC, SHARE))
    if own.empty:
        return Row("–", "–", "–")
    difference = "" if name == AGENT else "–"
    pair = paired(results, name, AGENT, layout, METRIC)
    if name != AGENT and len(pair.first) >= statistics.MIN_MEMBERS:
        change = pair.first - pair.second
        ends = ", ".join(number(end, sign=True) for end in statistics.interval(change))
        difference = f"{number(change.mean(), sign=True)} [{ends}]"
    return Row(number(own.mean()), difference, f"{there.mean():.0%}")


def _panel(ax: Axes, rows: list[Row]) -> None:
    for place, cells in enumerate(rows):
        if place % 2:
            ax.axhspan(place - 0.5, place + 0.5, color="0.95", lw=0)
        for column, x in COLUMNS.items():
            ax.text(x, place, getattr(cells, column), va="center", fontsize=6.5)
    for column, x in COLUMNS.items():
        ax.text(x, -0.85, HEADS[column], va="center", fontsize=6.5, color="0.35")
    ax.set(xlim=(-0.03, 1.05), ylim=(len(rows) - 0.5, -1.3), xticks=[])
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
