"""Colours of context codes: against the singular value decomposition, and against themselves in another sample."""

import numpy as np
import pytest

from affmap.model.palette import Palette, principal_components


def test_principal_components_are_the_singular_vectors() -> None:
    sample = np.random.default_rng(0).normal(size=(200, 5)) * (3.0, 1.0, 0.3, 2.0, 0.1)
    basis = principal_components(sample)
    reference = np.linalg.svd(sample - sample.mean(axis=0), full_matrices=False)[2].T
    assert np.abs(np.sum(basis * reference, axis=0)) == pytest.approx(np.ones(5)), "the same axes up to signs"
    assert (basis[np.abs(basis).argmax(axis=0), np.arange(5)] > 0).all(), "the largest loading is positive"


def test_a_palette_paints_equal_codes_alike_wherever_they_are() -> None:
    """Fitted to one sample, it paints a part of it, and single codes, as it paints the whole."""
    sample = np.random.default_rng(1).normal(size=(60, 4)).astype(np.float32)
    palette = Palette.fit(sample)
    painted = palette(sample)
    np.testing.assert_array_equal(palette(sample[:10].reshape(2, 5, 4)), painted[:10].reshape(2, 5, 3))
    np.testing.assert_array_equal(palette(sample[7]), painted[7])
    assert painted.std(axis=0).min() > 0.1


@pytest.mark.parametrize("sample", [np.zeros((5, 3)), np.ones((1, 3)), np.zeros((5, 0)), np.zeros((0, 2))])
def test_what_does_not_vary_is_grey(sample: np.ndarray) -> None:
    assert (Palette.fit(sample)(np.random.default_rng(0).normal(size=(4, sample.shape[1]))) == 0.5).all()
