"""Information gain: how much a step could teach a committee of models, seen from their predictions.

All K models of a committee predict the same paths, as Gaussians. A model that has learned everything agrees with all
others, in fog as well, where every one of them predicts a large deviation; so disagreement and deviation are not the
same. Knows nothing of models and actions.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from affmap.gaussian import Gaussian

LOG_2 = math.log(2)


def deviation(predictions: Gaussian) -> Tensor:
    """Mean predicted standard deviation of K models `[K, ..., D]`: `[...]`, in units of the coordinates."""
    return predictions.log_std.exp().mean((0, -1))


def disagreement(predictions: Gaussian) -> Tensor:
    """Standard deviation of the means of K models `[K, ..., D]`, mean over coordinates: `[...]`, likewise."""
    return predictions.mean.std(0, unbiased=False).mean(-1)


def information(predictions: Gaussian) -> Tensor:
    """Information about which of K models `[K, ..., D]` is true that an observation would give: `[...]`, nats.

    A lower bound of the Jensen-Shannon divergence, which has no closed form for Gaussians: -log of a model's mean
    overlap exp(-d) with all K, mean over models, where d is the distance of Bhattacharyya (Kolchinsky and Tracey 2017,
    arXiv 1706.02419). It is 0 if and only if all agree, and log K if no two overlap, whatever their deviations are.
    """
    mean, log_std = (part.unsqueeze(0) for part in predictions)
    other_mean, other_log_std = (part.unsqueeze(1) for part in predictions)
    log_variance = torch.logaddexp(2 * log_std, 2 * other_log_std) - LOG_2  # of both, mean
    distance = (
        (mean - other_mean).square() / log_variance.exp() / 8 + (log_variance - log_std - other_log_std) / 2
    ).sum(-1)
    return math.log(len(distance)) - torch.logsumexp(-distance, 0).mean(0)


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
    "information": information,
}
"""Name of a signal -> what it is computed with."""
