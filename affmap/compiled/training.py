"""Losses and updates of a stack on a batch, one member after the other, so that each stays in the caches.

`TrainingModule` with PyTorch's autograd and Adam is the reference.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from affmap.compiled.adam import Adam, clip, descend
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH
from affmap.compiled.layout import NUM_PLACES, Layout, Parameters
from affmap.compiled.perceptron import loss, predict, predict_back
from affmap.compiled.samples import Samples
from affmap.compiled.vision import encode, encode_back, find_sources

f32 = np.float32
NUM_TRANSITION = 3
"""Parameters of the transition model, which come first."""


class Features(NamedTuple):
    """The features of all layers of a member, or derivatives by them, in the order in which they are computed."""

    patches: Any
    windows: Any
    columns: Any
    second: Any
    hidden: Any
    codes: Any
    shares: Any
    units: Any
    outputs: Any


class Room(NamedTuple):
    """Memory for a member's pass."""

    values: Features
    slopes: Features
    winners: Any
    """Index of the largest patch of each window."""
    sources: Any
    """Index of each window among the columns."""
    starts: Any
    """Start of each window's places in `sources`."""
    zeros: Any
    """Zeros, for sums without a start value."""


@compiled
def losses(weights: Parameters, layout: Layout, batch: Samples, result: NDArray[np.float32]) -> None:
    """Write the mean negative log-likelihoods of members into `result` `[M]`: nats of scaled changes, no constants."""
    widths, own, room = layout.widths, _matrices(layout.sizes), _room(layout.widths, batch)
    for member in range(len(result)):
        _place(weights, member, layout.straight, own)
        if widths.code:
            encode(own, widths, batch, room)
        predict(own, widths, batch, room)
        result[member] = loss(batch.targets, room.values.outputs, room.slopes.outputs)


@compiled
def update(
    weights: Parameters,
    means: Parameters,
    squares: Parameters,
    layout: Layout,
    batch: Samples,
    adam: Adam,
    result: NDArray[np.float32],
) -> None:
    """Make an update of each member, of its weights and of Adam's moments; `result` is that of `losses` before it."""
    widths, room, slope = layout.widths, _room(layout.widths, batch), np.zeros(sum(layout.sizes) + WIDTH, f32)
    own, turned, gradient = _matrices(layout.sizes), _matrices(layout.sizes), _matrices(layout.sizes)
    for member in range(len(result)):
        _place(weights, member, layout.straight, own)
        _place(weights, member, layout.turned, turned)
        if widths.code:
            encode(own, widths, batch, room)
        predict(own, widths, batch, room)
        result[member] = loss(batch.targets, room.values.outputs, room.slopes.outputs)
        predict_back(turned, widths, batch, room, gradient)
        if widths.code:
            encode_back(turned, widths, batch, room, gradient)
        for part in range(2):
            first, end = part * NUM_TRANSITION, NUM_TRANSITION if part == 0 else len(weights)
            clip(slope, _take(gradient, layout.turned, first, end, slope), adam.max_norms[part][member])
            start = 0
            for number in range(first, end):
                weight, mean, square = weights[number][member], means[number][member], squares[number][member]
                descend(weight, mean, square, slope, start, adam.rates[part], adam)
                start += len(weight)


@inlined
def _room(widths: Any, batch: Samples) -> Room:
    winners, zeros = np.zeros(len(batch.patch_ids) * WIDTH, f32), np.zeros(NUM_PLACES * max(widths), f32)
    sources, starts = find_sources(batch.taps, len(batch.patch_ids), widths)
    return Room(_features(widths, batch), _features(widths, batch), winners, sources, starts, zeros)


@inlined
def _features(widths: Any, batch: Samples) -> Features:
    views, samples = len(batch.taps), len(batch.inputs)
    return Features(
        patches=np.zeros(len(batch.patches) * WIDTH, f32),
        windows=np.zeros(len(batch.patch_ids) * WIDTH, f32),
        columns=np.zeros(NUM_PLACES * views * widths.columns, f32),
        second=np.zeros(NUM_PLACES * views * widths.second, f32),
        hidden=np.zeros(views * widths.hidden, f32),
        codes=np.zeros(views * widths.code, f32),
        shares=np.zeros(views * widths.units, f32),
        units=np.zeros(samples * widths.units, f32),
        outputs=np.zeros(samples * WIDTH, f32),
    )


@inlined
def _matrices(sizes: Any) -> Parameters:
    return Parameters(
        hidden=np.zeros(sizes.hidden, f32),
        output=np.zeros(sizes.output, f32),
        output_bias=np.zeros(sizes.output_bias, f32),
        conv1=np.zeros(sizes.conv1, f32),
        conv1_bias=np.zeros(sizes.conv1_bias, f32),
        conv2=np.zeros(sizes.conv2, f32),
        conv2_bias=np.zeros(sizes.conv2_bias, f32),
        linear1=np.zeros(sizes.linear1, f32),
        linear1_bias=np.zeros(sizes.linear1_bias, f32),
        linear2=np.zeros(sizes.linear2, f32),
        linear2_bias=np.zeros(sizes.linear2_bias, f32),
    )


@inlined
def _place(weights: Parameters, member: int, places: Parameters, matrices: Parameters) -> None:
    """Write the weights of a member into matrices."""
    for number in range(len(places)):
        source, target, own = weights[number], matrices[number], places[number]
        for i in range(len(own)):
            target[own[i]] = source[member, i]


@inlined
def _take(matrices: Parameters, places: Parameters, first: int, end: int, result: Any) -> int:
    """Read parameters `first` to `end` from matrices, one after the other; zeros follow. Return how many numbers."""
    count = 0
    for number in range(first, end):
        matrix, own = matrices[number], places[number]
        for i in range(len(own)):
            result[count + i] = matrix[own[i]]
        count += len(own)
    for i in range(count, count + WIDTH):
        result[i] = f32(0)
    return count
