"""Places of a model's parameters in the matrices that compiled loops multiply.

A layer is a matrix `[inputs, outputs]`; the transposed one takes gradients back. Features are padded with zeros to
multiples of eight, the length of a vector.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

WIDTH = 8
"""Floats of a vector, as in `affmap.compiled.lanes`, which needs numba."""

NUM_INPUTS, NUM_OUTPUTS = 6, 4
"""Inputs of the perceptron before the code (change of position, throttles); outputs (means, log-deviations)."""

NUM_TAPS, NUM_PLACES = 9, 4
"""Sizes of a 3 x 3 convolution: inputs of a place, places on 4 x 4 windows."""


class Widths(NamedTuple):
    """Features of each layer, padded to multiples of eight except for `channels`."""

    pixels: int
    """Pixels of a patch, all channels of the view together."""
    channels: int
    """q, channels of the first convolution, at most 8; padded they are a vector."""
    columns: int
    """Inputs of the second convolution at one place: its 9 taps of q channels."""
    second: int
    """Channels of the second convolution."""
    hidden: int
    """Outputs of the first linear layer."""
    code: int
    """The context code; 0: there is no vision model."""
    units: int
    """Hidden units of the perceptron."""


class Parameters(NamedTuple):
    """A flat array for each parameter, or `[M, numbers]`; those of the vision model are empty if there is none."""

    hidden: Any
    """Weights of the perceptron's inputs, then those of the code."""
    output: Any
    output_bias: Any
    conv1: Any
    conv1_bias: Any
    conv2: Any
    conv2_bias: Any
    linear1: Any
    linear1_bias: Any
    linear2: Any
    linear2_bias: Any


class Layout(NamedTuple):
    """Places of a member's parameters."""

    widths: Widths
    straight: Parameters
    """The place of each number in its matrix `[inputs, outputs]`."""
    turned: Parameters
    """The place of each number in the transposed matrix."""
    sizes: Parameters
    """Sizes of the matrices, numbers in place of arrays."""


def layout(pixels: int, channels: int, hidden: int, code: int, units: int) -> Layout:
    """The layout of models with given numbers of features."""
    q, second = channels, round_up(2 * channels)
    widths = Widths(
        round_up(pixels), q, round_up(NUM_TAPS * q), second, round_up(hidden), round_up(code), round_up(units)
    )
    parts = [_perceptron_inputs(code, units), _matrix(*np.indices((units, NUM_OUTPUTS))), _bias(NUM_OUTPUTS)]
    if code:
        channel, pixel = np.indices((q, pixels))
        output, source, tap = np.indices((2 * q, q, NUM_TAPS))
        kind, place, unit = np.indices((2 * q, NUM_PLACES, hidden))
        parts += [_matrix(pixel, channel), _bias(q)]
        parts += [_matrix(tap * q + source, output), _bias(2 * q)]
        parts += [_matrix(place * second + kind, unit), _bias(hidden)]
        parts += [_matrix(*np.indices((hidden, code))), _bias(code)]
    nothing = (np.empty(0, np.int64), np.empty(0, np.int64), 0)
    parts += [nothing] * (len(Parameters._fields) - len(parts))
    straight, turned, sizes = zip(*parts, strict=True)
    return Layout(widths, Parameters(*straight), Parameters(*turned), Parameters(*sizes))


def round_up(count: int) -> int:
    """The next multiple of eight."""
    return -(-count // WIDTH) * WIDTH


Places = tuple[NDArray[np.int64], NDArray[np.int64], int]
"""Places of a parameter's numbers in the matrix, in the transposed one, and the size of both."""


def _matrix(inputs: NDArray[np.int64], outputs: NDArray[np.int64]) -> Places:
    """The places of weights that connect these inputs and outputs."""
    rows, columns = round_up(inputs.max() + 1), round_up(outputs.max() + 1)
    return (inputs * columns + outputs).ravel(), (outputs * rows + inputs).ravel(), rows * columns


def _bias(outputs: int) -> Places:
    return np.arange(outputs), np.arange(outputs), round_up(outputs)


def _perceptron_inputs(code: int, units: int) -> Places:
    """Two matrices, one behind the other: of the inputs, and of the code."""
    inputs, outputs = np.indices((NUM_INPUTS, units))
    straight, turned, size = _matrix(inputs, outputs)
    if code:
        further, further_turned, more = _matrix(*np.indices((code, units)))
        straight, turned = np.append(straight, size + further), np.append(turned, size + further_turned)
        size += more
    return straight, turned, size
