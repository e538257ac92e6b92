"""The code at a position, from an affordance map or from the view itself, and its gradient on the way back.

Compiled code takes the kind of look-up from the type of its arguments. A tape records intermediate values for the
gradient; see `affmap.compiled.gradients`.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from affmap.compiled.direct import PER_SIDE, PICTURES, PLACES, encode
from affmap.compiled.jit import inlined
from affmap.compiled.lanes import WIDTH, fma, load, pointer, splat, store
from affmap.compiled.problems import INPUTS, Array, Maps, Scenes
from affmap.compiled.views import paint

f32 = np.float32


class Grid(NamedTuple):
    """A member's affordance map."""

    codes: Any
    rows: int
    columns: int
    num_codes: int
    scale_x: f32
    scale_y: f32


class Sight(NamedTuple):
    """A member's vision model and the layout that it sees, with buffers between layers."""

    offsets: Array
    size: Array
    border_channel: int
    circles: Array
    channels: Array
    weights: Any
    """Seven flat arrays."""
    place: Array
    squares: Array
    rows: Array
    convolved: Array
    features: Array
    hidden2: Array
    hidden3: Array
    code: Array


def _overloaded(function: Any) -> Any:
    """Declare a function that is compiled according to the kind of look-up."""
    return overload(function, jit_options={"forceinline": True, "error_model": "numpy"}, strict=False)


def select(lookup: Any, b: int, num_problems: int) -> Any:
    """Return the look-up of problem b."""


def look_up(source: Any, tape: Any, x: f32, y: f32, t: int, inputs: int) -> None:
    """Write the code at a position into the inputs of step t, and record values for its gradient."""


def map_slopes(source: Any, own: Any, tape: Any, t: int) -> Any:
    """Return gradients of the position that was looked up, from those of its code."""


@_overloaded(select)
def _typed_select(lookup: Any, b: Any, num_problems: Any) -> Any:
    if lookup.instance_class is Maps:
        return _grid
    return _sight


@_overloaded(look_up)
def _typed_look_up(source: Any, tape: Any, x: Any, y: Any, t: Any, inputs: Any) -> Any:
    return _interpolate if source.instance_class is Grid else _see


@_overloaded(map_slopes)
def _typed_map_slopes(source: Any, own: Any, tape: Any, t: Any) -> Any:
    return _grid_slopes if source.instance_class is Grid else _no_slopes


def _grid(lookup: Maps, b: int, num_problems: int) -> Grid:
    num_worlds, rows, columns, num_codes = lookup.codes.shape
    codes = pointer(lookup.codes[b * num_worlds // num_problems])
    return Grid(codes, rows, columns, num_codes, lookup.scale[0], lookup.scale[1])


def _interpolate(source: Grid, tape: Any, x: f32, y: f32, t: int, inputs: int) -> None:
    """The code at a position, between four nodes."""
    u, v = _cell(x * source.scale_x, source.columns), _cell(y * source.scale_y, source.rows)
    i, j = min(int(u), source.columns - 2), min(int(v), source.rows - 2)
    node = (j * source.columns + i) * source.num_codes
    tape.node[t] = node
    inside_x, inside_y = f32(0) < u < f32(source.columns - 1), f32(0) < v < f32(source.rows - 1)
    u, v = u - f32(i), v - f32(j)
    tape.cell[2 * t] = u if inside_x else -f32(1) - u
    tape.cell[2 * t + 1] = v if inside_y else -f32(1) - v
    along_x, along_y = splat(u), splat(v)
    row = source.columns * source.num_codes
    for c in range(node, node + source.num_codes, WIDTH):
        low, high = load(source.codes, c), load(source.codes, c + row)
        low = fma(load(source.codes, c + source.num_codes) - low, along_x, low)
        high = fma(load(source.codes, c + row + source.num_codes) - high, along_x, high)
        store(tape.inputs, inputs + c - node, fma(high - low, along_y, low))


@inlined
def _cell(x: f32, num_nodes: int) -> f32:
    """A coordinate (in nodes) moved into the map; NaN to its border."""
    return min(x, f32(num_nodes - 1)) if x > f32(0) else f32(0)


def _grid_slopes(source: Grid, own: Any, tape: Any, t: int) -> Any:
    """Gradients of the position that was looked up, from those of its code."""
    u, v = tape.cell[2 * t], tape.cell[2 * t + 1]
    inside_x, inside_y = u >= f32(0), v >= f32(0)
    u, v = u if inside_x else -f32(1) - u, v if inside_y else -f32(1) - v
    node, row, stride = tape.node[t], source.columns * source.num_codes, source.num_codes
    along_x = along_y = f32(0)
    for c in range(own.num_inputs - INPUTS):
        k = node + c
        low, high = source.codes[k + stride] - source.codes[k], source.codes[k + row + stride] - source.codes[k + row]
        left, right = source.codes[k + row] - source.codes[k], source.codes[k + row + stride] - source.codes[k + stride]
        slope = tape.gradient[INPUTS + c]
        along_x += slope * (low + v * (high - low))
        along_y += slope * (left + u * (right - left))
    return along_x * source.scale_x if inside_x else f32(0), along_y * source.scale_y if inside_y else f32(0)


def _sight(lookup: Scenes, b: int, num_problems: int) -> Sight:
    w, m = b * len(lookup.circles) // num_problems, b * len(lookup.pictures) // num_problems
    weights = (
        lookup.pictures[m].reshape(-1),
        lookup.weight2[m].reshape(-1),
        lookup.bias2[m],
        lookup.weight3[m].reshape(-1),
        lookup.bias3[m],
        lookup.weight4[m].reshape(-1),
        lookup.bias4[m],
    )
    return Sight(
        lookup.offsets,
        lookup.size,
        lookup.border_channels[w],
        lookup.circles[w],
        lookup.channels[w],
        weights,
        np.empty_like(lookup.size),
        np.empty_like(lookup.offsets),
        np.empty((lookup.pictures.shape[1] // PICTURES, len(lookup.offsets)), np.uint64),
        np.empty(PLACES * WIDTH, f32),
        np.empty((PER_SIDE**2 + 1) * WIDTH, f32),
        np.empty_like(lookup.bias2[m]),
        np.empty_like(lookup.bias3[m]),
        np.empty_like(lookup.bias4[m]),
    )


def _see(source: Sight, tape: Any, x: f32, y: f32, t: int, inputs: int) -> None:
    source.place[0] = min(max(x, f32(0)), source.size[0])
    source.place[1] = min(max(y, f32(0)), source.size[1])
    paint(
        source.place,
        source.offsets,
        source.size,
        source.border_channel,
        source.circles,
        source.channels,
        source.squares,
        source.rows,
    )
    pictures, weight2, bias2, weight3, bias3, weight4, bias4 = source.weights
    between = source.convolved, source.features, source.hidden2, source.hidden3
    encode(source.rows, pictures, weight2, bias2, weight3, bias3, weight4, bias4, *between, source.code)
    for c in range(0, len(source.code), WIDTH):
        store(tape.inputs, inputs + c, load(source.code, c))


def _no_slopes(source: Sight, own: Any, tape: Any, t: int) -> Any:
    return f32(0), f32(0)
