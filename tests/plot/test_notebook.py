"""Objects as notebooks show them: by IPython's own formatter, in a fresh process, and the pixels of their pictures."""

import base64
import re
import subprocess
import sys
from io import BytesIO

import numpy as np
import pytest
from handmade import ORIGINAL, PLANNER, SETTINGS, TWO, make_map, make_runs, make_stack
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from affmap.control.agent import Agent
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural
from affmap.model.lookup import ExactLookup


def parts(html: str | None) -> tuple[str, np.ndarray]:
    """Caption and pixels of the only picture."""
    assert html is not None
    ((caption, source),) = re.findall(r"<figcaption>(.+?)</figcaption>.+base64,(.+?)\"", html)
    return caption, imread(BytesIO(base64.b64decode(source)), format="png")


def make_agent(context_size: int) -> Agent:
    stack = make_stack(context_size)
    return Agent(stack, ExactLookup(stack, [ORIGINAL.map]), PLANNER, SETTINGS)


def test_a_plain_import_is_enough_and_loads_only_what_a_picture_needs() -> None:
    """A process of its own: Matplotlib comes with the first picture, PyTorch not even then."""
    code = (
        "import sys, affmap; world = affmap.Layout.load('layout', 'original'); "
        "assert not {'matplotlib', 'affmap.plot'} & {*sys.modules}; "
        "assert world._repr_html_().count('<img') == 1; "
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)


def test_ipython_shows_pictures_and_falls_back_to_words() -> None:
    formatters = pytest.importorskip("IPython.core.formatters", reason="the extra [docs]: make docs")
    display = formatters.DisplayFormatter()
    for thing in (ORIGINAL, make_map(), make_agent(3), make_runs([ORIGINAL])):
        shown, _ = display.format(thing)
        assert shown["text/html"] == thing._repr_html_() and shown["text/plain"]
    for thing in (make_map(context_size=0), make_agent(0)):
        shown, _ = display.format(thing)
        assert set(shown) == {"text/plain"}


def covers(picture: np.ndarray, effect: str) -> bool:
    """Whether circles with an effect are in a picture: its colour, of 85 % opacity on white, in many pixels."""
    color = 1 - 0.85 * (1 - np.array(to_rgb(EFFECTS[effect].color)))
    return np.isclose(picture[..., :3], color, atol=0.01).all(axis=-1).sum() > 1000


def test_a_layout_says_what_is_in_it() -> None:
    """Counted by hand, and seen in the picture."""
    caption, picture = parts(ORIGINAL._repr_html_())
    assert caption == "original, 3 × 2 u. Circles: obstacle (6)."
    assert covers(picture, "obstacle") and not covers(picture, "fog")
    caption, picture = parts(Layout.load("layout", "four_properties")._repr_html_())
    assert caption == "four_properties, 3 × 2 u. Circles: pulls up (1), pulls down (1), fog (1) and obstacle (1)."
    assert covers(picture, "obstacle") and covers(picture, "fog")
    caption, picture = parts(Layout.load("layout", "original", circles=[])._repr_html_())
    assert caption == "original, 3 × 2 u. Circles: –." and not covers(picture, "obstacle")


def test_rules_show_three_worlds_and_impossible_ones_none() -> None:
    rules = Procedural.load("layout", "procedural_easy")
    caption, picture = parts(rules._repr_html_())
    assert caption.startswith("procedural_easy, 3 × 2 u. Rules for worlds with ")
    _, alone = parts(ORIGINAL._repr_html_())
    assert picture.shape[1] == 3 * alone.shape[1]
    crowded = Procedural.load("layout", "procedural_easy", count=[200, 200], radius=[0.3, 0.3])
    assert crowded._repr_html_() is None


def test_maps_and_agents_say_what_they_are() -> None:
    """An agent without a map shows the one that reports have, in more nodes than a coarse one."""
    caption, coarse = parts(make_map()._repr_html_())
    assert caption.startswith("Affordance map, context size 3, 13 × 9 nodes. Three principal components")
    assert caption.endswith("The first of 2 maps.")
    caption, fine = parts(make_agent(3)._repr_html_())
    assert caption.startswith("Agent, members 0 and 1; context size 3; CEMPlanner, horizon 20. Three principal")
    assert len(np.unique(fine.reshape(-1, 4), axis=0)) > len(np.unique(coarse.reshape(-1, 4), axis=0)) > 100


def test_runs_show_paths_and_the_first_rows() -> None:
    """Eight of nine rows, one of them with a start of 0.2 u; runs in another world are counted, not drawn."""
    html = make_runs([ORIGINAL] * 8 + [TWO])._repr_html_()
    caption, _ = parts(html)
    assert caption == "8 runs in original, of 9 in several worlds; the first 8 rows of their table."
    assert html is not None and html.count("<tr") == 1 + 8 and "<td>0.2</td>" in html
    assert parts(make_runs([TWO])._repr_html_())[0] == "1 run in two_obstacles."
