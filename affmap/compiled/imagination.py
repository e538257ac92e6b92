"""The imagination of multilayer perceptrons with affordance maps, and its expected free energy, in one loop nest.

The same as `affmap.model.rollout` and `affmap.planning.objective`, which are its reference. Vectors hold eight paths
side by side.
"""

from typing import Any, NamedTuple

import numpy as np

from affmap.compiled.functions import exp2, log, sigmoids
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import (
    WIDTH,
    at_most,
    broadcast,
    floor,
    fma,
    keep,
    load,
    pointer,
    splat,
    spread,
    store,
    transposed,
    where_less,
    whole,
)
from affmap.compiled.problems import INPUTS, LOG_2_PI_E, Array, Desired, Maps, Start, Weights

f32 = np.float32


class _Memory(NamedTuple):
    """Addresses: weights, codes, and numbers of the current problem; P is its number of paths, whole vectors."""

    hidden: Any
    output: Any
    bias: Any
    codes: Any
    actions: Any
    """`[H * 4, P]`"""
    mean: Any
    """`[2, P]`, current positions."""
    variance: Any
    """`[2, P]`"""
    delta: Any
    """`[2, P]`"""
    inputs: Any
    """`[2 + 4 + C, 8]`, of the network for eight paths."""


class _Sizes(NamedTuple):
    members: int
    problems: int
    paths: int
    """P"""
    blocks: int
    """Hidden units / 8."""
    inputs: int
    worlds: int
    rows: int
    columns: int
    codes: int
    """C"""


@compiled
def costs(
    weights: Weights,
    maps: Maps,
    start: Start,
    actions: Array,
    desired: Desired,
    result: Array,
) -> None:
    """Write the expected free energy (nats) of actions `[B, N, H, 4]` into `result` `[B, N]`."""
    num_problems, num_candidates, horizon, _ = actions.shape
    sizes = _sizes(weights, maps, num_problems, num_candidates)
    buffers = _buffers(sizes, horizon)
    memory = _memory(weights, maps, buffers, sizes, horizon)
    total = np.empty(sizes.paths, f32)
    for b in range(num_problems):
        _begin(memory, sizes, start, actions, b)
        total[:] = f32(0)
        std = desired.goal_std[b]
        precision = splat(f32(0.5) / (std * std))
        factor = splat(f32(0.5) * (desired.beta - f32(1)))
        goal_x, goal_y = splat(desired.goal[b, 0]), splat(desired.goal[b, 1])
        for t in range(horizon):
            for p in range(0, sizes.paths, WIDTH):
                x, y, variance_x, variance_y = _advance(memory, sizes, maps.scale[0], maps.scale[1], b, t, p)
                x, y = x - goal_x, y - goal_y
                distance = fma(x, x, fma(y, y, variance_x + variance_y))
                term = fma(distance, precision, (log(variance_x) + log(variance_y)) * factor)
                store(total, p, load(total, p) + term)
        constant = f32(2) * np.log(std) - f32(1) + desired.beta * LOG_2_PI_E
        for p in range(num_candidates):
            result[b, p] = total[p] / f32(horizon) + constant
    keep(buffers)


@compiled
def positions(
    weights: Weights,
    maps: Maps,
    start: Start,
    actions: Array,
    mean: Array,
    variance: Array,
) -> None:
    """Write positions along the paths of actions `[B, N, H, 4]` into `mean` (u) and `variance`, `[B, H, 2, N]`."""
    num_problems, num_candidates, horizon, _ = actions.shape
    sizes = _sizes(weights, maps, num_problems, num_candidates)
    buffers = _buffers(sizes, horizon)
    memory = _memory(weights, maps, buffers, sizes, horizon)
    for b in range(num_problems):
        _begin(memory, sizes, start, actions, b)
        for t in range(horizon):
            for p in range(0, sizes.paths, WIDTH):
                _advance(memory, sizes, maps.scale[0], maps.scale[1], b, t, p)
            for d in range(2):
                for p in range(num_candidates):
                    mean[b, t, d, p] = memory.mean[d * sizes.paths + p]
                    variance[b, t, d, p] = memory.variance[d * sizes.paths + p]
    keep(buffers)


@inlined
def _sizes(weights: Weights, maps: Maps, num_problems: int, num_candidates: int) -> _Sizes:
    num_members, num_blocks, num_inputs, _ = weights.hidden.shape
    num_paths = (num_candidates + WIDTH - 1) // WIDTH * WIDTH
    worlds, rows, columns, num_codes = maps.codes.shape
    return _Sizes(num_members, num_problems, num_paths, num_blocks, num_inputs, worlds, rows, columns, num_codes)


@inlined
def _buffers(sizes: _Sizes, horizon: int) -> Array:
    return np.empty((horizon * 4 + 6) * sizes.paths + (INPUTS + sizes.codes) * WIDTH, f32)


@inlined
def _memory(weights: Weights, maps: Maps, buffers: Array, sizes: _Sizes, horizon: int) -> _Memory:
    paths = sizes.paths
    mean = horizon * 4 * paths
    return _Memory(
        pointer(weights.hidden),
        pointer(weights.output),
        pointer(weights.bias),
        pointer(maps.codes),
        pointer(buffers),
        pointer(buffers[mean:]),
        pointer(buffers[mean + 2 * paths :]),
        pointer(buffers[mean + 4 * paths :]),
        pointer(buffers[mean + 6 * paths :]),
    )


@inlined
def _begin(memory: _Memory, sizes: _Sizes, start: Start, actions: Array, b: int) -> None:
    """Put all paths of problem b at their start; actions of one step become neighbours."""
    zero = splat(f32(0))
    for p in range(0, 2 * sizes.paths, WIDTH):
        d = p // sizes.paths
        store(memory.mean, p, splat(start.position[b, d]))
        store(memory.delta, p, splat(start.delta[b, d]))
        store(memory.variance, p, zero)
    width = actions.shape[2] * 4
    whole_vectors = width // WIDTH * WIDTH
    own = pointer(actions[b])
    last = actions.shape[1] - 1  # fills up its vector
    for p in range(0, sizes.paths, WIDTH):
        for k in range(0, whole_vectors, WIDTH):
            columns = transposed(
                load(own, min(p, last) * width + k),
                load(own, min(p + 1, last) * width + k),
                load(own, min(p + 2, last) * width + k),
                load(own, min(p + 3, last) * width + k),
                load(own, min(p + 4, last) * width + k),
                load(own, min(p + 5, last) * width + k),
                load(own, min(p + 6, last) * width + k),
                load(own, min(p + 7, last) * width + k),
            )
            _store_rows(memory.actions, k * sizes.paths + p, sizes.paths, columns)
        for k in range(whole_vectors, width):
            for q in range(WIDTH):
                memory.actions[k * sizes.paths + p + q] = own[min(p + q, last) * width + k]


@inlined
def _store_rows(array: Any, first: int, stride: int, rows: Any) -> None:
    """Write eight vectors, `stride` numbers apart."""
    store(array, first, rows[0])
    store(array, first + stride, rows[1])
    store(array, first + 2 * stride, rows[2])
    store(array, first + 3 * stride, rows[3])
    store(array, first + 4 * stride, rows[4])
    store(array, first + 5 * stride, rows[5])
    store(array, first + 6 * stride, rows[6])
    store(array, first + 7 * stride, rows[7])


@inlined
def _advance(memory: _Memory, sizes: _Sizes, scale_x: f32, scale_y: f32, b: int, t: int, p: int) -> Any:
    """Go a step on eight paths; returns their positions and variances, four vectors."""
    x, y = load(memory.mean, p), load(memory.mean, sizes.paths + p)
    store(memory.inputs, 0, load(memory.delta, p))
    store(memory.inputs, WIDTH, load(memory.delta, sizes.paths + p))
    for k in range(4):
        store(memory.inputs, (2 + k) * WIDTH, load(memory.actions, (4 * t + k) * sizes.paths + p))
    if sizes.codes > 0:
        _look_up(memory, sizes, b * sizes.worlds // sizes.problems, x * splat(scale_x), y * splat(scale_y))
    change_x, change_y, log_x, log_y = _network(memory, sizes, b * sizes.members // sizes.problems)
    store(memory.delta, p, change_x)
    store(memory.delta, sizes.paths + p, change_y)
    x, y = x + change_x, y + change_y
    store(memory.mean, p, x)
    store(memory.mean, sizes.paths + p, y)
    variance_x = load(memory.variance, p) + exp2(log_x)
    variance_y = load(memory.variance, sizes.paths + p) + exp2(log_y)
    store(memory.variance, p, variance_x)
    store(memory.variance, sizes.paths + p, variance_y)
    return x, y, variance_x, variance_y


@inlined
def _network(memory: _Memory, sizes: _Sizes, m: int) -> Any:
    """The four outputs of member m's network for eight paths."""
    hidden, output, bias = memory.hidden, memory.output, memory.bias
    o0, o1 = broadcast(bias, 4 * m), broadcast(bias, 4 * m + 1)
    o2, o3 = broadcast(bias, 4 * m + 2), broadcast(bias, 4 * m + 3)
    w, v = m * sizes.blocks * sizes.inputs * WIDTH, m * sizes.blocks * 4 * WIDTH
    for _block in range(sizes.blocks):
        h0 = h1 = h2 = h3 = h4 = h5 = h6 = h7 = splat(f32(0))
        for i in range(sizes.inputs):
            value = load(memory.inputs, i * WIDTH)
            h0 = fma(broadcast(hidden, w), value, h0)
            h1 = fma(broadcast(hidden, w + 1), value, h1)
            h2 = fma(broadcast(hidden, w + 2), value, h2)
            h3 = fma(broadcast(hidden, w + 3), value, h3)
            h4 = fma(broadcast(hidden, w + 4), value, h4)
            h5 = fma(broadcast(hidden, w + 5), value, h5)
            h6 = fma(broadcast(hidden, w + 6), value, h6)
            h7 = fma(broadcast(hidden, w + 7), value, h7)
            w += WIDTH
        h0, h1, h2, h3 = sigmoids(h0, h1, h2, h3)
        h4, h5, h6, h7 = sigmoids(h4, h5, h6, h7)
        o0 = _dot(output, v, h0, h1, h2, h3, h4, h5, h6, h7, o0)
        o1 = _dot(output, v + WIDTH, h0, h1, h2, h3, h4, h5, h6, h7, o1)
        o2 = _dot(output, v + 2 * WIDTH, h0, h1, h2, h3, h4, h5, h6, h7, o2)
        o3 = _dot(output, v + 3 * WIDTH, h0, h1, h2, h3, h4, h5, h6, h7, o3)
        v += 4 * WIDTH
    return o0, o1, o2, o3


@inlined
def _dot(w: Any, v: int, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, total: Any) -> Any:
    """Eight vectors times eight neighbours in `w`, added to a vector."""
    total = fma(broadcast(w, v), a, total)
    total = fma(broadcast(w, v + 1), b, total)
    total = fma(broadcast(w, v + 2), c, total)
    total = fma(broadcast(w, v + 3), d, total)
    total = fma(broadcast(w, v + 4), e, total)
    total = fma(broadcast(w, v + 5), f, total)
    total = fma(broadcast(w, v + 6), g, total)
    return fma(broadcast(w, v + 7), h, total)


@inlined
def _look_up(memory: _Memory, sizes: _Sizes, world: int, x: Any, y: Any) -> None:
    """Codes at eight positions (in nodes), interpolated bilinearly, into the inputs of the network."""
    u, i = _cell(x, sizes.columns)
    v, j = _cell(y, sizes.rows)
    node = fma(j, splat(f32(sizes.columns)), i)
    codes, stride, row = memory.codes, sizes.codes, sizes.columns * sizes.codes
    first = world * sizes.rows * row
    for c in range(0, sizes.codes, WIDTH):
        columns = transposed(
            _code(codes, first + c + whole(node, 0) * stride, stride, row, spread(u, 0), spread(v, 0)),
            _code(codes, first + c + whole(node, 1) * stride, stride, row, spread(u, 1), spread(v, 1)),
            _code(codes, first + c + whole(node, 2) * stride, stride, row, spread(u, 2), spread(v, 2)),
            _code(codes, first + c + whole(node, 3) * stride, stride, row, spread(u, 3), spread(v, 3)),
            _code(codes, first + c + whole(node, 4) * stride, stride, row, spread(u, 4), spread(v, 4)),
            _code(codes, first + c + whole(node, 5) * stride, stride, row, spread(u, 5), spread(v, 5)),
            _code(codes, first + c + whole(node, 6) * stride, stride, row, spread(u, 6), spread(v, 6)),
            _code(codes, first + c + whole(node, 7) * stride, stride, row, spread(u, 7), spread(v, 7)),
        )
        _store_rows(memory.inputs, (INPUTS + c) * WIDTH, WIDTH, columns)


@inlined
def _cell(x: Any, num_nodes: int) -> Any:
    """Positions of coordinates (in nodes) between two nodes, in [0, 1], and the number of the node below."""
    zero = splat(f32(0))
    # NaN finds a code at the border; its path is NaN already.
    x = at_most(where_less(zero, x, x, zero), splat(f32(num_nodes - 1)))
    below = at_most(floor(x), splat(f32(num_nodes - 2)))
    return x - below, below


@inlined
def _code(codes: Any, first: int, stride: int, row: int, along_x: Any, along_y: Any) -> Any:
    """Eight components of the code between four nodes, of which the lowest is at `first`."""
    low, high = load(codes, first), load(codes, first + row)
    low = fma(load(codes, first + stride) - low, along_x, low)
    high = fma(load(codes, first + row + stride) - high, along_x, high)
    return fma(high - low, along_y, low)
