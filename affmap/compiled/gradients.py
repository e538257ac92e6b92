"""Expected free energy and its gradient with respect to actions, by going back along each imagined path.

The same as `affmap.compiled.imagination`, differentiated; autograd on `affmap.model.rollout` is its reference. Vectors
hold eight hidden units of one path, because planners that use gradients follow few paths.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from affmap.compiled.direct import PER_SIDE, PICTURES, PLACES, encode
from affmap.compiled.functions import exp2, log, sigmoid
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, broadcast, fma, keep, load, pointer, splat, store, store_totals
from affmap.compiled.problems import INPUTS, LOG_2_PI_E, Array, Maps, Scenes, Start, Weights
from affmap.compiled.views import paint

f32 = np.float32
LN_2 = f32(np.log(2))


class _Weights(NamedTuple):
    """Addresses of a member's weights, and their sizes."""

    hidden: Any
    output: Any
    bias: Any
    num_blocks: int
    num_inputs: int
    stride: int
    """Numbers from the inputs of a step to those of the next."""


class _Grid(NamedTuple):
    """A member's affordance map."""

    codes: Any
    rows: int
    columns: int
    num_codes: int
    scale_x: f32
    scale_y: f32


class _Sight(NamedTuple):
    """A member's vision model and the world that it sees, with memory for what is between layers."""

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


class _Tape(NamedTuple):
    """What is remembered of a path, for the way back."""

    mean: Any
    """`[H, 2]`"""
    power: Any
    """`[2, H]`, variances of the steps; before, their logarithms to base 2."""
    variance: Any
    """`[2, H]`, of the positions."""
    logarithm: Any
    """`[2, H]`, of the variances."""
    inputs: Any
    """`[H, I]`"""
    hidden: Any
    """`[H, U]`"""
    cell: Any
    """`[H, 2]`, where between the nodes of the map, in [0, 1]; below 0 where no gradient flows."""
    node: Any
    """`[H]`, the node below."""
    slope: Any
    """`[U]`, gradient of the hidden units' inputs."""
    gradient: Any
    """`[I]`, gradient of the inputs, filled up to whole vectors."""


@compiled
def gradients(
    hidden: Array,
    output: Array,
    bias: Array,
    codes: Array,
    scale: Array,
    position: Array,
    delta: Array,
    actions: Array,
    goal: Array,
    goal_std: Array,
    beta: f32,
    through_map: bool,
    result: Array,
    gradient: Array,
) -> None:
    """Write costs of actions `[B, N, H, 4]` into `result` `[B, N]`, and their gradients into `gradient` `[B, N, H, 4]`.

    With `through_map` gradients flow through the map to the positions, too. A path whose first action is not a number
    costs no time: neither is its cost, and its gradient is 0.
    """
    weights, start, desired = Weights(hidden, output, bias), Start(position, delta), (goal, goal_std, beta)
    _gradients(weights, Maps(codes, scale), start, actions, desired, through_map, result, gradient)


@compiled
def gradients_of_views(
    hidden: Array,
    output: Array,
    bias: Array,
    offsets: Array,
    size: Array,
    border_channels: Array,
    circles: Array,
    channels: Array,
    pictures: Array,
    weight2: Array,
    bias2: Array,
    weight3: Array,
    bias3: Array,
    weight4: Array,
    bias4: Array,
    position: Array,
    delta: Array,
    actions: Array,
    goal: Array,
    goal_std: Array,
    beta: f32,
    result: Array,
    gradient: Array,
) -> None:
    """The same with codes of the views at the very positions, through which no gradient flows."""
    weights, start, desired = Weights(hidden, output, bias), Start(position, delta), (goal, goal_std, beta)
    worlds = offsets, size, border_channels, circles, channels
    scenes = Scenes(*worlds, pictures, weight2, bias2, weight3, bias3, weight4, bias4)
    _gradients(weights, scenes, start, actions, desired, False, result, gradient)


@inlined
def _gradients(
    weights: Weights,
    lookup: Any,
    start: Start,
    actions: Array,
    desired: Any,
    through_map: bool,
    result: Array,
    gradient: Array,
) -> None:
    goal, goal_std, beta = desired
    num_problems, num_candidates, horizon, _ = actions.shape
    num_members, num_blocks, num_inputs, _ = weights.hidden.shape
    steps = (horizon + WIDTH - 1) // WIDTH * WIDTH
    filled = (num_inputs - INPUTS + WIDTH - 1) // WIDTH * WIDTH + INPUTS + 2  # whole vectors of four
    buffers = np.zeros(9 * steps + horizon * (filled + (num_blocks + 1) * WIDTH) + filled + WIDTH, f32)
    nodes = np.empty(horizon, np.int64)
    cells = np.empty(2 * horizon, f32)
    units = 9 * steps + horizon * filled
    slope = units + horizon * num_blocks * WIDTH
    tape = _Tape(
        pointer(buffers),
        pointer(buffers[2 * steps :]),
        pointer(buffers[4 * steps :]),
        pointer(buffers[6 * steps :]),
        pointer(buffers[9 * steps :]),
        pointer(buffers[units:]),
        pointer(cells),
        pointer(nodes),
        pointer(buffers[slope:]),
        pointer(buffers[slope + num_blocks * WIDTH :]),
    )
    for b in range(num_problems):
        m = b * num_members // num_problems
        hidden, output, bias = pointer(weights.hidden[m]), pointer(weights.output[m]), pointer(weights.bias[m])
        own = _Weights(hidden, output, bias, num_blocks, num_inputs, filled)
        seen = bound(lookup, b, num_problems)
        std, goal_x, goal_y = goal_std[b], goal[b, 0], goal[b, 1]
        constant = f32(2) * np.log(std) - f32(1) + beta * LOG_2_PI_E
        precision = f32(1) / (std * std)
        factor = f32(0.5) * (beta - f32(1))
        for n in range(num_candidates):
            path = pointer(actions[b, n])
            slopes = pointer(gradient[b, n])
            if np.isnan(path[0]):
                result[b, n] = np.nan
                for k in range(4 * horizon):
                    slopes[k] = f32(0)
                continue
            begin = start.position[b, 0], start.position[b, 1], start.delta[b, 0], start.delta[b, 1]
            _forward(own, seen, tape, path, begin, horizon, steps)
            total = f32(0)
            for t in range(horizon):
                x, y = tape.mean[2 * t] - goal_x, tape.mean[2 * t + 1] - goal_y
                spread = x * x + y * y + tape.variance[t] + tape.variance[steps + t]
                total += f32(0.5) * precision * spread + factor * (tape.logarithm[t] + tape.logarithm[steps + t])
            result[b, n] = total / f32(horizon) + constant
            _backward(own, seen, tape, slopes, goal_x, goal_y, precision, factor, horizon, steps, through_map)
    keep(buffers)
    keep(nodes)
    keep(cells)


def _overloaded(function: Any) -> Any:
    """Declare a function that is compiled according to the kind of look-up."""
    return overload(function, jit_options={"forceinline": True, "error_model": "numpy"}, strict=False)


def bound(lookup: Any, b: int, num_problems: int) -> Any:
    """Return the look-up of problem b."""


def look_up(seen: Any, tape: _Tape, x: f32, y: f32, t: int, inputs: int) -> None:
    """Write the code at a position into the inputs of step t, and remember what its gradient needs."""


def map_slopes(seen: Any, own: _Weights, tape: _Tape, t: int) -> Any:
    """Return gradients of the position that was looked up, from those of its code."""


@_overloaded(bound)
def _bound(lookup: Any, b: Any, num_problems: Any) -> Any:
    if lookup.instance_class is Maps:
        return _grid
    return _sight


@_overloaded(look_up)
def _typed_look_up(seen: Any, tape: Any, x: Any, y: Any, t: Any, inputs: Any) -> Any:
    return _interpolate if seen.instance_class is _Grid else _see


@_overloaded(map_slopes)
def _typed_map_slopes(seen: Any, own: Any, tape: Any, t: Any) -> Any:
    return _grid_slopes if seen.instance_class is _Grid else _no_slopes


def _grid(lookup: Maps, b: int, num_problems: int) -> _Grid:
    num_worlds, rows, columns, num_codes = lookup.codes.shape
    codes = pointer(lookup.codes[b * num_worlds // num_problems])
    return _Grid(codes, rows, columns, num_codes, lookup.scale[0], lookup.scale[1])


def _sight(lookup: Scenes, b: int, num_problems: int) -> _Sight:
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
    return _Sight(
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


def _see(seen: _Sight, tape: _Tape, x: f32, y: f32, t: int, inputs: int) -> None:
    seen.place[0] = min(max(x, f32(0)), seen.size[0])
    seen.place[1] = min(max(y, f32(0)), seen.size[1])
    paint(
        seen.place,
        seen.offsets,
        seen.size,
        seen.border_channel,
        seen.circles,
        seen.channels,
        seen.squares,
        seen.rows,
    )
    pictures, weight2, bias2, weight3, bias3, weight4, bias4 = seen.weights
    between = seen.convolved, seen.features, seen.hidden2, seen.hidden3
    encode(seen.rows, pictures, weight2, bias2, weight3, bias3, weight4, bias4, *between, seen.code)
    for c in range(0, len(seen.code), WIDTH):
        store(tape.inputs, inputs + c, load(seen.code, c))


def _no_slopes(seen: _Sight, own: _Weights, tape: _Tape, t: int) -> Any:
    return f32(0), f32(0)


@inlined
def _forward(own: _Weights, seen: Any, tape: _Tape, path: Any, begin: Any, horizon: int, steps: int) -> None:
    """Imagine a path and remember it; it begins at a position after a change of position."""
    x, y, dx, dy = begin
    outputs = tape.gradient  # free until the way back
    for t in range(horizon):
        inputs = t * own.stride
        tape.inputs[inputs] = dx
        tape.inputs[inputs + 1] = dy
        for k in range(4):
            tape.inputs[inputs + 2 + k] = path[4 * t + k]
        if own.num_inputs > INPUTS:
            look_up(seen, tape, x, y, t, inputs + INPUTS)
        _hidden_units(own, tape, t, inputs)
        _outputs(own, tape, t, outputs)
        dx, dy = outputs[0] + own.bias[0], outputs[1] + own.bias[1]
        x, y = x + dx, y + dy
        tape.mean[2 * t] = x
        tape.mean[2 * t + 1] = y
        tape.power[t] = outputs[2] + own.bias[2]
        tape.power[steps + t] = outputs[3] + own.bias[3]
    for k in range(0, 2 * steps, WIDTH):
        store(tape.power, k, exp2(load(tape.power, k)))
    for d in range(2):
        variance = f32(0)
        for t in range(d * steps, d * steps + horizon):
            variance += tape.power[t]
            tape.variance[t] = variance
    for k in range(0, 2 * steps, WIDTH):
        store(tape.logarithm, k, log(load(tape.variance, k)))


def _interpolate(seen: _Grid, tape: _Tape, x: f32, y: f32, t: int, inputs: int) -> None:
    """The code at a position, between four nodes."""
    u, v = _cell(x * seen.scale_x, seen.columns), _cell(y * seen.scale_y, seen.rows)
    i, j = min(int(u), seen.columns - 2), min(int(v), seen.rows - 2)
    node = (j * seen.columns + i) * seen.num_codes
    tape.node[t] = node
    inside_x, inside_y = f32(0) < u < f32(seen.columns - 1), f32(0) < v < f32(seen.rows - 1)
    u, v = u - f32(i), v - f32(j)
    tape.cell[2 * t] = u if inside_x else -f32(1) - u
    tape.cell[2 * t + 1] = v if inside_y else -f32(1) - v
    along_x, along_y = splat(u), splat(v)
    row = seen.columns * seen.num_codes
    for c in range(node, node + seen.num_codes, WIDTH):
        low, high = load(seen.codes, c), load(seen.codes, c + row)
        low = fma(load(seen.codes, c + seen.num_codes) - low, along_x, low)
        high = fma(load(seen.codes, c + row + seen.num_codes) - high, along_x, high)
        store(tape.inputs, inputs + c - node, fma(high - low, along_y, low))


@inlined
def _cell(x: f32, num_nodes: int) -> f32:
    """A coordinate (in nodes) moved into the map; what is no number, to its border."""
    return min(x, f32(num_nodes - 1)) if x > f32(0) else f32(0)


@inlined
def _hidden_units(own: _Weights, tape: _Tape, t: int, inputs: int) -> None:
    for block in range(own.num_blocks):
        w = block * own.num_inputs * WIDTH
        even = odd = splat(f32(0))  # two sums, because each addition waits for the one before
        for i in range(0, own.num_inputs - 1, 2):
            even = fma(load(own.hidden, w + i * WIDTH), broadcast(tape.inputs, inputs + i), even)
            odd = fma(load(own.hidden, w + (i + 1) * WIDTH), broadcast(tape.inputs, inputs + i + 1), odd)
        if own.num_inputs % 2:
            i = own.num_inputs - 1
            even = fma(load(own.hidden, w + i * WIDTH), broadcast(tape.inputs, inputs + i), even)
        store(tape.hidden, (t * own.num_blocks + block) * WIDTH, sigmoid(even + odd))


@inlined
def _outputs(own: _Weights, tape: _Tape, t: int, outputs: Any) -> None:
    """The four outputs without their bias."""
    a = b = c = d = splat(f32(0))
    for block in range(own.num_blocks):
        unit, v = load(tape.hidden, (t * own.num_blocks + block) * WIDTH), block * 4 * WIDTH
        a = fma(load(own.output, v), unit, a)
        b = fma(load(own.output, v + WIDTH), unit, b)
        c = fma(load(own.output, v + 2 * WIDTH), unit, c)
        d = fma(load(own.output, v + 3 * WIDTH), unit, d)
    store_totals(outputs, 0, a, b, c, d)


@inlined
def _backward(
    own: _Weights,
    seen: Any,
    tape: _Tape,
    slopes: Any,
    goal_x: f32,
    goal_y: f32,
    precision: f32,
    factor: f32,
    horizon: int,
    steps: int,
    through_map: bool,
) -> None:
    """Go back along a path and write the gradient of its cost with respect to its actions."""
    share = f32(1) / f32(horizon)
    # Gradients of the position, of the change of position as the next input, and of the variances.
    x = y = dx = dy = variance_x = variance_y = f32(0)
    gradient = tape.gradient
    for t in range(horizon - 1, -1, -1):
        x += share * precision * (tape.mean[2 * t] - goal_x)
        y += share * precision * (tape.mean[2 * t + 1] - goal_y)
        variance_x += share * (f32(0.5) * precision + factor / tape.variance[t])
        variance_y += share * (f32(0.5) * precision + factor / tape.variance[steps + t])
        _hidden_slopes(
            own,
            tape,
            t,
            splat(x + dx),
            splat(y + dy),
            splat(LN_2 * variance_x * tape.power[t]),
            splat(LN_2 * variance_y * tape.power[steps + t]),
        )
        _input_slopes(own, tape, own.num_inputs if through_map else INPUTS)
        dx, dy = gradient[0], gradient[1]
        for k in range(4):
            slopes[4 * t + k] = gradient[2 + k]
        if through_map:
            along_x, along_y = map_slopes(seen, own, tape, t)
            x += along_x
            y += along_y


@inlined
def _hidden_slopes(own: _Weights, tape: _Tape, t: int, a: Any, b: Any, c: Any, d: Any) -> None:
    """Gradients of the inputs of all hidden units, from those of the four outputs."""
    one, factor = splat(f32(1)), splat(-LN_2)
    for block in range(own.num_blocks):
        v, unit = block * 4 * WIDTH, load(tape.hidden, (t * own.num_blocks + block) * WIDTH)
        slope = load(own.output, v) * a
        slope = fma(load(own.output, v + WIDTH), b, slope)
        slope = fma(load(own.output, v + 2 * WIDTH), c, slope)
        slope = fma(load(own.output, v + 3 * WIDTH), d, slope)
        store(tape.slope, block * WIDTH, slope * factor * unit * (one - unit))


@inlined
def _input_slopes(own: _Weights, tape: _Tape, num_inputs: int) -> None:
    """Gradients of the network's inputs, four at a time."""
    last = (own.num_inputs - 1) * WIDTH
    for i in range(0, num_inputs, 4):
        a = b = c = d = splat(f32(0))
        for block in range(own.num_blocks):
            w, slope = block * own.num_inputs * WIDTH, load(tape.slope, block * WIDTH)
            a = fma(load(own.hidden, w + min(i * WIDTH, last)), slope, a)
            b = fma(load(own.hidden, w + min((i + 1) * WIDTH, last)), slope, b)
            c = fma(load(own.hidden, w + min((i + 2) * WIDTH, last)), slope, c)
            d = fma(load(own.hidden, w + min((i + 3) * WIDTH, last)), slope, d)
        store_totals(tape.gradient, i, a, b, c, d)


def _grid_slopes(seen: _Grid, own: _Weights, tape: _Tape, t: int) -> Any:
    """Gradients of the position that was looked up, from those of its code."""
    u, v = tape.cell[2 * t], tape.cell[2 * t + 1]
    inside_x, inside_y = u >= f32(0), v >= f32(0)
    u, v = u if inside_x else -f32(1) - u, v if inside_y else -f32(1) - v
    node, row, stride = tape.node[t], seen.columns * seen.num_codes, seen.num_codes
    along_x = along_y = f32(0)
    for c in range(own.num_inputs - INPUTS):
        k = node + c
        low, high = seen.codes[k + stride] - seen.codes[k], seen.codes[k + row + stride] - seen.codes[k + row]
        left, right = seen.codes[k + row] - seen.codes[k], seen.codes[k + row + stride] - seen.codes[k + stride]
        slope = tape.gradient[INPUTS + c]
        along_x += slope * (low + v * (high - low))
        along_y += slope * (left + u * (right - left))
    return along_x * seen.scale_x if inside_x else f32(0), along_y * seen.scale_y if inside_y else f32(0)
