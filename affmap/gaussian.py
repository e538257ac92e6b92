"""Normal distributions with independent coordinates: closed forms (leaf).

All results are in nats, summed over the last axis, constants included.
"""

from __future__ import annotations

import math
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from torch import Tensor

LOG_2_PI = math.log(2 * math.pi)


class Gaussian(NamedTuple):
    """Independent normal distributions of D coordinates."""

    mean: Tensor
    """`[..., D]`"""
    log_std: Tensor
    """`[..., D]`, logarithm of the standard deviation."""


def nll(gaussian: Gaussian, value: Tensor) -> Tensor:
    """Negative log-likelihood of `value` `[..., D]`: `[...]` (Appendix D)."""
    deviation = (value - gaussian.mean) * (-gaussian.log_std).exp()
    return _total(gaussian.log_std + 0.5 * deviation.square() + 0.5 * LOG_2_PI)


def entropy(gaussian: Gaussian) -> Tensor:
    """Differential entropy: `[...]`."""
    return _total(gaussian.log_std + 0.5 * (1 + LOG_2_PI))


def kl(gaussian: Gaussian, other: Gaussian) -> Tensor:
    """Kullback-Leibler divergence of `other` from `gaussian`, D[gaussian || other]: `[...]` (Appendix E)."""
    ratio = 2 * (gaussian.log_std - other.log_std)  # logarithm of the ratio of variances
    deviation = (gaussian.mean - other.mean) * (-other.log_std).exp()
    return 0.5 * _total(ratio.exp() + deviation.square() - 1 - ratio)


def _total(terms: Tensor) -> Tensor:
    """Sum over the coordinates, `[..., D]` -> `[...]`; much faster than `sum` where they are first in memory."""
    return reduce(add, terms.unbind(-1))
