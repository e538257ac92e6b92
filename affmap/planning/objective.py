"""Expected free energy, the objective of planners (Section 2.2.1).

The desired state is a Gaussian around the goal. Always to be minimised; knows nothing of models and actions.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from affmap.gaussian import Gaussian, entropy, kl


class ExpectedFreeEnergy(NamedTuple):
    """The expected free energy of predicted paths and its two terms, `[...]` each, in nats, means over the horizon."""

    divergence: Tensor
    """Predicted divergence from the desired state."""
    uncertainty: Tensor
    """Predicted uncertainty."""
    total: Tensor
    """divergence + beta * uncertainty"""


def expected_free_energy(prediction: Gaussian, goal: Tensor, goal_std: Tensor, beta: float) -> ExpectedFreeEnergy:
    """Mean over the horizon of D[prediction || desired] + beta * H[prediction] (Equation 5).

    Args:
        prediction: positions along a path, a Gaussian of `[..., H, 2]`, u.
        goal: `[..., 2]`, u, broadcast against the axes before H.
        goal_std: `[...]`, standard deviation of the desired position, u.
        beta: weight of the uncertainty.

    Returns:
        The sum and its two terms, `[...]` each, nats; to be minimised.
    """
    log_std = goal_std.log()[..., None, None].expand(*goal.shape[:-1], 1, 2)
    divergence = kl(prediction, Gaussian(goal[..., None, :], log_std)).mean(-1)
    uncertainty = entropy(prediction).mean(-1)
    return ExpectedFreeEnergy(divergence, uncertainty, divergence + beta * uncertainty)


def goal_std(position: Tensor, goal: Tensor, far: float, near: float, near_distance: float) -> Tensor:
    """Standard deviation of the desired position, `[B]` (u): smaller once the goal is near enough to be seen.

    Args:
        position: `[B, 2]`, u.
        goal: `[B, 2]`, u.
        far: value at a distance of at least `near_distance`, u.
        near: value below that distance, u.
        near_distance: u.
    """
    distance = torch.linalg.vector_norm(position - goal, dim=-1)
    return torch.full_like(distance, far).masked_fill(distance < near_distance, near)
