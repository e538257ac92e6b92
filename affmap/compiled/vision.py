"""The vision model of one member on distinct patches, windows and views, forwards and backwards.

`affmap.model.vision` is its reference. A vector holds features. Rows of views and patches are padded to multiples of
eight; derivatives by the padding are zero.
"""

from typing import Any

import numpy as np

from affmap.compiled.functions import tanh
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, load, splat, store, where_less
from affmap.compiled.layout import NUM_PLACES, NUM_TAPS
from affmap.compiled.product import Matrix, Shape, product

f32 = np.float32


@compiled
def encode(weights: Any, widths: Any, batch: Any, room: Any) -> None:
    """Compute the features of all layers, up to the codes, from the matrices of a member."""
    values, flat = room.values, NUM_PLACES * widths.second
    patches = Matrix(batch.patches.reshape(-1), widths.pixels, 1)
    shape = Shape(len(batch.patches), widths.pixels, WIDTH)
    product(Matrix(room.zeros, 0, 1), patches, weights.conv1, values.patches, shape)
    _pool(values.patches, batch.patch_ids, weights.conv1_bias, values.windows, room.winners)
    _spread(values.windows, batch.taps.reshape(-1), widths, values.columns)
    _layer(values.columns, widths.columns, weights.conv2, weights.conv2_bias, values.second, widths.second)
    _layer(values.second, flat, weights.linear1, weights.linear1_bias, values.hidden, widths.hidden)
    _layer(values.hidden, widths.hidden, weights.linear2, weights.linear2_bias, values.codes, widths.code)


@compiled
def encode_back(turned: Any, widths: Any, batch: Any, room: Any, gradient: Any) -> None:
    """Compute the derivatives by all parameters from those by the codes; `turned` are transposed matrices."""
    values, slopes, zeros, flat = room.values, room.slopes, room.zeros, NUM_PLACES * widths.second
    _layer_back(values.codes, slopes.codes, widths.code, gradient.linear2_bias)
    _weights_back(values.hidden, widths.hidden, slopes.codes, widths.code, zeros, gradient.linear2)
    _inputs_back(slopes.codes, widths.code, turned.linear2, widths.hidden, zeros, slopes.hidden)
    _layer_back(values.hidden, slopes.hidden, widths.hidden, gradient.linear1_bias)
    _weights_back(values.second, flat, slopes.hidden, widths.hidden, zeros, gradient.linear1)
    _inputs_back(slopes.hidden, widths.hidden, turned.linear1, flat, zeros, slopes.second)
    _layer_back(values.second, slopes.second, widths.second, gradient.conv2_bias)
    _weights_back(values.columns, widths.columns, slopes.second, widths.second, zeros, gradient.conv2)
    _inputs_back(slopes.second, widths.second, turned.conv2, widths.columns, zeros, slopes.columns)
    _collect(slopes.columns, room.starts, room.sources, slopes.windows)
    _layer_back(values.windows, slopes.windows, WIDTH, gradient.conv1_bias)
    _pool_back(slopes.windows, batch.patch_ids, room.winners, widths.channels, slopes.patches)
    _weights_back(batch.patches.reshape(-1), widths.pixels, slopes.patches, WIDTH, zeros, gradient.conv1)


@compiled
def find_sources(taps: Any, num_windows: int, widths: Any) -> Any:
    """Return the places of each window among the columns, window by window, and the start of each window's places."""
    starts = np.zeros(num_windows + 1, np.int64)
    flat = taps.reshape(-1)
    for window in flat:
        starts[window + 1] += 1
    for window in range(num_windows):
        starts[window + 1] += starts[window]
    following, places = starts[:-1].copy(), np.empty(len(flat), np.int64)
    for number, window in enumerate(flat):
        places[following[window]] = number // NUM_TAPS * widths.columns + number % NUM_TAPS * widths.channels
        following[window] += 1
    return places, starts


@inlined
def _layer(inputs: Any, num_inputs: int, weights: Any, bias: Any, outputs: Any, num_outputs: int) -> None:
    """An affine map and tanh."""
    shape = Shape(len(outputs) // num_outputs, num_inputs, num_outputs)
    product(Matrix(bias, 0, 1), Matrix(inputs, num_inputs, 1), weights, outputs, shape)
    for place in range(0, len(outputs), WIDTH):
        store(outputs, place, tanh(load(outputs, place)))


@inlined
def _layer_back(outputs: Any, slopes: Any, num_outputs: int, bias: Any) -> None:
    """Take derivatives through tanh, in place; those by the bias are their sums."""
    one = splat(f32(1))
    for column in range(0, num_outputs, WIDTH):
        total = splat(f32(0))
        for place in range(column, len(outputs), num_outputs):
            value = load(outputs, place)
            slope = load(slopes, place) * (one - value * value)
            store(slopes, place, slope)
            total = total + slope
        store(bias, column, total)


@inlined
def _weights_back(inputs: Any, num_inputs: int, slopes: Any, num_outputs: int, zeros: Any, gradient: Any) -> None:
    """Derivatives by the transposed weights of a layer."""
    shape = Shape(num_outputs, len(slopes) // num_outputs, num_inputs)
    product(Matrix(zeros, 0, 1), Matrix(slopes, 1, num_outputs), inputs, gradient, shape)


@inlined
def _inputs_back(slopes: Any, num_outputs: int, turned: Any, num_inputs: int, zeros: Any, result: Any) -> None:
    """Derivatives by the inputs of a layer."""
    shape = Shape(len(slopes) // num_outputs, num_outputs, num_inputs)
    product(Matrix(zeros, 0, 1), Matrix(slopes, num_outputs, 1), turned, result, shape)


@inlined
def _pool(patches: Any, patch_ids: Any, bias: Any, windows: Any, winners: Any) -> None:
    """Take the largest of the nine patches of each window, and note its index; then bias and tanh."""
    for window in range(len(patch_ids)):
        best, winner = load(patches, patch_ids[window, 0] * WIDTH), splat(f32(0))
        for number in range(1, NUM_TAPS):
            value = load(patches, patch_ids[window, number] * WIDTH)
            winner = where_less(best, value, splat(f32(number)), winner)
            best = where_less(best, value, value, best)
        store(windows, window * WIDTH, tanh(best + load(bias, 0)))
        store(winners, window * WIDTH, winner)


@inlined
def _pool_back(slopes: Any, patch_ids: Any, winners: Any, channels: int, patches: Any) -> None:
    """Give the derivatives of windows to those patches that were the largest."""
    for place in range(0, len(patches), WIDTH):
        store(patches, place, splat(f32(0)))
    for window in range(len(patch_ids)):
        for channel in range(channels):
            place = window * WIDTH + channel
            patches[patch_ids[window, int(winners[place])] * WIDTH + channel] += slopes[place]


@inlined
def _spread(windows: Any, taps: Any, widths: Any, columns: Any) -> None:
    """Write the windows of each place side by side.

    A vector holds more than the channels of a window. The next one overwrites the rest; that of the last one fills the
    row up, and is tanh(0).
    """
    number = 0
    for row in range(0, len(columns), widths.columns):
        for tap in range(NUM_TAPS):
            store(columns, row + tap * widths.channels, load(windows, taps[number] * WIDTH))
            number += 1


@inlined
def _collect(columns: Any, starts: Any, sources: Any, windows: Any) -> None:
    """Sums over all places where a window stands; beyond its channels they are undefined, and not read.

    Each grows in registers: the many of a blank window would wait for each other in memory.
    """
    for window in range(len(starts) - 1):
        even, odd = splat(f32(0)), splat(f32(0))
        first, end = starts[window], starts[window + 1]
        for number in range(first, end - 1, 2):
            even = even + load(columns, sources[number])
            odd = odd + load(columns, sources[number + 1])
        if (end - first) % 2:
            even = even + load(columns, sources[end - 1])
        store(windows, window * WIDTH, even + odd)
