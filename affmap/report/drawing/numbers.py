"""Drawing functions for numbers of control: they take tables and Axes and return the Axes.

They know colours and labels, and neither files nor figures.
"""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from affmap.report.drawing.colors import NUMBERS, Groups
from affmap.results import statistics
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.scores import center
from affmap.results.setting import LAYOUT, PLANNER, Value

HUGE, FLAT, LINEAR = 300, 100, 20
"""Losses beyond the first value (nats) and boxes of errors beyond the second get an axis that is linear up to the third
and then logarithmic."""


DASHES = {"oracle": (5, 1.5), "straight": (1, 1), "random": (3, 1, 1, 1), "seen": (8, 1, 1, 1, 1, 1)}
"""Agent without a learned model (`conf/agent`) -> dashes of its line, the same everywhere; others' are solid."""


FAR = 0.15
"""Lines this far above a panel, as a share of its height, are not drawn."""


CHARACTERS = 22
"""Characters of a legend in an inch of a panel, before the layout widens it."""

SIGN, TITLE, GAP, TITLE_HEIGHT = 4, 1.17, 2, 0.2
"""Widths of the sign of an entry, of a character of a title, and of the gap between both, in characters of a legend;
height of a title, inches."""


Span = tuple[float, float] | None
"""Lowest and highest tick of the paper's axis, marked by dotted lines; or None."""


def boxes(ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups, paper: Span = None) -> Axes:
    """Draw box plots of a metric of control by context size or another factor, as in the paper.

    Boxes are quartiles, whiskers extend to the last point within 1.5 interquartile ranges, outliers are not drawn.
    The axis is logarithmic if errors reach far beyond the others. Values on the x axis without any number, such as
    policies, which predict nothing, have no place on it.

    Args:
        ax: where to draw.
        runs: one row per run.
        metric: a column of `runs`.
        groups: the groups shown by colour.
        paper: see `Span`.
    """
    if not np.isfinite(runs[metric].astype(float)).any():  # seaborn needs a number
        return unpredicted(ax, METRICS[metric].name)
    runs = runs[runs.groupby(groups.x.column)[metric].transform("count") > 0]
    mark(ax, paper)
    with warnings.catch_warnings():  # seaborn 0.13 hands matplotlib an argument that is going to be renamed
        warnings.filterwarnings("ignore", "vert: bool", DeprecationWarning)
        sns.boxplot(
            x=groups.x_of(runs),
            y=runs[metric],
            **_by_group(runs, groups),
            whis=1.5,
            showfliers=False,
            gap=0.1,
            linewidth=0.8,
            linecolor="black",
            medianprops={"linewidth": 1.6},
            ax=ax,
        )
    ax.set(xlabel=groups.x.label, ylabel=METRICS[metric].label)
    if runs[metric].min() >= 0:  # a length or a count: show its zero
        ax.set_ylim(bottom=0)
    elif ax.get_ylim()[1] > FLAT:  # large errors of one model: keep the others visible
        low = min([ax.dataLim.y0, *(paper or ())])
        ax.set_yscale("symlog", linthresh=LINEAR)
        ax.set_ylim(bottom=1.1 * low)
        ax.set_ylabel(f"{METRICS[metric].label[:-1]}, log beyond ±{LINEAR})")
    return legend_above(ax)


def bars(
    ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups, paper: Span = None, intervals: bool = False
) -> Axes:
    """Draw the mean over members of their shares of runs, as in the paper.

    Args:
        ax: where to draw.
        runs: one row per run.
        metric: a column of truth values of `runs`.
        groups: the groups shown by colour.
        paper: see `Span`.
        intervals: whether black lines are 95 % intervals (with enough members) instead of standard
            deviations over members, which end at 0 and 1, as shares do.
    """
    mark(ax, paper)
    keys = [*dict.fromkeys([groups.column, groups.x.column, "member"])]
    members = runs.astype({metric: float}).groupby(keys, sort=False)[metric].mean().reset_index()
    sns.barplot(
        x=groups.x_of(members),
        y=members[metric],
        **_by_group(members, groups),
        errorbar=_interval if intervals else _deviation,
        err_kws={"color": "black", "linewidth": 1.2},
        edgecolor="black",
        linewidth=0.8,
        gap=0.1,
        ax=ax,
    )
    ax.set(xlabel=groups.x.label, ylabel=METRICS[metric].label)
    drawn = [bar for bars in ax.containers if isinstance(bars, BarContainer) for bar in bars]
    mark_zeros(ax, [bar.get_center()[0] for bar in drawn if bar.get_height() == 0])
    ax.set_ylim(0.0, 1.05)
    ax.set_yticks(np.linspace(0, 1, 6))
    return legend_above(ax)


def baselines(ax: Axes, runs: pd.DataFrame, metric: str, groups: Groups) -> list[Artist]:
    """Draw lines for agents without a learned model at the median or mean of their runs, as the boxes or bars do.

    A line far above the others would squash these; its value is written at the top instead.

    Args:
        ax: a panel with boxes or bars of the same metric.
        runs: one row per run (`Results.baseline_runs`).
        metric: a column of `runs`.
        groups: the groups shown by colour; if these are layouts, lines have their colours, too.

    Returns:
        A labelled line for each agent, for a legend.
    """
    handles: dict[str, Artist] = {}
    by_layout = groups.column == LAYOUT.column
    layouts = list(runs[LAYOUT.column].unique())
    bottom, top = ax.get_ylim()
    height, lowest, highest = top - bottom, bottom, top
    beyond: dict[str, list[float]] = {}
    for (name, layout), of_agent in runs.groupby([PLANNER.column, LAYOUT.column], sort=False):
        agent = str(name)
        middle = center(of_agent[metric], metric)
        if np.isnan(middle):
            continue
        if middle > top + FAR * height:
            beyond.setdefault(agent, []).append(middle)
            continue
        color = groups.palette[groups.names[layout]] if by_layout and layout in groups.names else "0.25"
        shift = layouts.index(layout) / len(layouts) if by_layout else 0.0  # colours of lines at one height alternate
        ax.axhline(middle, color=color, lw=1.1, ls=_line_style(DASHES.get(agent, ()), shift), zorder=3)
        lowest = lowest if bottom == 0 else min(lowest, middle - 0.04 * height)
        highest = max(highest, middle + 0.04 * height)
        style = _line_style(DASHES.get(agent, ()))
        handles.setdefault(agent, Line2D([], [], color="0.25", lw=1.1, ls=style, label=agent))
    ax.set_ylim(lowest, highest)
    if beyond:
        words = ", ".join(f"{agent} {number(max(values), 1)}" for agent, values in beyond.items())
        look: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7, "transform": ax.transAxes}
        ax.text(0.98, 0.99, f"beyond this axis: {words}", bbox={"fc": "white", "ec": "none", "pad": 1.0}, **look)
    return list(handles.values())


def _line_style(dashes: Sequence[float], shift: float = 0.0) -> Any:
    """Line style that begins `shift` periods into its dashes; solid without dashes."""
    return (shift * sum(dashes), dashes) if dashes else "-"


def baseline_lines(figure: Figure, panels: Mapping[str, Axes], runs: pd.DataFrame, groups: Groups) -> None:
    """Draw lines of agents without a learned model into panels, metric -> panel, and a legend below the figure."""
    entries: dict[str, Artist] = {}
    for metric, ax in panels.items():
        for handle in baselines(ax, runs, metric, groups):
            entries.setdefault(str(handle.get_label()), handle)
    legend_below(figure, {"agents without a learned model:": list(entries.values())})


def legend_below(figure: Figure, lines: Mapping[str, Sequence[Artist]]) -> None:
    """Put a legend below a figure, a line for each heading with its entries; those without entries are left out."""
    lines = {heading: entries for heading, entries in lines.items() if entries}
    if not lines:
        return
    columns = 1 + max(map(len, lines.values()))
    cells = [[_words(heading), *entries] for heading, entries in lines.items()]
    cells = [[*line, *(_words("") for _ in range(columns - len(line)))] for line in cells]
    handles = [line[column] for column in range(columns) for line in cells]  # a legend is filled by columns
    look = {"frameon": False, "columnspacing": 1.0}
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **look)


def _words(words: str) -> Artist:
    """Entry of a legend without a sign."""
    return Line2D([], [], ls="", label=words)


def name_places(ax: Axes, values: Sequence[Value], names: Mapping[Value, str] = NUMBERS) -> None:
    """Name the places 0, 1, ... on the x axis, so that many names stay apart in a narrow panel.

    Args:
        ax: a panel.
        values: on its x axis, in their order.
        names: of the values, for readers; empty for numbers.
    """
    labels = [names.get(value, str(value)) for value in values]
    upright = len("".join(labels)) > LETTERS
    ax.set_xticks(range(len(values)), labels, fontsize=6 if len(values) > 5 else None, rotation=90 * upright)


LETTERS = 15
"""More than these on the x axis of a narrow panel would overlap, and are turned."""


def shrink_names(ax: Axes, names: Iterable[str]) -> None:
    """Write names on the x axis smaller that would overlap in a panel of half a page."""
    if len("".join(names)) > HALF_PAGE:
        ax.tick_params(axis="x", labelsize=6)


HALF_PAGE = 35
"""More letters than these would overlap there."""


def turn_names(ax: Axes, names: Iterable[str]) -> None:
    """Turn names on the x axis that would overlap in a panel of a third of a page."""
    if len("".join(names)) > LETTERS:
        ax.tick_params(axis="x", rotation=90)


def mark_zeros(ax: Axes, places: Iterable[float]) -> None:
    """Write 0 at the places of bars without height, which tells them from those that were not measured."""
    for place in places:
        ax.annotate("0", (place, 0.0), (0, 1.5), textcoords="offset points", ha="center", va="bottom", fontsize=6)


def unpredicted(ax: Axes, name: str) -> Axes:
    """Label a panel as empty because the agents predict nothing."""
    ax.set(xticks=[], yticks=[])
    return say(ax, f"no {name}:\nnothing was predicted")


def say(ax: Axes, words: str, x: float = 0.5) -> Axes:
    """Write words where a panel, or a part of it around `x` (a share of its width), has nothing to show."""
    ax.text(x, 0.5, words, ha="center", va="center", transform=ax.transAxes)
    return ax


def mark(ax: Axes, paper: Span) -> None:
    """Mark the ticks of the paper's axis by dotted lines."""
    for tick in paper or ():
        ax.axhline(tick, color="0.6", lw=0.8, ls=":", zorder=0)


def titled(ax: Axes, title: str) -> Axes:
    """Write a title at the left of a panel; a legend for which it leaves no room beside it goes above it."""
    ax.set_title(title, loc="left")
    return legend_above(ax) if ax.get_legend() else ax


def panel_title(letter: str, metric: str) -> str:
    """Title of a panel of a metric, whatever average of it is drawn."""
    return f"{letter}  {METRICS[metric].name.removeprefix('mean ').capitalize()}"


def legend_above(ax: Axes) -> Axes:
    """Put the legend above a panel, where no data can be: to the right of the title, or above it if it is too long."""
    names = ax.get_legend_handles_labels()[1]
    title, figure = ax.get_title("left"), ax.get_figure(root=True)
    assert figure is not None
    room = round(ax.bbox.width / figure.dpi * CHARACTERS)
    lengths = [len(name) + SIGN for name in names]
    place, columns = ax.transAxes, max(1, len(names))
    if sum(lengths) + (TITLE * len(title) + GAP if title else 0) > room:
        columns = max(1, min(columns, room // max(lengths, default=1)))
        place = place + ScaledTranslation(0.0, TITLE_HEIGHT * bool(title), figure.dpi_scale_trans)
    style = {"frameon": False, "borderaxespad": 0.1, "handlelength": 0.9, "handletextpad": 0.4, "columnspacing": 0.7}
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), bbox_transform=place, ncols=columns, **style)
    return ax


def _interval(shares: "pd.Series[float]") -> tuple[float, float]:
    return statistics.interval(shares) if len(shares) >= statistics.MIN_MEMBERS else (np.nan, np.nan)


def _deviation(shares: "pd.Series[float]") -> tuple[float, float]:
    low, high = np.clip([shares.mean() - shares.std(), shares.mean() + shares.std()], 0.0, 1.0)
    return float(low), float(high)


def _by_group(table: pd.DataFrame, groups: Groups) -> dict[str, Any]:
    """Seaborn's arguments for the groups of `table`, with their names for readers."""
    hue = groups.of(table)
    names = [name for name in groups.names.values() if name in set(hue)]
    return {"hue": hue, "hue_order": names, "palette": groups.palette, "saturation": 1.0}
