"""Figures as notebooks and scripts find them: in pyplot's list of open figures; settings of Matplotlib, unchanged."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
from handmade import ORIGINAL, make_runs
from matplotlib.figure import Figure

import affmap


@pytest.fixture(autouse=True)
def no_figures() -> None:
    plt.close("all")


def test_axes_that_are_given_are_drawn_on_and_returned() -> None:
    """Pyplot learns of no figure, and no setting is changed."""
    before, ax = dict(mpl.rcParams), Figure().subplots()
    assert affmap.plot.layout("original", ax=ax) is ax
    assert not plt.get_fignums() and dict(mpl.rcParams) == before


def test_without_axes_a_new_figure_is_made_which_pyplot_shows() -> None:
    """One a call, the one that `plt.show()` would show last; settings of the user's own stay, and do not matter."""
    with mpl.rc_context({"font.size": 30, "axes.spines.top": False, "figure.dpi": 37}):
        before = dict(mpl.rcParams)
        first, second = affmap.plot.layout("original"), affmap.plot.layout("fog")
        assert plt.get_fignums() == [1, 2] and plt.gca() is second and first.figure is not second.figure
        assert dict(mpl.rcParams) == before
        first.figure.draw_without_rendering()
        texts = [first.xaxis.label, *first.get_xticklabels()]
    assert {text.get_fontsize() for text in texts} == {8}
    plt.close("all")


@pytest.mark.parametrize("dpi", [72, 192])
def test_nothing_sticks_out_of_a_new_figure(dpi: int) -> None:
    """Legends beside arenas, which are to scale: labels and legends end within the figure."""
    runs = make_runs([ORIGINAL])
    drawn = [affmap.plot.layout("four_properties"), affmap.plot.trajectories(runs), affmap.plot.plan(runs)]
    for ax in drawn:
        figure = ax.get_figure()
        figure.set_dpi(dpi)
        figure.draw_without_rendering()
        box = ax.get_tightbbox()
        assert min(box.x0, box.y0) > 0 and box.x1 < figure.bbox.x1 and box.y1 < figure.bbox.y1
    plt.close("all")
