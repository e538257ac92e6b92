"""Pictures of agents that learn online, and of curves with outliers."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from affmap.report.drawing.files import new_figure, save
from affmap.report.drawing.losses import learning_curves
from affmap.report.drawing.numbers import shrink_names
from affmap.report.figures.learning import _visits
from affmap.results.files import Experience
from affmap.results.setting import LEARNING


def test_places_are_those_of_the_first_agent_in_the_first_layout() -> None:
    """By hand: rounds 0 and 2 of three are in the first of two layouts."""
    counts = np.zeros((2, 3, 1, 2), int)
    counts[0, :, 0] = [[1, 0], [9, 9], [2, 3]]
    counts[1] = 7
    nothing = np.zeros((2, 3))
    visits = _visits(Experience(counts, np.ones((2, 1, 2), bool), nothing, nothing, np.arange(2)))
    assert visits[:, 0].tolist() == [[1, 0], [1, 0], [3, 3]]


def losses(worst: float) -> pd.DataFrame:
    rows = [
        {LEARNING.column: kind, "member": member, "epoch": epoch, "validation_nll": -epoch + 0.1 * member}
        for kind in ("random", "disagreement")
        for member in range(4)
        for epoch in range(1, 6)
    ]
    table = pd.DataFrame(rows)
    table.loc[3, "validation_nll"] = worst
    return table


def test_a_single_outlier_does_not_flatten_the_curves() -> None:
    """Curves from -5 to -1; without an outlier the axis is Matplotlib's own."""
    ax = Figure().subplots()
    low, high = learning_curves(ax, losses(60.0), factor=LEARNING).get_ylim()
    curves = np.concatenate([line.get_ydata() for line in ax.get_lines()])
    assert high - low <= 2 * (curves.max() - curves.min()) and low <= curves.min() and high >= curves.max()
    low, high = learning_curves(Figure().subplots(), losses(-4.0), factor=LEARNING).get_ylim()
    assert -6 < low < -5 and -1 < high < 0


def test_long_names_are_written_smaller() -> None:
    """Sizes of the labels."""
    sizes = []
    for names in (["offline", "random"], ["offline", "random", "deviation", "disagreement", "information"]):
        ax = Figure().subplots()
        ax.set_xticks(range(len(names)), names)
        shrink_names(ax, names)
        sizes.append(ax.get_xticklabels()[0].get_size())
    assert sizes[0] > sizes[1] == 6


def test_names_that_would_overlap_are_turned(tmp_path: Path) -> None:
    """The same three names in a panel of a fifth of the page, and in one of its whole width; and numbers."""
    figure = new_figure(2.0)
    panels = figure.add_gridspec(2, 5)
    narrow, numbers, wide = (figure.add_subplot(panels[cell]) for cell in ((0, 0), (0, 4), (1, slice(None))))
    for ax in (narrow, wide):
        ax.set_xticks(range(3), ["MLP", "GRU", "GateL0RD"])
    numbers.set_xlim(0, 1e-30)
    save(figure, tmp_path / "names", None)
    assert [ax.get_xticklabels()[0].get_rotation() for ax in (narrow, numbers, wide)] == [90, 0, 0]
