"""Arrays as short texts for the HTML page, unpacked by `player/parts.js`: displayed values need few digits.

Little endian, row-major, base64.
"""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 2**15 - 1
MISSING = -(2**15)
"""Stands for a value that is not finite."""

Packed = dict[str, Any]


def pack(values: NDArray[np.floating], finest: float) -> Packed:
    """Pack numbers as integer multiples of a step, 16 bits each.

    Args:
        values: of any shape.
        finest: the step, in the unit of the values; it is enlarged if the largest value would not fit.

    Returns:
        `shape`, `step` and `data`; a number times the step is at most half a step from its value.
    """
    finite = np.isfinite(values)
    known = np.where(finite, values, 0.0)
    step = max(finest, float(np.abs(known).max(initial=0.0)) / LARGEST)
    whole = np.where(finite, np.rint(known / step), MISSING)
    return {"shape": list(values.shape), "step": step, "data": _text(whole.astype("<i2"))}


def pack_bits(values: NDArray[np.bool_]) -> Packed:
    """Pack truth values, eight per byte, the first in the highest bit: `shape` and `data`."""
    return {"shape": list(values.shape), "data": _text(np.packbits(values))}


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
