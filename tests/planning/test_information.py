"""Information: against integrals on a grid, NumPy's deviations, and limits that have closed forms."""

import math

import numpy as np
import torch
from numpy.testing import assert_allclose

from affmap.gaussian import Gaussian
from affmap.planning import information


def committee(means: list[tuple[float, float]], stds: list[tuple[float, float]]) -> Gaussian:
    """K Gaussians of two coordinates."""
    return Gaussian(torch.tensor(means, dtype=torch.float64), torch.tensor(stds, dtype=torch.float64).log())


def test_the_information_is_a_bound_of_the_divergence_of_jensen_and_shannon_on_a_grid() -> None:
    """Overlaps, integrals of the square root of two densities, and entropies by sums over 800 x 800 points."""
    means, stds = [(0.0, 0.1), (0.5, -0.2), (-0.3, 0.4)], [(0.3, 0.5), (0.2, 0.6), (0.7, 0.25)]
    axis = np.linspace(-6, 6, 801)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    densities = [
        np.exp(-0.5 * (((x - mx) / sx) ** 2 + ((y - my) / sy) ** 2)) / (2 * np.pi * sx * sy)
        for (mx, my), (sx, sy) in zip(means, stds, strict=True)
    ]

    def integral(density: np.ndarray) -> float:
        return density.sum() * (axis[1] - axis[0]) ** 2

    def entropy(density: np.ndarray) -> float:
        return -integral(density * np.log(density + 1e-300))

    overlaps = [[integral(np.sqrt(one * other)) for other in densities] for one in densities]
    found = float(information.information(committee(means, stds)))
    assert_allclose(found, -np.log(np.mean(overlaps, axis=1)).mean(), rtol=1e-6)
    assert 0 < found < entropy(np.mean(densities, axis=0)) - np.mean([entropy(each) for each in densities])


def test_the_information_is_0_where_all_agree_and_the_logarithm_of_their_number_where_none_do() -> None:
    """Limits; however large the deviation is, those who agree about it have nothing to learn."""
    same = committee([(0.3, 0.2)] * 5, [(1.4, 1.4)] * 5)
    apart = committee([(100.0 * k, 0.0) for k in range(5)], [(0.5, 0.5)] * 5)
    assert_allclose(information.information(same), 0, atol=1e-12)
    assert_allclose(information.information(apart), math.log(5), rtol=1e-12)


def test_there_is_information_where_one_model_is_uncertain() -> None:
    """Four narrow Gaussians and a wide one, whose overlap in two coordinates is 2 s t / (s**2 + t**2), by hand."""
    narrow, wide = 0.01, 1.4
    overlap = 2 * narrow * wide / (narrow**2 + wide**2)
    expected = -(4 * math.log((4 + overlap) / 5) + math.log((1 + 4 * overlap) / 5)) / 5
    found = information.information(committee([(0.0, 0.0)] * 5, [(narrow, narrow)] * 4 + [(wide, wide)]))
    assert_allclose(found, expected, rtol=1e-9)


def test_disagreement_and_deviation_are_numpy_s() -> None:
    means, log_stds = torch.randn(2, 4, 3, 6, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    found = Gaussian(means, log_stds)
    assert_allclose(information.disagreement(found), means.numpy().std(axis=0).mean(-1))
    assert_allclose(information.deviation(found), np.exp(log_stds.numpy()).mean((0, -1)))


def test_changes_add_up_to_the_path() -> None:
    """Means and variances of steps, summed, are those of positions again, as in `affmap.model.rollout`."""
    rng = torch.Generator().manual_seed(1)
    steps, stds = torch.randn(2, 3, 7, 2, generator=rng, dtype=torch.float64)
    start, variance = torch.randn(3, 2, generator=rng, dtype=torch.float64), stds.square()
    path = Gaussian(start[:, None] + steps.cumsum(1), 0.5 * variance.cumsum(1).log())
    found = information.changes(path, start, 0.1)
    assert_allclose(found.mean, steps)
    assert_allclose((2 * found.log_std).exp(), variance + 0.01)
