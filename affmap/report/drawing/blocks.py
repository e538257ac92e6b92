"""Drawing functions for the effects of blocks of the code over a map: data and Axes in, Axes out."""

from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from affmap.env.effects import EFFECTS
from affmap.env.geometry import CELL, Mask, reachable
from affmap.env.layout import Layout
from affmap.report.drawing import arena
from affmap.results.files import Blocks
from affmap.results.halo import UNCERTAIN

NOISE, RESISTANCE = "Blues", "Greys"
"""Colour maps of the deviation that a block adds, and of the spread of its changes: the hues of fog and obstacles."""

FAINT, LONGEST = 0.15, 2.0
"""Arrows are left out below this share of the largest change; the longest are as many distances between arrows."""

ARROWS: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.007, "zorder": 3} | {
    "headwidth": 3.5, "headlength": 3.5, "headaxislength": 3.0,
}  # fmt: skip


class Scales(NamedTuple):
    """Largest values that a figure tells apart, in all of its panels; u/step."""

    deviation: float
    spread: float
    change: float


def block_effect(ax: Axes, blocks: Blocks, number: int, world: Layout, radius: float, scales: Scales) -> Axes:
    """Draw the effect of a block alone: its noise in blue, changes that depend on motion in grey, others as arrows.

    Places out of reach stay white. There are no arrows where the block adds so much noise that it hides any change.

    Args:
        ax: where to draw.
        blocks: effects of all blocks.
        number: index of the block.
        world: the layout, whose circles have the colours of their effects.
        radius: of the vehicle, u.
        scales: of the figure; arrows of larger changes are no longer.
    """
    possible = reachable(blocks.nodes, world, radius)
    change, noise = blocks.change[number], blocks.deviation[number]
    layers = ((NOISE, noise / scales.deviation), (RESISTANCE, blocks.spread[number] / scales.spread))
    colors = np.prod([mpl.colormaps[name](values)[..., :3] for name, values in layers], axis=0)
    colors[~possible] = 1.0
    arena.affordance_map(ax, colors, blocks.x, blocks.y, world.map)
    for disc, circle in zip(ax.patches, world.circles, strict=True):
        disc.set(edgecolor=EFFECTS[circle.effect].color, linewidth=1.2)
    length = np.linalg.norm(change, axis=-1)
    shown = possible & (noise <= UNCERTAIN) & (length >= FAINT * scales.change) & _every_cell(blocks)
    arrows = LONGEST * CELL * change[shown] / np.maximum(length[shown], scales.change)[:, None]
    ax.quiver(*blocks.nodes[shown].T, *arrows.T, **ARROWS)
    return ax


def _every_cell(blocks: Blocks) -> Mask:
    """A node in each cell of the map, `[Y, X]`, near its middle; all nodes of a coarser map."""
    chosen = []
    for axis in (blocks.y, blocks.x):
        apart = max(1, round(CELL / (axis[1] - axis[0])))
        chosen.append(np.arange(len(axis)) % apart == apart // 2)
    mask: Mask = np.logical_and.outer(*chosen)
    return mask
