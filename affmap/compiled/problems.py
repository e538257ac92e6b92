"""Imagination as data for compiled loops: networks, affordance maps, starts and goals of paths.

All arrays are contiguous, and float32 unless said otherwise. B problems are member-major, as everywhere: problem b
belongs to member b M / B and to world b M W / B.
"""

from typing import NamedTuple

import numpy as np

from affmap.compiled.lanes import WIDTH

Array = np.ndarray

LOG_2_PI_E = np.float32(np.log(2 * np.pi) + 1)

INPUTS = 6
"""Inputs of a network before the code: the last change of position and the action."""


class Weights(NamedTuple):
    """Weights of M networks, hidden units in blocks of eight, all constant factors multiplied in (see `pack`)."""

    hidden: Array
    """`[M, U / 8, 2 + 4 + C, 8]`; a hidden unit is 1 / (1 + 2^(its weights x inputs))."""
    output: Array
    """`[M, U / 8, 4, 8]`; the last two outputs are logarithms of the variances, to base 2."""
    bias: Array
    """`[M, 4]`"""


class Maps(NamedTuple):
    """Affordance maps of M * W worlds."""

    codes: Array
    """`[M * W, Y, X, C]`, C padded to whole vectors."""
    scale: Array
    """`[2]`, nodes a u along x and y."""


class Scenes(NamedTuple):
    """W layouts, and M vision models that see them (`affmap.view.LayoutArrays`, `affmap.model.direct.Weights`)."""

    offsets: Array
    """`[11]`, from a position to the centres of pixels, u."""
    size: Array
    """`[2]`, of the arenas, u."""
    border_channels: Array
    """`[W]`, int64."""
    circles: Array
    """`[W, N, 3]`, padded with squared radii below 0."""
    channels: Array
    """`[W, N]`, int64."""
    pictures: Array
    """From here on: the vision models, `affmap.model.direct.Weights`."""
    weight2: Array
    bias2: Array
    weight3: Array
    bias3: Array
    weight4: Array
    bias4: Array


class Start(NamedTuple):
    """Starts of the paths of B problems."""

    position: Array
    """`[B, 2]`, u."""
    delta: Array
    """`[B, 2]`, u/step."""


class Desired(NamedTuple):
    """Goals of the paths of B problems, and the weight of uncertainty."""

    goal: Array
    """`[B, 2]`, u."""
    goal_std: Array
    """`[B]`, u."""
    beta: np.float32
    """Weight of the uncertainty."""


def pack(hidden: Array, output: Array, bias: Array) -> Weights:
    """Arrange weights for these loops.

    Args:
        hidden: `[M, 2 + 4 + C, U]`, for inputs in u/step; hidden units are sigmoids.
        output: `[M, 4, U]`, means and logarithms of standard deviations in u/step.
        bias: `[M, 4]`
    """
    num_members, _, num_units = hidden.shape
    log2_e = 1 / np.log(2)
    factor = np.array([1, 1, 2 * log2_e, 2 * log2_e])
    padding = -num_units % WIDTH  # units without weights
    hidden = np.pad(-log2_e * hidden, [(0, 0), (0, 0), (0, padding)])
    output = np.pad(factor[:, None] * output, [(0, 0), (0, 0), (0, padding)])
    blocks = (part.reshape(num_members, -1, (num_units + padding) // WIDTH, WIDTH) for part in (hidden, output))
    hidden, output = (np.ascontiguousarray(part.swapaxes(1, 2), np.float32) for part in blocks)
    return Weights(hidden, output, np.ascontiguousarray(factor * bias, np.float32))
