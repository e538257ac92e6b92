"""Imagination: what a stack expects to happen when actions are carried out (Section 3.4).

The predicted mean is the next input, and the view is looked up where the vehicle is expected to be. Variances add up
along the path. Knows nothing of goals and planners.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.lookup import Lookup
from affmap.model.transition import Carry, TransitionModel


class Situation(NamedTuple):
    """What an imagined path starts from: B problems, member-major (B = M x agents per member)."""

    position: Tensor
    """Reported position, `[B, 2]`, u."""
    delta: Tensor
    """Last change of the reported position, `[B, 2]`, u/step."""
    carry: Carry
    """Hidden state of the transition model, tensors `[M, B / M, 1, hidden]`; empty for the MLP."""


def rollout(transition: TransitionModel, lookup: Lookup, situation: Situation, actions: Tensor) -> Gaussian:
    """Imagine the execution of action sequences.

    Args:
        transition: M transition models.
        lookup: context codes of the same M members.
        situation: where each of B problems starts.
        actions: `[B, N, H, 4]`, candidates of each problem.

    Returns:
        Predicted positions after each action, a Gaussian of `[B, N, H, 2]` in u.
    """
    num_problems, num_candidates, horizon, _ = actions.shape
    num_members = transition.output.weight.shape[0]
    by_member = (num_members, num_problems // num_members, num_candidates)
    actions = actions.view(*by_member, horizon, 4)
    position = situation.position.view(num_members, -1, 1, 2).expand(*by_member, 2)
    delta = situation.delta.view(num_members, -1, 1, 2).expand(*by_member, 2)
    carry = situation.carry
    means, log_stds = [], []
    for action in actions.unbind(-2):
        carry, (delta, log_std) = transition.step(carry, lookup(position), delta, action)
        position = position + delta
        means.append(position)
        log_stds.append(log_std)
    variance = (2 * torch.stack(log_stds, dim=-2)).exp().cumsum(-2)
    shape = (num_problems, num_candidates, horizon, 2)
    return Gaussian(torch.stack(means, dim=-2).view(shape), 0.5 * variance.log().view(shape))
