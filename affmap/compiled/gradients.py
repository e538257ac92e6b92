"""Expected free energy and its gradient with respect to actions, by going back along each imagined path.

The same as `affmap.compiled.imagination`, differentiated; autograd on `affmap.model.rollout` is its reference. Vectors
hold eight hidden units of one path, because planners that use gradients follow few paths.
"""

from typing import Any, NamedTuple

import numpy as np

from affmap.compiled.functions import exp2, log, sigmoid
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, broadcast, fma, keep, load, pointer, splat, store, store_totals
from affmap.compiled.lookups import look_up, map_slopes, select
from affmap.compiled.problems import INPUTS, LOG_2_PI_E, Array, Desired, Maps, Scenes, Start, Weights

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


class _Tape(NamedTuple):
    """Records of a path, for the backward pass."""

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
    """`[H, 2]`, position between the nodes of the map, in [0, 1]; below 0 where no gradient flows."""
    node: Any
    """`[H]`, the node below."""
    slope: Any
    """`[U]`, gradient of the hidden units' inputs."""
    gradient: Any
    """`[I]`, gradient of the inputs, padded to whole vectors."""


@compiled
def gradients(
    weights: Weights,
    lookup: Maps | Scenes,
    start: Start,
    actions: Array,
    desired: Desired,
    through_map: bool,
    result: Array,
    gradient: Array,
) -> None:
    """Write costs of actions `[B, N, H, 4]` into `result` `[B, N]`, and their gradients into `gradient` `[B, N, H, 4]`.

    With `through_map` gradients flow through the map to the positions, too; through views they never do. A path whose
    first action is not a number costs no time: neither is its cost, and its gradient is 0.
    """
    goal, goal_std, beta = desired
    num_problems, num_candidates, horizon, _ = actions.shape
    num_members, num_blocks, num_inputs, _ = weights.hidden.shape
    steps = (horizon + WIDTH - 1) // WIDTH * WIDTH
    stride = (num_inputs - INPUTS + WIDTH - 1) // WIDTH * WIDTH + INPUTS + 2  # whole vectors of four
    buffers = np.zeros(9 * steps + horizon * (stride + (num_blocks + 1) * WIDTH) + stride + WIDTH, f32)
    nodes = np.empty(horizon, np.int64)
    cells = np.empty(2 * horizon, f32)
    units = 9 * steps + horizon * stride
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
        own = _Weights(hidden, output, bias, num_blocks, num_inputs, stride)
        source = select(lookup, b, num_problems)
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
            _forward(own, source, tape, path, begin, horizon, steps)
            total = f32(0)
            for t in range(horizon):
                x, y = tape.mean[2 * t] - goal_x, tape.mean[2 * t + 1] - goal_y
                spread = x * x + y * y + tape.variance[t] + tape.variance[steps + t]
                total += f32(0.5) * precision * spread + factor * (tape.logarithm[t] + tape.logarithm[steps + t])
            result[b, n] = total / f32(horizon) + constant
            _backward(own, source, tape, slopes, goal_x, goal_y, precision, factor, horizon, steps, through_map)
    keep(buffers)
    keep(nodes)
    keep(cells)


@inlined
def _forward(own: _Weights, source: Any, tape: _Tape, path: Any, begin: Any, horizon: int, steps: int) -> None:
    """Imagine a path and record it; it begins at a position after a change of position."""
    x, y, dx, dy = begin
    outputs = tape.gradient  # free until the backward pass
    for t in range(horizon):
        inputs = t * own.stride
        tape.inputs[inputs] = dx
        tape.inputs[inputs + 1] = dy
        for k in range(4):
            tape.inputs[inputs + 2 + k] = path[4 * t + k]
        if own.num_inputs > INPUTS:
            look_up(source, tape, x, y, t, inputs + INPUTS)
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
    source: Any,
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
            along_x, along_y = map_slopes(source, own, tape, t)
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
