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


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_codes_that_are_not_finite_are_grey_and_change_no_other_colour(value: float) -> None:
    """The same alone."""
    sample = np.random.default_rng(4).normal(size=(30, 4)).astype(np.float32)
    lost = np.concatenate([sample, np.full((2, 4), value, np.float32)])
    painted = Palette.fit(lost)(lost)
    np.testing.assert_array_equal(painted[:30], Palette.fit(sample)(sample))
    assert (painted[30:] == 0.5).all() and (Palette.fit(lost[30:])(lost[30:]) == 0.5).all()


EVERYWHERE = np.ones((4, 5), dtype=bool)


def paint(codes: np.ndarray, fit: np.ndarray) -> np.ndarray:
    """A map `[Y, X, C]` in the palette of some of its nodes `[Y, X]`."""
    return Palette.fit(codes[fit])(codes)


def test_codes_on_a_line_vary_in_one_channel() -> None:
    """Rank 1: red follows the position on the line from 0 to 1, green and blue are neutral."""
    position = np.linspace(0, 1, 20).reshape(4, 5)
    painted = paint(position[..., None] * np.array([1.0, 2.0, -0.5, 0.2]), EVERYWHERE)
    assert painted[0, 0, 0] == 0.0 and painted[-1, -1, 0] == 1.0
    assert (np.diff(painted[..., 0].ravel()) >= 0).all()
    assert (painted[..., 1:] == 0.5).all()


@pytest.mark.parametrize("context_size", [0, 1, 2, 3, 8])
def test_every_context_size_is_painted_in_the_unit_cube(context_size: int) -> None:
    codes = np.random.default_rng(1).normal(size=(4, 5, context_size)).astype(np.float32)
    painted = paint(codes, EVERYWHERE)
    assert painted.shape == (4, 5, 3)
    assert painted.min() >= 0.0 and painted.max() <= 1.0
    assert (painted[..., context_size:] == 0.5).all(), "channels without a component are neutral"
    assert (painted[..., :context_size].std(axis=(0, 1)) > 0.1).all()


def test_unreachable_nodes_do_not_choose_the_colors() -> None:
    codes = np.random.default_rng(2).normal(size=(4, 5, 3))
    fit = EVERYWHERE.copy()
    fit[0, 0] = False
    outlier = codes.copy()
    outlier[0, 0] = 1e3
    assert paint(outlier, fit)[fit] == pytest.approx(paint(codes, fit)[fit])
