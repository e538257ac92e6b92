"""Figures as notebooks and scripts find them: in pyplot's list of open figures; settings of Matplotlib, unchanged."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
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
