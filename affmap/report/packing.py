"""Arrays as short texts, for the page, whose `player/parts.js` unpacks them: what is only shown needs few digits.

All is little endian, in the order of rows, and base64.
"""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 2**15 - 1
MISSING = -(2**15)
"""Stands for what is no finite number."""

Packed = dict[str, Any]


def pack(values: NDArray[np.floating], finest: float) -> Packed:
    """Numbers as whole multiples of a step, in 16 bits each.

    Args:
        values: of any shape.
        finest: the step, in the unit of the values; larger where the largest of them would not fit.

    Returns:
        `shape`, `step` and `data`; a number times the step is at most half a step from its value.
    """
    finite = np.isfinite(values)
    known = np.where(finite, values, 0.0)
    step = max(finest, float(np.abs(known).max(initial=0.0)) / LARGEST)
    whole = np.where(finite, np.rint(known / step), MISSING)
    return {"shape": list(values.shape), "step": step, "data": _text(whole.astype("<i2"))}


def pack_bits(values: NDArray[np.bool_]) -> Packed:
    """Truth values, eight a byte, the first one in the highest bit: `shape` and `data`."""
    return {"shape": list(values.shape), "data": _text(np.packbits(values))}


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
