"""Closed forms of normal distributions against torch.distributions, quadrature and the gradients of the paper."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from affmap.gaussian import Gaussian, entropy, kl, nll

quick = settings(max_examples=60, deadline=None, derandomize=True)


@st.composite
def tensors(draw: st.DrawFn, low: float, high: float) -> Tensor:
    """`[3, 2]`, float64."""
    return torch.tensor(draw(st.lists(st.floats(low, high), min_size=6, max_size=6)), dtype=torch.float64).view(3, 2)


gaussians = st.builds(Gaussian, tensors(-3, 3), tensors(-4, 2))


def normal(gaussian: Gaussian) -> Normal:
    return Normal(gaussian.mean, gaussian.log_std.exp())


def gaussian_of(mean: Tensor, variance: Tensor) -> Gaussian:
    return Gaussian(mean, 0.5 * variance.log())


def gradients(value: Tensor, *variables: Tensor) -> list[Tensor]:
    """Zeros where `value` does not depend on a variable."""
    actual = torch.autograd.grad(value.sum(), variables, allow_unused=True)
    return [torch.zeros_like(v) if g is None else g for v, g in zip(variables, actual, strict=True)]


@quick
@given(gaussians, tensors(-3, 3))
def test_nll_is_that_of_torch_distributions(gaussian: Gaussian, value: Tensor) -> None:
    torch.testing.assert_close(nll(gaussian, value), -normal(gaussian).log_prob(value).sum(-1))


@quick
@given(gaussians)
def test_entropy_is_that_of_torch_distributions(gaussian: Gaussian) -> None:
    torch.testing.assert_close(entropy(gaussian), normal(gaussian).entropy().sum(-1))


@quick
@given(gaussians, gaussians)
def test_kl_is_that_of_torch_distributions(first: Gaussian, second: Gaussian) -> None:
    actual = kl(first, second)
    torch.testing.assert_close(actual, kl_divergence(normal(first), normal(second)).sum(-1))
    assert (actual >= -1e-12).all()


@quick
@given(gaussians)
def test_nothing_diverges_from_itself(gaussian: Gaussian) -> None:
    """Exactly."""
    assert torch.equal(kl(gaussian, gaussian), torch.zeros(3, dtype=torch.float64))


@quick
@given(gaussians, gaussians)
def test_expected_nll_is_entropy_plus_divergence(first: Gaussian, second: Gaussian) -> None:
    """Appendix F; the expectation by Gauss-Hermite quadrature, which is exact for a quadratic."""
    nodes, weights = (torch.from_numpy(part) for part in np.polynomial.hermite_e.hermegauss(3))
    weights = weights / weights.sum()
    cross = torch.zeros(3, dtype=torch.float64)
    for x, weight_x in zip(nodes, weights, strict=True):
        for y, weight_y in zip(nodes, weights, strict=True):
            value = first.mean + first.log_std.exp() * torch.stack([x, y])
            cross += weight_x * weight_y * nll(second, value)
    torch.testing.assert_close(cross, entropy(first) + kl(first, second))


@pytest.mark.parametrize(
    ("actual", "expected"),
    [
        (nll(Gaussian(torch.zeros(2), torch.zeros(2)), torch.zeros(2)), math.log(2 * math.pi)),
        (nll(Gaussian(torch.zeros(2), torch.zeros(2)), torch.tensor([3.0, 4.0])), math.log(2 * math.pi) + 12.5),
        (entropy(Gaussian(torch.ones(2), torch.zeros(2))), math.log(2 * math.pi * math.e)),
        (kl(Gaussian(torch.ones(2), torch.zeros(2)), Gaussian(torch.zeros(2), torch.zeros(2))), 1.0),
        (
            kl(Gaussian(torch.zeros(2), torch.tensor([2.0, 2.0]).log()), Gaussian(torch.zeros(2), torch.zeros(2))),
            3 - math.log(4),
        ),
        (
            kl(Gaussian(torch.zeros(2), torch.zeros(2)), Gaussian(torch.zeros(2), torch.tensor([2.0, 2.0]).log())),
            math.log(4) - 0.75,
        ),
    ],
)
def test_values_worked_out_by_hand(actual: Tensor, expected: float) -> None:
    """Closed forms with two coordinates; the last two say which way round the divergence goes."""
    assert actual.item() == pytest.approx(expected, rel=1e-6)


@quick
@given(tensors(-3, 3), tensors(0.01, 4), tensors(-3, 3))
def test_gradients_of_nll_are_those_of_appendix_d(mean: Tensor, variance: Tensor, value: Tensor) -> None:
    """The paper gives the score, which is minus the gradient of the NLL."""
    mean.requires_grad_(), variance.requires_grad_()
    by_mean, by_variance = gradients(nll(gaussian_of(mean, variance), value), mean, variance)
    torch.testing.assert_close(by_mean, -(value - mean) / variance)
    torch.testing.assert_close(by_variance, -1 / (2 * variance) * ((value - mean) ** 2 / variance - 1))


@quick
@given(tensors(-3, 3), tensors(0.01, 4))
def test_gradients_of_entropy_are_those_of_appendix_e(mean: Tensor, variance: Tensor) -> None:
    mean.requires_grad_(), variance.requires_grad_()
    by_mean, by_variance = gradients(entropy(gaussian_of(mean, variance)), mean, variance)
    assert torch.equal(by_mean, torch.zeros_like(mean))
    torch.testing.assert_close(by_variance, 0.5 / variance)


@quick
@given(tensors(-3, 3), tensors(0.01, 4), tensors(-3, 3), tensors(0.01, 4))
def test_gradients_of_kl_are_those_of_appendix_e(
    mean: Tensor, variance: Tensor, other_mean: Tensor, other_variance: Tensor
) -> None:
    mean.requires_grad_(), variance.requires_grad_()
    divergence = kl(gaussian_of(mean, variance), gaussian_of(other_mean, other_variance))
    by_mean, by_variance = gradients(divergence, mean, variance)
    torch.testing.assert_close(by_mean, -(other_mean - mean) / other_variance)
    torch.testing.assert_close(by_variance, 0.5 * (1 / other_variance - 1 / variance))


def test_any_axes_before_the_last_are_kept() -> None:
    """Each alone."""
    generator = torch.Generator().manual_seed(0)
    mean, log_std, value = (torch.randn(4, 3, 2, generator=generator) for _ in range(3))
    gaussian, other = Gaussian(mean, log_std), Gaussian(value, log_std + 0.3)
    for actual, alone in (
        (nll(gaussian, value), lambda b, h: nll(Gaussian(mean[b, h], log_std[b, h]), value[b, h])),
        (entropy(gaussian), lambda b, h: entropy(Gaussian(mean[b, h], log_std[b, h]))),
        (
            kl(gaussian, other),
            lambda b, h: kl(Gaussian(mean[b, h], log_std[b, h]), Gaussian(*(o[b, h] for o in other))),
        ),
    ):
        assert actual.shape == (4, 3)
        for b in range(4):
            for h in range(3):
                torch.testing.assert_close(actual[b, h], alone(b, h))
