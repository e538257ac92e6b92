"""Figures as files: PNG to look at, PDF to print, SVG for the page; the same figure gives the same bytes."""

import textwrap
from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter, ScalarFormatter

from affmap.store.files import named_errors

WIDTH = 7.0
"""Inches: the text width of the report's page, so that nothing is scaled and fonts keep their size."""

DPI = 200
"""Resolution of the PNG files."""

STYLE: Any = {
    "font.sans-serif": ["DejaVu Sans"],  # comes with Matplotlib; a machine's other fonts would lend missing glyphs
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
"""Largest SVG in bytes; the page shows the PNG of larger figures, because thousands of marks load slowly."""


class Drawn(NamedTuple):
    """A figure with its caption."""

    figure: Figure
    caption: str


def style() -> AbstractContextManager[None]:
    """Return a context of Matplotlib's own defaults with `STYLE`, whatever a `matplotlibrc` or a notebook has set."""
    return matplotlib.style.context(["default", STYLE])


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure; sizes in inches."""
    return Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.07, h_pad=0.06))


def save(figure: Figure, path: Path, notice: str | None) -> None:
    """Save a figure as PNG and PDF, below a notice if there is one; `path` has no ending."""
    if notice:
        lines = textwrap.wrap(notice, round(11 * figure.get_figwidth()))
        height = figure.get_figheight() + 0.16 * len(lines)
        figure.set_figheight(height)
        engine = figure.get_layout_engine()
        assert isinstance(engine, ConstrainedLayoutEngine)
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - 0.16 * len(lines) / height))  # subfigures make no room for a title
        top = 1.0 - 0.04 / height
        look: dict[str, Any] = {"color": "red", "fontsize": 8, "fontweight": "bold"}
        figure.text(0.5, top, "\n".join(lines), ha="center", va="top", **look)
    _take_text_as_it_is(figure)
    _lay_out(figure)
    _save(figure, path.with_name(f"{path.name}.png"), dpi=DPI, metadata={"Software": None})
    _save(figure, path.with_name(f"{path.name}.pdf"), metadata={"CreationDate": None})


def _take_text_as_it_is(figure: Figure) -> None:
    """Let dollars be dollars in all texts, but for powers along logarithmic axes, which Matplotlib itself writes."""
    axes = [axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    powers = {
        label
        for axis in axes
        if isinstance(axis.get_major_formatter(), LogFormatter)
        for label in axis.get_ticklabels(which="both")
    }
    for text in figure.findobj(Text):
        text.set_parse_math(text in powers)


def _lay_out(figure: Figure) -> None:
    """Place everything once, for all files, on a grid much finer than a pixel.

    The solver (kiwisolver) adds its terms in the order of their addresses in memory. So its last digits differ from
    process to process, and with them identifiers in an SVG and pixels at the edge between two.
    """
    resolution = figure.dpi
    figure.set_dpi(DPI)  # texts are measured in pixels
    figure.draw_without_rendering()
    if crowded := [ax for ax in figure.axes if _has_overlap(ax)]:
        for ax in crowded:
            ax.tick_params(axis="x", rotation=90)
        figure.draw_without_rendering()
    figure.set_dpi(resolution)
    if engine := figure.get_layout_engine():
        for legend in figure.legends:  # their margin is within the layout, below a notice, but they are not
            legend.set_bbox_to_anchor(engine.get().get("rect"), figure.transFigure)
    figure.set_layout_engine("none")
    for part in figure.subfigs:
        part.bbox_relative.set_points(part.bbox_relative.get_points().round(9))
    for ax in figure.axes:
        ax.set_position(np.round(ax.get_position(original=True).bounds, 9).tolist())


def _has_overlap(ax: Axes) -> bool:
    """Whether level names on the x axis lie over each other where they were drawn."""
    if isinstance(ax.xaxis.get_major_formatter(), ScalarFormatter | LogFormatter):
        return False  # numbers, whose ticks Matplotlib chooses
    labels = [label for label in ax.get_xticklabels() if label.get_visible() and label.get_text()]
    boxes = [label.get_window_extent() for label in labels if label.get_rotation() == 0]
    return any(one.overlaps(other) for one, other in pairwise(boxes))


def save_svg(figure: Figure, path: Path) -> None:
    """Save a figure as it was laid out for the other files, unless it is larger than `MAX_SVG`."""
    _save(figure, path, metadata={"Date": None, "Creator": None})
    if path.stat().st_size > MAX_SVG:
        path.unlink()


def _save(figure: Figure, path: Path, **options: Any) -> None:
    with named_errors(path):
        figure.savefig(path, **options)
