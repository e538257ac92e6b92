"""The vision model in one pass over each view: position -> pixels as bits -> context code.

The reference is `affmap.view` with `affmap.model.vision`. The first convolution is read from a table: a channel of its
kernel sees 3 x 3 pixels, which can be 512 different pictures. Codes differ from PyTorch's by the rounding of another
order of additions, and do not depend on other look-ups.
"""

import numpy as np

from affmap.compiled.functions import tanh
from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, at_least, fma, load, splat, store
from affmap.compiled.views import paint

PICTURES = 512
"""Number of pictures of 3 x 3 pixels; pixel n is bit n."""

PLACES, PER_SIDE = 9, 4
"""Along a view's side: of the first convolution's kernel, and of the windows that are pooled."""


@inlined
def _dense(inputs: np.ndarray, num_inputs: int, weight: np.ndarray, bias: np.ndarray, outputs: np.ndarray) -> None:
    """The tanh of an affine map with `weight` `[num_inputs * outputs]`; the number of inputs is a multiple of 4."""
    num_outputs = len(bias)
    for output in range(0, num_outputs, WIDTH):
        a, b, c, d = load(bias, output), splat(np.float32(0)), splat(np.float32(0)), splat(np.float32(0))
        for number in range(0, num_inputs, 4):  # four sums, none of which waits for another
            place = number * num_outputs + output
            a = fma(splat(inputs[number]), load(weight, place), a)
            b = fma(splat(inputs[number + 1]), load(weight, place + num_outputs), b)
            c = fma(splat(inputs[number + 2]), load(weight, place + 2 * num_outputs), c)
            d = fma(splat(inputs[number + 3]), load(weight, place + 3 * num_outputs), d)
        store(outputs, output, tanh((a + b) + (c + d)))


@inlined
def _convolve(rows: np.ndarray, row: int, pictures: np.ndarray, convolved: np.ndarray) -> None:
    """The first convolution along a row of a view: `[9 * 8]`."""
    seven = np.uint64(7)
    for place in range(PLACES):
        shift = np.uint64(place)
        total = splat(np.float32(0))
        for channel in range(len(rows)):
            picture = rows[channel, row] >> shift & seven
            picture |= (rows[channel, row + 1] >> shift & seven) << np.uint64(3)
            picture |= (rows[channel, row + 2] >> shift & seven) << np.uint64(6)
            total = total + load(pictures, (channel * PICTURES + np.int64(picture)) * WIDTH)
        store(convolved, place * WIDTH, total)


@inlined
def _pool(
    rows: np.ndarray, pictures: np.ndarray, num_features: int, convolved: np.ndarray, features: np.ndarray
) -> None:
    """The first convolution's largest values in 4 x 4 windows of 3 x 3 places: `[16 * q]`, before tanh."""
    for number in range(PLACES):
        _convolve(rows, number, pictures, convolved)
        for column in range(PER_SIDE):
            place = 2 * column * WIDTH
            most = at_least(load(convolved, place), load(convolved, place + WIDTH))
            most = at_least(most, load(convolved, place + 2 * WIDTH))
            # Every other row ends one window and begins the next.
            for window in range(max(0, (number - 1) // 2), min(PER_SIDE - 1, number // 2) + 1):
                first = (window * PER_SIDE + column) * WIDTH
                store(features, first, most if number == 2 * window else at_least(most, load(features, first)))
    for window in range(PER_SIDE * PER_SIDE):  # the lanes beyond q make room
        store(features, window * num_features, load(features, window * WIDTH))


@inlined
def encode(
    rows: np.ndarray,
    pictures: np.ndarray,
    weight2: np.ndarray,
    bias2: np.ndarray,
    weight3: np.ndarray,
    bias3: np.ndarray,
    weight4: np.ndarray,
    bias4: np.ndarray,
    convolved: np.ndarray,
    features: np.ndarray,
    hidden2: np.ndarray,
    hidden3: np.ndarray,
    code: np.ndarray,
) -> None:
    """One member's code of the view in `rows` `[K, 11]`; its weights flat, and buffers between layers."""
    num_features = len(bias2) // 8
    _pool(rows, pictures, num_features, convolved, features)
    for first in range(0, PER_SIDE**2 * num_features, WIDTH):
        store(features, first, tanh(load(features, first)))
    _dense(features, PER_SIDE**2 * num_features, weight2, bias2, hidden2)
    _dense(hidden2, len(hidden2), weight3, bias3, hidden3)
    _dense(hidden3, len(hidden3), weight4, bias4, code)


@compiled
def codes_at(
    offsets: np.ndarray,
    size: np.ndarray,
    border_channel: int,
    circles: np.ndarray,
    channels: np.ndarray,
    pictures: np.ndarray,
    weight2: np.ndarray,
    bias2: np.ndarray,
    weight3: np.ndarray,
    bias3: np.ndarray,
    weight4: np.ndarray,
    bias4: np.ndarray,
    positions: np.ndarray,
    codes: np.ndarray,
) -> None:
    """Write the codes `[M, P, C]` of the views at each member's `positions` `[M, P, 2]` (u).

    Positions outside of the arena count as the nearest ones inside it. The first arguments are those of a
    `affmap.view.LayoutArrays`, the next ones those of `affmap.model.direct.Weights`.
    """
    rows, squares = np.empty((pictures.shape[1] // PICTURES, len(offsets)), np.uint64), np.empty_like(offsets)
    place, code = np.empty_like(size), np.empty_like(bias4[0])
    convolved, features = np.empty(PLACES * WIDTH, np.float32), np.empty((PER_SIDE**2 + 1) * WIDTH, np.float32)
    hidden2, hidden3 = np.empty_like(bias2[0]), np.empty_like(bias3[0])
    for member in range(len(positions)):
        flat = pictures[member].reshape(-1)
        flat2, flat3, flat4 = weight2[member].reshape(-1), weight3[member].reshape(-1), weight4[member].reshape(-1)
        own2, own3, own4 = bias2[member], bias3[member], bias4[member]
        for number in range(positions.shape[1]):
            for axis in range(2):
                place[axis] = positions[member, number, axis]
                if place[axis] < 0:
                    place[axis] = 0
                elif place[axis] > size[axis]:
                    place[axis] = size[axis]
            paint(place, offsets, size, border_channel, circles, channels, squares, rows)
            encode(rows, flat, flat2, own2, flat3, own3, flat4, own4, convolved, features, hidden2, hidden3, code)
            for component in range(codes.shape[2]):
                codes[member, number, component] = code[component]


@compiled
def codes_of(
    pictures: np.ndarray,
    weight2: np.ndarray,
    bias2: np.ndarray,
    weight3: np.ndarray,
    bias3: np.ndarray,
    weight4: np.ndarray,
    bias4: np.ndarray,
    views: np.ndarray,
    codes: np.ndarray,
) -> None:
    """Write the codes `[M, P, C]` of each member's `views` `[M, P, K, 11, 11]` bool; otherwise as `codes_at`."""
    rows, code = np.empty(views.shape[2:4], np.uint64), np.empty_like(bias4[0])
    convolved, features = np.empty(PLACES * WIDTH, np.float32), np.empty((PER_SIDE**2 + 1) * WIDTH, np.float32)
    hidden2, hidden3 = np.empty_like(bias2[0]), np.empty_like(bias3[0])
    for member in range(len(views)):
        flat = pictures[member].reshape(-1)
        flat2, flat3, flat4 = weight2[member].reshape(-1), weight3[member].reshape(-1), weight4[member].reshape(-1)
        own2, own3, own4 = bias2[member], bias3[member], bias4[member]
        for number in range(views.shape[1]):
            rows[:] = 0
            for channel in range(views.shape[2]):
                for row in range(views.shape[3]):
                    for column in range(views.shape[4]):
                        pixel = views[member, number, channel, row, column]
                        rows[channel, row] |= np.uint64(pixel) << np.uint64(column)
            encode(rows, flat, flat2, own2, flat3, own3, flat4, own4, convolved, features, hidden2, hidden3, code)
            for component in range(codes.shape[2]):
                codes[member, number, component] = code[component]
