"""Terms that are added to the loss so that codes compose: each is a function of codes, with a value for each member."""

import torch
from torch import Tensor


def composition_gap(codes: Tensor) -> Tensor:
    """Squared distance between the code of two views laid over each other and the sum of their codes, `[M]`.

    Codes are measured from that of the empty view. The mean is over pairs.

    Args:
        codes: `[M, P, 4, C]`, of views as `affmap.data.pasted.paste` returns them.
    """
    first, second, both, empty = codes.unbind(2)
    return (both - first - second + empty).square().sum(-1).mean(1)


def effect_prior(effects: Tensor, std: float) -> Tensor:
    """Negative logarithm of a Gaussian prior around 0 on effects `[M, ..., 2]` (u/step), up to a constant: `[M]`, nats.

    Inside fog, where a prediction is uncertain by far more than the vehicle moves, the likelihood says nothing about
    the mean, and an effect may be anything; beside fog it would mislead planners.
    """
    return (0.5 * (effects / std).square()).sum(-1).flatten(1).mean(1)


def total_correlation(codes: Tensor) -> Tensor:
    """Total correlation of the units of codes `[M, ..., C]`, as if they were Gaussian: `[M]`, nats.

    It is -1/2 ln det R, with the correlations R of the units; 0 if these are independent.
    """
    values = codes.flatten(1, -2)
    centered = values - values.mean(1, keepdim=True)
    scaled = centered / (centered.square().mean(1, keepdim=True) + _LEAST).sqrt()
    correlation = scaled.mT @ scaled / values.shape[1]
    itself = torch.eye(codes.shape[-1], dtype=torch.bool, device=codes.device)
    return -0.5 * torch.linalg.slogdet(correlation.masked_fill(itself, 1.0)).logabsdet


_LEAST = 1e-4
"""Variance that is added to that of each unit: one that is constant is independent of all others."""
