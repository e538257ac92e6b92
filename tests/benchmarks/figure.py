"""The figure: how many times longer everybody else takes, and how training grows."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from measure import Result

from affmap.report.drawing.files import WIDTH, style

HEADING: Any = {"fontsize": 7.5, "fontweight": "bold"}
SLOWER, FASTER = "#0072B2", "#E69F00"  # Okabe and Ito


def write(results: Sequence[Result], growth: pd.DataFrame | None, folder: Path) -> None:
    """Draw, and save as PNG to look at and as PDF to print."""
    with style():
        figure = draw(results, growth)
        figure.savefig(folder / "bench.png", dpi=200, metadata={"Software": None})
        figure.savefig(folder / "bench.pdf", metadata={"CreationDate": None})


def draw(results: Sequence[Result], growth: pd.DataFrame | None) -> Figure:
    """All ratios, and below them the growth of training where it was measured.

    Args:
        results: the first of a work is what the others are compared with.
        growth: as `training.growth` returns.
    """
    bars = 0.8 + 0.17 * (len(results) + len({result.work for result in results}))
    heights = [bars] if growth is None else [bars, 2.3]
    figure = Figure(figsize=(WIDTH, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    ratios(parts[0].subplots(), results).set_title("A  Times relative to ours", loc="left")
    if growth is not None:
        members, sizes = parts[1].subplots(1, 2, sharey=True)
        plain = [r.seconds for r in results if r.work.startswith("training") and r.contender == "plain PyTorch"]
        grown(members, growth, "members", plain).set_xlabel("members in the stack (context size 8)")
        grown(sizes, growth, "context_size", plain).set_xlabel("context size (25 members)")
        members.set_ylabel("ms per model and update")
        members.set_title("B  Training, more members", loc="left")
        sizes.set_title("C  Training, larger codes", loc="left")
    return figure


def ratios(ax: Axes, results: Sequence[Result]) -> Axes:
    """A bar for each contender, from 1 to its ratio; a line from the smallest ratio of a round to the largest."""
    labels: list[tuple[float, str, str]] = []
    place = 0.0
    for work, rows in groupby(results, lambda result: result.work):
        first, *others = rows
        if not others:
            continue
        title = work.split(" (")[0]  # in brackets: what would be too long here
        labels.append((place, f"{title}: {first.contender} = 1", "bold"))
        for row in others:
            place += 1
            color = SLOWER if row.ratio >= 1 else FASTER
            ax.barh(place, row.ratio - 1, left=1, height=0.7, color=color)
            ax.plot([row.ratio_low, row.ratio_high], [place, place], color="black", lw=1)
            digits = 2 if row.ratio < 1 else 1 if row.ratio < 10 else 0
            ax.annotate(
                f"{row.ratio:.{digits}f}",
                (max(row.ratio_high, 1), place),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=7,
            )
            labels.append((place, row.contender, "normal"))
        place += 1.5
    return _name(ax, labels)


def _name(ax: Axes, labels: list[tuple[float, str, str]]) -> Axes:
    """Contenders on the axis, works as headings over their bars."""
    ax.set_xscale("log")
    ax.axvline(1, color="black", lw=0.8)
    ax.invert_yaxis()
    ax.set_yticks([y for y, _, weight in labels if weight == "normal"])
    ax.set_yticklabels([text for _, text, weight in labels if weight == "normal"])
    ax.tick_params(axis="y", length=0)
    for y, text, weight in labels:
        if weight == "bold":
            box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
            # From beside the labels on, of which there is none in this row.
            ax.text(-0.48, y, text, transform=ax.get_yaxis_transform(), va="center", bbox=box, **HEADING)
    low, high = ax.get_xlim()
    ax.set_xlim(low, high * 1.6)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda ratio, _: f"{ratio:g}"))
    ax.set_xlabel("time relative to the first contender (above 1: slower)\nblack: lowest and highest of all rounds")
    return ax


def grown(ax: Axes, growth: pd.DataFrame, varied: str, plain: Sequence[float]) -> Axes:
    """Time of a model and update against what was varied, beside plain PyTorch's (s) at context size 8."""
    rows = growth[growth["varied"] == varied].sort_values(varied)
    ax.plot(np.arange(len(rows)), rows["milliseconds"], color=SLOWER, marker="o", ms=4, lw=1.4)
    for seconds in plain:
        ax.axhline(1000 * seconds, color="0.4", ls="--", lw=1)
        ax.annotate(
            "plain PyTorch, context size 8",
            (1, 1000 * seconds),
            (0, 2),
            xycoords=ax.get_yaxis_transform(),
            textcoords="offset points",
            ha="right",
            fontsize=7,
        )
    ax.set(yscale="log", xticks=np.arange(len(rows)), xticklabels=rows[varied])
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda milliseconds, _: f"{milliseconds:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.margins(y=0.15)
    return ax
