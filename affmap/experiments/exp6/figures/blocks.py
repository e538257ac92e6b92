"""Effects of the blocks of context codes, each alone: where a block adds noise, where it resists, where it pulls."""

import textwrap
from collections.abc import Sequence
from itertools import zip_longest

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from affmap.env.body import Vehicle
from affmap.env.effects import EFFECTS
from affmap.env.geometry import reachable
from affmap.report.drawing import arena
from affmap.report.drawing import blocks as drawing
from affmap.report.drawing.files import Drawn, new_figure
from affmap.report.painted import Painted, first_settings, map_size, of_part, read_painted
from affmap.results.examples import MAX_ROWS
from affmap.results.files import Blocks
from affmap.results.halo import UNCERTAIN
from affmap.results.numbers import number
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results

NUM_BLOCKS = 4
"""Blocks that are drawn, so that panels are large enough."""

NOTABLE = 0.2
"""Smallest share of a block in the effects on a property with which its title names that property."""

NO_BREAK = "\N{NO-BREAK SPACE}"

COMMON = 0.99
"""Quantile of the nodes within reach whose spread has the darkest grey; the few that lie above are as dark."""


def draw(results: Results, settings: ReportSettings) -> Drawn | None:
    """Draw and caption the figure; None if the codes of no model consist of blocks."""
    size = map_size(results)
    jobs = [setting for setting in results.settings if setting.blocks and setting.context_size == size]
    parts = [read_painted(results, setting) for setting in first_settings(jobs, "blocks")[:MAX_ROWS]]
    if not parts:
        return None
    blocks = [results.blocks(part.setting) for part in parts]
    scales = _scales(parts, blocks, results.vehicle(parts[0].setting))
    figure = new_figure(1.6 * len(parts) + 1.1)
    grid = figure.subplots(len(parts), NUM_BLOCKS, sharex=True, sharey=True, squeeze=False)
    for axes, part, each in zip(grid, parts, blocks, strict=True):
        shares = results.shares(part.setting)
        titles = _titles(shares[shares["member"] == part.maps.member[0]])
        for index, (ax, title) in enumerate(zip_longest(axes, titles[:NUM_BLOCKS])):
            if title is None:
                ax.set_axis_off()
                continue
            drawing.block_effect(ax, each, index, part.world, part.radius, scales)
            ax.set_title(title, loc="left", fontsize=6.5)
            ax.label_outer()
        name = of_part(results, part, parts, settings).removeprefix(": ")
        axes[0].set_ylabel(f"{name}\n{axes[0].get_ylabel()}".lstrip())
    bars = [
        (grid[:, :2], drawing.NOISE, scales.deviation, "added deviation (u/step)"),
        (grid[:, 2:], drawing.RESISTANCE, scales.spread, "change that depends on motion (u/step)"),
    ]
    for axes, colors, largest, label in bars:
        colored = ScalarMappable(Normalize(0, largest), colors)
        figure.colorbar(colored, ax=axes, location="bottom", label=label, extend="max", fraction=0.04, aspect=40)
    handles = arena.effect_handles(part.world for part in parts)
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return Drawn(figure, _caption(parts, blocks, scales))


def _scales(parts: Sequence[Painted], blocks: Sequence[Blocks], vehicle: Vehicle) -> drawing.Scales:
    """Scales up to the noise of fog, the spread that few nodes exceed, and the effect of an open throttle in a step."""
    spread = [
        np.nan_to_num(np.quantile(each.spread[:, reachable(each.nodes, part.world, part.radius)].max(0), COMMON))
        for part, each in zip(parts, blocks, strict=True)
    ]
    kept = 1 - vehicle.damping * vehicle.time_step_s
    thrust = vehicle.thrust / vehicle.mass * vehicle.time_step_s**2 * kept
    return drawing.Scales(vehicle.fog_std or 1.0, float(max(spread)) or 1.0, thrust)


def _titles(shares: pd.DataFrame) -> list[str]:
    """Titles for the blocks of a member, all of the same number of lines: the effects that each has a part in."""
    lines = []
    for block, own in shares.groupby("block"):
        notable = own[own["share"] >= NOTABLE].sort_values("share", ascending=False)
        named = [f"{EFFECTS[kind].label} {part:.0%}" for kind, part in notable[["effect", "share"]].to_numpy()]
        text = ", ".join(each.replace(" ", NO_BREAK) for each in named) or f"below {NOTABLE:.0%} of each"
        lines.append([f"block {block}:", *textwrap.wrap(text, 30)])
    height = max(map(len, lines))
    return ["\n".join(each + [""] * (height - len(each))) for each in lines]


def _caption(parts: Sequence[Painted], blocks: Sequence[Blocks], scales: drawing.Scales) -> str:
    left_out = max(len(each.change) for each in blocks) > NUM_BLOCKS
    return (
        "Effects of each block of the context code alone (the code of all others being 0), of member "
        f"{parts[0].maps.member[0]}: the difference from free motion in the next step, over 16 motions (thrust in "
        "eight directions, from rest and at its top speed). Arrows: its mean; the longest stand for "
        f"{number(scales.change, 3)} u/step, the effect of an open throttle, and for all that is larger. Grey: how "
        "much it varies with motion, as contact does. Blue: the standard deviation that the block adds to a "
        f"coordinate; above {UNCERTAIN:g} u/step it hides any change, and there are no arrows. Places out of reach "
        "are white. Titles: the block's share in the effects of all blocks (mean squares of changes and deviations) "
        f"where circles of a kind act in the training worlds, from {NOTABLE:.0%} up."
        f"{f' Only the first {NUM_BLOCKS} blocks are shown.' if left_out else ''}"
    )
