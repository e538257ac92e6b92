"""Expected free energy against torch.distributions, a plain loop and closed forms."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from affmap.control.agent import ControlSettings
from affmap.gaussian import Gaussian
from affmap.planning.objective import expected_free_energy, goal_std

quick = settings(max_examples=40, deadline=None, derandomize=True)
B, N, H = 3, 4, 5


def problem(seed: int) -> tuple[Gaussian, Tensor, Tensor]:
    """Predictions of `[B, N, H, 2]`, goals `[B, 1, 2]` and their deviations `[B, 1]`, float64."""
    generator = torch.Generator().manual_seed(seed)
    mean, log_std, goal = (
        torch.randn(shape, generator=generator, dtype=torch.float64)
        for shape in ((B, N, H, 2), (B, N, H, 2), (B, 1, 2))
    )
    std = 0.05 + torch.rand(B, 1, generator=generator, dtype=torch.float64)
    return Gaussian(mean, log_std - 2), goal, std


@quick
@given(st.integers(0, 2**32 - 1), st.floats(0, 20))
def test_it_is_that_of_torch_distributions_step_by_step(seed: int, beta: float) -> None:
    """Equations 5 and 6: the mean over the horizon of divergence and beta times entropy."""
    prediction, goal, std = problem(seed)
    actual = expected_free_energy(prediction, goal, std, beta)
    divergences, entropies = [], []
    for step in range(H):
        there = Normal(prediction.mean[..., step, :], prediction.log_std[..., step, :].exp())
        desired = Normal(goal, std[..., None].expand(B, 1, 2))
        divergences.append(kl_divergence(there, desired).sum(-1))
        entropies.append(there.entropy().sum(-1))
    divergence, uncertainty = sum(divergences) / H, sum(entropies) / H
    torch.testing.assert_close(actual.divergence, divergence)
    torch.testing.assert_close(actual.uncertainty, uncertainty)
    torch.testing.assert_close(actual.total, divergence + beta * uncertainty)


def test_it_is_that_of_a_plain_loop() -> None:
    """Appendix E's formulas, number by number."""
    beta = 1.7
    prediction, goal, std = problem(0)
    actual = expected_free_energy(prediction, goal, std, beta).total
    assert actual.shape == (B, N)
    for b in range(B):
        for n in range(N):
            total = 0.0
            for step in range(H):
                for axis in range(2):
                    mean, target = prediction.mean[b, n, step, axis].item(), goal[b, 0, axis].item()
                    variance, wanted = math.exp(2 * prediction.log_std[b, n, step, axis].item()), std[b, 0].item() ** 2
                    total += 0.5 * (variance / wanted + (target - mean) ** 2 / wanted - 1 - math.log(variance / wanted))
                    total += beta * 0.5 * math.log(2 * math.pi * math.e * variance)
            assert actual[b, n].item() == pytest.approx(total / H)


def test_at_the_goal_with_the_desired_deviation_only_uncertainty_remains() -> None:
    """Closed form: no divergence, and the entropy log(2 pi e std^2) of two equal coordinates."""
    prediction = Gaussian(torch.ones(H, 2), torch.full((H, 2), math.log(0.1)))
    actual = expected_free_energy(prediction, torch.ones(2), torch.tensor(0.1), beta=3.0)
    assert actual.divergence.item() == pytest.approx(0, abs=1e-5)
    assert actual.uncertainty.item() == pytest.approx(math.log(2 * math.pi * math.e * 0.01), rel=1e-5)
    assert actual.total.item() == pytest.approx(3 * actual.uncertainty.item(), rel=1e-5)


@quick
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 2))
def test_farther_from_the_goal_is_worse(seed: int, farther: float) -> None:
    """Closed form: moving away along the line to the goal adds (d'^2 - d^2) / (2 std^2) at each step."""
    prediction, goal, std = problem(seed)
    offset = prediction.mean - goal[..., None, :]
    away = Gaussian(goal[..., None, :] + (1 + farther) * offset, prediction.log_std)
    near, far = (expected_free_energy(one, goal, std, 1.0) for one in (prediction, away))
    added = ((1 + farther) ** 2 - 1) * offset.square().sum(-1).mean(-1) / (2 * std.square())
    torch.testing.assert_close(far.total - near.total, added)
    assert (far.total > near.total).all()


@quick
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 2), st.floats(0.1, 10))
def test_larger_deviations_are_more_uncertain_and_beta_weighs_nothing_else(
    seed: int, larger: float, beta: float
) -> None:
    """Closed form: a factor on both deviations adds twice its logarithm to the entropy."""
    prediction, goal, std = problem(seed)
    wide = Gaussian(prediction.mean, prediction.log_std + larger)
    narrow, wider = (expected_free_energy(one, goal, std, beta) for one in (prediction, wide))
    torch.testing.assert_close(wider.uncertainty - narrow.uncertainty, torch.full_like(narrow.total, 2 * larger))
    torch.testing.assert_close(
        (wider.total - wider.divergence) - (narrow.total - narrow.divergence),
        torch.full_like(narrow.total, 2 * larger * beta),
    )
    without = expected_free_energy(prediction, goal, std, 0.0)
    torch.testing.assert_close(without.divergence, narrow.divergence)
    torch.testing.assert_close(without.uncertainty, narrow.uncertainty)
    torch.testing.assert_close(without.total, narrow.divergence)


def test_its_gradients_are_those_of_appendix_e() -> None:
    """d/d mean = (mean - goal) / std^2 / H; d/d variance = ((1/std^2 - 1/variance) + beta / variance) / 2H."""
    beta = 3.0
    prediction, goal, std = problem(1)
    mean = prediction.mean.requires_grad_()
    variance = (2 * prediction.log_std).exp().requires_grad_()
    total = expected_free_energy(Gaussian(mean, 0.5 * variance.log()), goal, std, beta).total
    by_mean, by_variance = torch.autograd.grad(total.sum(), (mean, variance))
    wanted = std[..., None, None].square()
    torch.testing.assert_close(by_mean, (mean - goal[..., None, :]) / wanted / H)
    torch.testing.assert_close(by_variance, (1 / wanted - 1 / variance + beta / variance) / (2 * H))


def test_each_problem_has_its_own_goal_and_deviation() -> None:
    """Together equals each alone, whatever the axes before the horizon."""
    prediction, goal, std = problem(2)
    together = expected_free_energy(prediction, goal, std, 1.0)
    for b in range(B):
        for n in range(N):
            one = Gaussian(prediction.mean[b, n], prediction.log_std[b, n])
            alone = expected_free_energy(one, goal[b, 0], std[b, 0], 1.0)
            for whole, part in zip(together, alone, strict=True):
                torch.testing.assert_close(whole[b, n], part)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (1.0, 2.0)])
def test_the_goal_s_deviation_shrinks_below_half_a_unit_and_not_at_it(corner: tuple[float, float]) -> None:
    """Section 4.2: 0.1, and 0.01 within 0.5 u, in all directions, problem by problem; binary fractions are exact."""
    control = ControlSettings.load("control", "default")
    tiny = 2.0**-20
    offsets = torch.tensor(
        [[0.5, 0], [0.5 - tiny, 0], [0, -0.5], [0, tiny - 0.5], [-0.5, tiny], [0.25, 0.25], [0.375, 0.375], [0, 0]]
    )
    position = torch.tensor(corner).expand(8, 2)
    actual = goal_std(position, position + offsets, control.goal_std_far, control.goal_std_near, control.near_distance)
    assert torch.equal(actual, torch.tensor([0.1, 0.01, 0.1, 0.01, 0.1, 0.01, 0.1, 0.01]))
