"""Information gain: how much a step could teach a committee of models, seen from their predictions.

All K models of a committee predict the same paths, as Gaussians. A model that has learned everything agrees with all
others, in fog as well, where every one of them predicts a large deviation; so disagreement and deviation are not the
same. Knows nothing of models and actions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations

import torch
from torch import Tensor

from affmap.gaussian import Gaussian

LOG_4_PI = math.log(4 * math.pi)


def deviation(predictions: Gaussian) -> Tensor:
    """Mean predicted standard deviation of K models `[K, ..., D]`: `[...]`, in units of the coordinates."""
    return predictions.log_std.exp().mean((0, -1))


def disagreement(predictions: Gaussian) -> Tensor:
    """Standard deviation of the means of K models `[K, ..., D]`, mean over coordinates: `[...]`, likewise."""
    return predictions.mean.std(0, unbiased=False).mean(-1)


def divergence(predictions: Gaussian) -> Tensor:
    """Jensen-Renyi divergence of order 2 of K Gaussians `[K, ..., D]`: `[...]`, nats.

    The Renyi entropy of their mixture minus the mean of their own, H[p] = -log of the integral of p squared. Unlike
    that of Shannon it has a closed form, because the product of two Gaussians has one as its integral (Wang et al.
    2009; Shyam et al. 2019, arXiv 1810.12162). Where all have one deviation it is 0 if they agree, and log K if no two
    overlap. Where deviations differ it is no more than an approximation of an information gain: this entropy is not
    concave, so that it is below 0 if some are much more certain than others.
    """
    means, log_stds = predictions.mean.unbind(0), predictions.log_std.unbind(0)
    own = [-(log_std + 0.5 * LOG_4_PI).sum(-1) for log_std in log_stds]  # log of the integral of a square
    both = [_log_overlap(means[i], log_stds[i], means[j], log_stds[j]) for i, j in combinations(range(len(own)), 2)]
    mixture = torch.logsumexp(torch.stack([*own, *(each + math.log(2) for each in both)]), 0) - 2 * math.log(len(own))
    return torch.stack(own).mean(0) - mixture


def _log_overlap(mean: Tensor, log_std: Tensor, other_mean: Tensor, other_log_std: Tensor) -> Tensor:
    """Logarithm of the integral of the product of two Gaussians `[..., D]`: `[...]`."""
    variance = (2 * log_std).exp() + (2 * other_log_std).exp()
    return -0.5 * ((mean - other_mean).square() / variance + (2 * math.pi * variance).log()).sum(-1)


def changes(path: Gaussian, start: Tensor, resolution: float) -> Gaussian:
    """The predicted change of position in each step of a path `[..., H, 2]` (u), as an agent could observe it.

    Along a path means and variances add up; here they are taken apart. Where a model has learned a world without noise,
    its deviation is as small as its error, so that models never agree; but differences below the resolution are no
    news.

    Args:
        path: positions after each step, u.
        start: `[..., 2]`, u.
        resolution: standard deviation of an observer, u, which is added to those predicted.
    """
    mean = path.mean.diff(dim=-2, prepend=start[..., None, :].expand_as(path.mean[..., :1, :]))
    variance = (2 * path.log_std).exp()
    variance = variance.diff(dim=-2, prepend=torch.zeros_like(variance[..., :1, :])).clamp_min(0)
    return Gaussian(mean, 0.5 * (variance + resolution**2).log())


SIGNALS: dict[str, Callable[[Gaussian], Tensor]] = {
    "deviation": deviation,
    "disagreement": disagreement,
    "divergence": divergence,
}
"""Name of a signal -> what it is computed with."""
