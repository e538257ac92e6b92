"""Imagination: the predictions of a stack for the execution of actions (Section 3.4).

The predicted mean is the next input, and the view is looked up where the vehicle is expected to be. Variances add up
along the path. Knows nothing of goals and planners.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.lookup import Lookup
from affmap.model.transition import Carry, TransitionModel


class Situation(NamedTuple):
    """Start of imagined paths for B problems, member-major (B = M x agents per member)."""

    position: Tensor
    """Reported position, `[B, 2]`, u."""
    delta: Tensor
    """Last change of the reported position, `[B, 2]`, u/step."""
    carry: Carry
    """Hidden state of the transition model, tensors `[M, B / M, hidden]`; empty for the MLP."""


def rollout(
    transition: TransitionModel,
    lookup: Lookup,
    situation: Situation,
    actions: Tensor,
    path: Tensor | None = None,
    code: Tensor | None = None,
) -> Gaussian:
    """Imagine the execution of action sequences.

    Args:
        transition: M transition models.
        lookup: context codes of the same M members.
        situation: where each of B problems starts.
        actions: `[B, N, H, 4]`, candidates of each problem.
        path: positions `[B, N, H, 2]` (u) that take the place of the predicted ones, if any; deviations are predicted
            along them.
        code: context codes for the first step, `[M, B / M, C]`; None for those at the reported positions.

    Returns:
        Predicted positions after each action, a Gaussian of `[B, N, H, 2]` in u.
    """
    num_problems, num_candidates, horizon, _ = actions.shape
    num_members = len(next(transition.parameters()))
    num_paths = num_problems * num_candidates // num_members  # of each member

    def of_paths(start: Tensor) -> Tensor:
        """Repeat the starts of problems `[M, B / M, F]` for each path: `[M, P, F]`, features first in memory."""
        return start.mT.repeat_interleave(num_candidates, dim=2).mT

    step = transition.step()
    position = of_paths(situation.position.unflatten(0, (num_members, -1)))
    delta = of_paths(situation.delta.unflatten(0, (num_members, -1)))
    carry = tuple(of_paths(part) for part in situation.carry)
    throttles = actions.reshape(num_members, num_paths, horizon, 4).permute(2, 0, 3, 1).contiguous().mT  # [H, M, P, 4]
    means, log_stds = [], []
    for t, action in enumerate(throttles):
        here = of_paths(code) if code is not None and t == 0 else lookup(position)
        carry, (delta, log_std) = step(carry, here, delta, action)
        if path is not None:
            delta = path[:, :, t].reshape(num_members, num_paths, 2) - position
        position = position + delta
        means.append(position.mT)
        log_stds.append(log_std.mT)
    mean, log_std = (torch.stack(parts).transpose(1, 2).contiguous() for parts in (means, log_stds))  # [H, 2, M, P]
    variance = (2 * log_std).exp().cumsum(0)
    shape = (horizon, 2, num_problems, num_candidates)
    return Gaussian(*(part.view(shape).permute(2, 3, 0, 1) for part in (mean, 0.5 * variance.log())))
