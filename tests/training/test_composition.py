"""Terms of the loss: sums of codes by hand, and total correlation of Gaussians whose covariance is known."""

import math

import torch
from torch.distributions import Normal

from affmap.training.composition import composition_gap, effect_prior, total_correlation


def test_the_gap_is_zero_where_codes_add_up_and_else_the_squared_distance() -> None:
    """Two members by hand; codes are measured from that of the empty view."""
    empty = torch.tensor([1.0, -1.0])
    first, second = empty + torch.tensor([2.0, 0.0]), empty + torch.tensor([0.0, 3.0])
    sums = torch.stack([first, second, first + second - empty, empty])
    away = torch.stack([first, second, first + second - empty + torch.tensor([3.0, 4.0]), empty])
    gap = composition_gap(torch.stack([torch.stack([sums, sums]), torch.stack([sums, away])]))  # [2, P=2, 4, 2]
    torch.testing.assert_close(gap, torch.tensor([0.0, 12.5]))


def test_total_correlation_is_that_of_a_gaussian() -> None:
    """Closed form -1/2 ln(1 - r^2) for two units of correlation r, whatever their scales; 0 for independent ones, and
    for a unit that never changes."""
    noise = torch.randn(200_000, 2, generator=torch.Generator().manual_seed(0))
    r = 0.8
    dependent = torch.stack([5 * noise[:, 0] + 1, 0.3 * (r * noise[:, 0] + math.sqrt(1 - r**2) * noise[:, 1])], dim=1)
    constant = torch.stack([noise[:, 0], torch.full((len(noise),), 2.0)], dim=1)
    actual = total_correlation(torch.stack([dependent, noise, constant]).view(3, 1000, 200, 2))
    expected = torch.tensor([-0.5 * math.log(1 - r**2), 0.0, 0.0])
    torch.testing.assert_close(actual, expected, atol=5e-3, rtol=0)


def test_the_prior_is_that_of_a_normal_distribution() -> None:
    """`torch.distributions.Normal`, without its constant: mean over steps of the sum over coordinates."""
    effects = 0.2 * torch.randn(3, 4, 5, 2, generator=torch.Generator().manual_seed(0))
    prior = Normal(0.0, 0.1)
    expected = (prior.log_prob(torch.zeros(())) - prior.log_prob(effects)).sum(-1).mean((1, 2))
    torch.testing.assert_close(effect_prior(effects, 0.1), expected)
