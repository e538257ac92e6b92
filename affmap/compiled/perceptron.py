"""The transition model of one member on samples, its loss, and both backwards.

`MLP.unroll` and `affmap.gaussian.nll` are its reference. Samples are ordered by the views that they show:
the share of a code in the hidden units is computed once a view. A vector holds features.
"""

from typing import Any

import numpy as np

from affmap.compiled.functions import exp2, tanh
from affmap.compiled.jit import compiled
from affmap.compiled.lanes import WIDTH, load, splat, store
from affmap.compiled.layout import NUM_INPUTS, NUM_OUTPUTS
from affmap.compiled.product import Matrix, Shape, product

f32 = np.float32
LOG2_E = f32(1.4426950408889634)


@compiled
def predict(weights: Any, widths: Any, batch: Any, room: Any) -> None:
    """Compute hidden units and outputs from inputs and codes, with the matrices of a member."""
    values, nothing, units, rows = room.values, Matrix(room.zeros, 0, 1), widths.units, len(batch.inputs)
    if widths.code:
        shape = Shape(len(values.shares) // units, widths.code, units)
        product(nothing, Matrix(values.codes, widths.code, 1), weights.hidden[WIDTH * units :], values.shares, shape)
    inputs = Matrix(batch.inputs.reshape(-1), WIDTH, 1)
    product(nothing, inputs, weights.hidden, values.units, Shape(rows, NUM_INPUTS, units))
    for view in range(len(batch.starts) - 1):
        for unit in range(0, units, WIDTH):
            share = load(values.shares, view * units + unit)
            for place in range(batch.starts[view] * units + unit, batch.starts[view + 1] * units, units):
                store(values.units, place, tanh(load(values.units, place) + share))
    bias = Matrix(weights.output_bias, 0, 1)
    product(bias, Matrix(values.units, units, 1), weights.output, values.outputs, Shape(rows, units, WIDTH))


@compiled
def loss(targets: Any, outputs: Any, slopes: Any) -> float:
    """The mean negative log-likelihood of scaled targets, without its constant; its derivatives go into `slopes`."""
    for sample in range(len(targets)):
        place = sample * WIDTH
        store(slopes, place, exp2(load(outputs, place) * splat(-LOG2_E)))  # 1 / standard deviation
    total, share = 0.0, f32(1 / len(targets))
    for sample in range(len(targets)):
        for coordinate in range(2):
            mean = sample * WIDTH + coordinate
            log_std = mean + 2
            inverse = slopes[log_std]
            deviation = (targets[sample, coordinate] - outputs[mean]) * inverse
            total += outputs[log_std] + f32(0.5) * deviation * deviation
            slopes[mean] = -share * deviation * inverse
            slopes[log_std] = share * (f32(1) - deviation * deviation)
        for filling in range(NUM_OUTPUTS, WIDTH):
            slopes[sample * WIDTH + filling] = f32(0)
    return total / len(targets)


@compiled
def predict_back(turned: Any, widths: Any, batch: Any, room: Any, gradient: Any) -> None:
    """Compute the derivatives by all parameters, and by the codes, from those by the outputs."""
    values, slopes, nothing = room.values, room.slopes, Matrix(room.zeros, 0, 1)
    code, units, rows, views = widths.code, widths.units, len(batch.inputs), len(values.shares) // widths.units
    total, one = splat(f32(0)), splat(f32(1))
    for place in range(0, len(slopes.outputs), WIDTH):
        total = total + load(slopes.outputs, place)
    store(gradient.output_bias, 0, total)
    product(nothing, Matrix(slopes.outputs, 1, WIDTH), values.units, gradient.output, Shape(WIDTH, rows, units))
    product(nothing, Matrix(slopes.outputs, WIDTH, 1), turned.output, slopes.units, Shape(rows, NUM_OUTPUTS, units))
    for view in range(len(batch.starts) - 1):
        for unit in range(0, units, WIDTH):
            total = splat(f32(0))
            for place in range(batch.starts[view] * units + unit, batch.starts[view + 1] * units, units):
                value = load(values.units, place)
                slope = load(slopes.units, place) * (one - value * value)
                store(slopes.units, place, slope)
                total = total + slope
            store(slopes.shares, view * units + unit, total)
    inputs = batch.inputs.reshape(-1)
    product(nothing, Matrix(slopes.units, 1, units), inputs, gradient.hidden, Shape(units, rows, WIDTH))
    if code:
        shares, further = slopes.shares, WIDTH * units
        product(nothing, Matrix(shares, 1, units), values.codes, gradient.hidden[further:], Shape(units, views, code))
        product(nothing, Matrix(shares, units, 1), turned.hidden[further:], slopes.codes, Shape(views, units, code))
