"""Context codes -> colours: their first three principal components as red, green and blue (leaf).

Codes of different members mean different things, so each member has a palette of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

PERCENTILES = (1.0, 99.0)
"""Percentiles of a principal component over the sample that become the darkest and brightest values of a channel."""


class Palette(NamedTuple):
    """Principal axes and scale of a sample of codes, which colour any other codes in the same way."""

    mean: Floats
    """`[C]`"""
    basis: Floats
    """`[C, P]` principal axes in columns, P at most 3."""
    low: Floats
    """`[P]`, values that become 0."""
    high: Floats
    """`[P]`, values that become 1; if equal to `low`, the sample does not vary and the channel is 0.5."""

    @classmethod
    def fit(cls, sample: Floats) -> Palette:
        """Fit a palette to a sample of codes `[nodes, C]`.

        The components come from the covariance (float64, largest first); a component's sign is fixed so that its
        loading of largest magnitude is positive. Nodes whose code is not finite are left out; with fewer than two
        others nothing varies.
        """
        values = sample[np.isfinite(sample).all(axis=1)].astype(np.float64)
        if len(values) < 2 or values.shape[1] == 0:
            return cls(np.zeros(values.shape[1]), np.zeros((values.shape[1], 0)), np.zeros(0), np.zeros(0))
        basis = principal_components(values)[:, :3]
        low, high = np.percentile((values - values.mean(axis=0)) @ basis, PERCENTILES, axis=0)
        return cls(values.mean(axis=0), basis, low, np.where(high - low > rounding(values), high, low))

    def __call__(self, codes: Floats) -> Floats:
        """Colours `[..., 3]` in [0, 1] of codes `[..., C]`.

        Missing channels (C < 3), and codes that are not finite, are a neutral 0.5.
        """
        colors = np.full((*codes.shape[:-1], 3), 0.5)
        known = np.isfinite(codes).all(axis=-1, keepdims=True)
        projected = (np.where(known, codes, self.mean) - self.mean) @ self.basis
        varies = self.high > self.low
        scaled = (projected - self.low) / np.where(varies, self.high - self.low, 1.0)
        colors[..., : len(self.low)] = np.where(varies & known, scaled.clip(0.0, 1.0), 0.5)
        return colors


def principal_components(sample: Floats) -> Floats:
    """Principal axes `[C, C]` of `[nodes, C]` in columns, largest variance first, with fixed signs."""
    centered = sample - sample.mean(axis=0)
    _, vectors = np.linalg.eigh(centered.T @ centered / (len(sample) - 1))
    vectors = vectors[:, ::-1]
    largest = np.abs(vectors).argmax(axis=0)
    return vectors * np.sign(vectors[largest, np.arange(vectors.shape[1])])


def rounding(values: Floats) -> float:
    """Largest difference of codes that is rounding of float32."""
    return 1e-6 * max(1.0, float(np.abs(values).max()))
