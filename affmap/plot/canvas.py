"""Axes to draw on: the caller's, or those of a new figure."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes

from affmap.report.drawing.files import STYLE, style

SIZE = (5.0, 3.0)
"""Width and height of a new figure, inches."""

LAYOUT: Final = "compressed"
"""Layout engine of a new figure; `constrained` may let the legend beside an arena stick out, which is to scale."""


@contextmanager
def canvas(ax: Axes | None) -> Iterator[Axes]:
    """Yield `ax` as it is; if there is none, the Axes of a new figure, for a block that draws in the reports' style."""
    if ax is not None:
        yield ax
        return
    import matplotlib.pyplot as plt  # chooses a backend

    with style():
        ax = plt.figure(figsize=SIZE, layout=LAYOUT).subplots()
        ax.tick_params(labelsize=STYLE["font.size"])  # ticks are made when the figure is shown, in the user's style
        yield ax


def legend_beside(ax: Axes, handles: Sequence[Artist]) -> None:
    """Put a legend to the right of the Axes, where no data can be; none without handles."""
    if handles:
        ax.legend(handles=list(handles), loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, numpoints=1)
