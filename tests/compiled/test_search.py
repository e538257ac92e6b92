"""Drawing and learning in compiled loops against PyTorch's, and the whole method with either."""

import numpy as np
import pytest
import torch

from affmap import compiled
from affmap.compiled.search import draw, learn
from affmap.planning.cem import CEMPlanner, truncated_normal

B, N, K = 6, 9, 2


def normal(length: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Means (some at 0 or 1), variances (some 0), kept candidates and uniform numbers."""
    generator = torch.Generator().manual_seed(seed)
    mean, variance = torch.rand(B, length, generator=generator), torch.rand(B, length, generator=generator) ** 4
    mean[0], mean[1], variance[2], variance[3] = 0, 1, 0, 1e-6
    uniform = torch.rand(B, N, length, generator=generator) * 0.999 + 0.0005
    return mean, variance, torch.rand(B, K, length, generator=generator), uniform


@pytest.mark.parametrize("length", [4, 8, 12, 80])
def test_draws(length: int) -> None:
    mean, variance, kept, uniform = normal(length)
    candidates = np.full((B, K + N, length), np.nan, np.float32)
    draw(mean.numpy(), variance.numpy(), kept.numpy(), uniform.numpy(), candidates)
    expected = truncated_normal(mean[:, None].double(), variance[:, None].double().sqrt(), uniform.double())
    np.testing.assert_array_equal(candidates[:, :K], kept)
    np.testing.assert_allclose(candidates[:, K:], expected, atol=2e-5)


def test_draws_of_extreme_numbers_stay_inside() -> None:
    mean, variance, kept, uniform = normal(8)
    uniform[:, 0], uniform[:, 1] = 0, 1 - 2**-24
    candidates = np.empty((B, K + N, 8), np.float32)
    draw(mean.numpy(), variance.numpy(), kept.numpy(), uniform.numpy(), candidates)
    assert ((candidates >= 0) & (candidates <= 1)).all()


@pytest.mark.parametrize("num_elites", [1, 3, N])
def test_what_is_learned(num_elites: int) -> None:
    """In float64 by hand; some costs are infinite, a problem has none that is finite."""
    rng = np.random.default_rng(0)
    candidates, costs = rng.random((B, N, 8), np.float32), rng.random((B, N), np.float32)
    costs[1, 3:], costs[2], costs[3, 0] = np.inf, np.nan, -np.inf
    mean, variance = rng.random((2, B, 8), np.float32)
    expected_mean, expected_variance = mean.astype(float), variance.astype(float)
    elites, best = np.empty((B, num_elites, 8), np.float32), np.empty((B, num_elites), np.float32)
    learn(candidates, costs, 0.1, mean, variance, elites, best)
    finite = np.where(np.isfinite(costs), costs, np.inf)
    for b in range(B):
        order = np.argsort(finite[b], kind="stable")[:num_elites]
        np.testing.assert_array_equal(elites[b], candidates[b, order])
        np.testing.assert_array_equal(best[b], finite[b, order])
        usable = candidates[b, order[np.isfinite(finite[b, order])]].astype(float)
        if len(usable):
            expected_mean[b] = 0.9 * usable.mean(0) + 0.1 * expected_mean[b]
            expected_variance[b] = 0.9 * usable.var(0) + 0.1 * expected_variance[b]
    np.testing.assert_allclose(mean, expected_mean, atol=1e-6)
    np.testing.assert_allclose(variance, expected_variance, atol=1e-6)


def test_plans_are_those_of_pytorch() -> None:
    """Three plans in a row, with warm starts, from the same uniform numbers."""
    planner = CEMPlanner.load("planner", "cem", horizon=7)
    target = torch.rand(B, 1, 7, 4, generator=torch.Generator().manual_seed(1))

    def plans(wanted: bool) -> list[torch.Tensor]:
        generators = [np.random.default_rng(seed) for seed in range(B)]
        state, actual = planner.initial(B), []
        with compiled.switched(wanted):
            for _ in range(3):
                plan, state = planner.plan(lambda actions: (actions - target).square().sum((2, 3)), state, generators)
                actual += [plan.actions, plan.cost, *state]
        return actual

    for mine, its in zip(plans(True), plans(False), strict=True):
        torch.testing.assert_close(mine, its, rtol=1e-4, atol=1e-4)
