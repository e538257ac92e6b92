"""The figure and the table of the effects of blocks, from numbers that are set by hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.quiver import Quiver
from stage_files import X, Y, with_blocks

from affmap.env.body import Vehicle
from affmap.env.effects import EFFECTS
from affmap.env.geometry import reachable
from affmap.experiments import ROOMS, open_room
from affmap.experiments.exp6.figures.blocks import draw
from affmap.report import figures
from affmap.report.content import Content
from affmap.results.blocks import together
from affmap.results.files import Blocks
from affmap.results.setting import ReportSettings, Setting
from affmap.results.tables import Results

SETTINGS = ReportSettings.load("report", "default")
FORCE, NOISE = (0.003, -0.004), 0.5
THRUST = 1.0 / 0.1 * 0.03333333333333333**2 * (1 - 1.92 * 0.03333333333333333)
"""u/step that an open throttle adds in a step: 1 N, 0.1 kg, damping of 1.92 1/s."""


def table(parts: dict[int, dict[str, tuple[float, float]]]) -> pd.DataFrame:
    """Shares of two blocks, by member and effect."""
    rows = [
        (member, effect, block, share)
        for member, effects in parts.items()
        for effect, shares in effects.items()
        for block, share in enumerate(shares, start=1)
    ]
    return pd.DataFrame(rows, columns=["member", "effect", "block", "share"])


SHARES = table(
    {
        0: {"fog": (0.1, 0.9), "force_up": (0.75, 0.25), "force_down": (1.0, 0.0)},
        1: {"fog": (0.9, 0.1), "force_up": (0.3, 0.7), "force_down": (0.8, 0.2)},
    }
)


def results(root: Path, jobs: list[Setting]) -> Results:
    """The first block pushes everywhere, and is uncertain in the left half; the second adds noise in the right half."""
    left = np.broadcast_to(X < 1.5, (len(Y), len(X)))
    change, noise = np.zeros((2, len(Y), len(X), 2)), NOISE * np.stack([left, ~left])
    change[0] = FORCE
    blocks = Blocks(change, np.zeros_like(noise), noise, X, Y)
    return Results(tuple(with_blocks(root, job, blocks, SHARES) for job in jobs))


@pytest.fixture
def jobs(write_stages: Callable[..., list[Setting]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Setting]:
    """Settings of Experiment V with two members; written ones know no more of the vehicle than its radius."""
    monkeypatch.setattr(Results, "vehicle", lambda *_: Vehicle.load("vehicle", "default"))
    return write_stages(tmp_path, (8,), ("cem",), members=2, epochs=1, steps=2, experiment="exp5")


def test_panels_show_the_numbers_and_name_the_effects_of_their_blocks(tmp_path: Path, jobs: list[Setting]) -> None:
    """By hand: an arrow in each cell of 0.1 u within reach, outside noise; no arrow of a block without change; twice
    the distance of arrows is the effect of a throttle; circles have the colours of their effects."""
    found = results(tmp_path, jobs[:1])
    drawn = draw(found, SETTINGS)
    assert drawn is not None and "of member 0" in drawn.caption and "Only the first" not in drawn.caption
    first, second, *others = [ax for ax in drawn.figure.axes if ax.get_subplotspec() and ax.axison][:2]
    assert not others
    titles = [ax.get_title(loc="left").replace("\N{NO-BREAK SPACE}", " ").rstrip("\n") for ax in (first, second)]
    assert titles == ["block 1:\npulls down 100%, pulls up 75%", "block 2:\nfog 90%, pulls up 25%"]
    arrows, none = (next(each for each in ax.collections if isinstance(each, Quiver)) for ax in (first, second))
    world, radius = found.map_layout(jobs[0]), found.vehicle_radius(jobs[0])
    places = np.stack(np.meshgrid(X[2::5], Y[2::5]), axis=-1)
    expected = places[reachable(places, world, radius) & (places[..., 0] >= 1.5)]
    np.testing.assert_allclose(arrows.XY, expected, atol=1e-9)
    np.testing.assert_allclose(
        np.stack([arrows.U, arrows.V], -1), np.tile(0.2 * np.array(FORCE) / THRUST, (len(expected), 1))
    )
    assert not none.N
    colors = [patch.get_edgecolor()[:3] for patch in first.patches]
    assert colors == [to_rgb(EFFECTS[circle.effect].color) for circle in world.circles]
    image = np.asarray(second.images[0].get_array())
    free, noisy, out = image[10, 10], image[10, 140], image[0, 0]
    np.testing.assert_allclose(free, colormaps["Blues"](0.0)[:3])
    np.testing.assert_allclose(noisy, colormaps["Blues"](NOISE)[:3])
    assert out.min() == 1.0, "no vehicle can be there"


def test_the_table_counts_members_in_which_a_block_has_the_largest_part_in_both(
    tmp_path: Path, jobs: list[Setting]
) -> None:
    """By hand: the first member's pulls are in one block, the second's fog and pull down; and diverged members."""
    shared = {("fog", "force_up"): 0.0, ("fog", "force_down"): 0.5, ("force_up", "force_down"): 0.5}
    assert together(SHARES).to_dict() == shared
    diverged = SHARES.assign(share=SHARES["share"].where(SHARES["member"] == 0))
    assert together(diverged).to_dict() == {pair: share and (pair[0] != "fog") / 2 for pair, share in shared.items()}
    found = results(tmp_path, jobs[:1])
    content = Content("", None, found, (), SETTINGS, (), {}, {})
    lines = content.blocks().splitlines()
    assert lines[0] == "| Largest part in one block | C = 8 |"
    assert lines[2:] == [
        "| fog and pulls up | 0% |",
        "| fog and pulls down | 50% |",
        "| pulls up and pulls down | 50% |",
    ]


def test_models_without_blocks_have_neither_figure_nor_table(jobs: list[Setting]) -> None:
    """Only the page of Experiment VI has them."""
    found = Results(tuple(jobs))
    assert draw(found, SETTINGS) is None and not Content("", None, found, (), SETTINGS, (), {}, {}).blocks()
    rooms = {name for name in ROOMS if "blocks" in figures.figures_of(*open_room(name, name).figures)}
    assert rooms == {"exp6"}
