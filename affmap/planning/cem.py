"""Evolutionary planning: the cross-entropy method with the modifications of Appendix B.

Each problem has a normal distribution over each throttle of each future step. Candidates are drawn from it and
evaluated, and the distribution moves to the elites. What each modification is there for:

- momentum on means and variances (de Boer et al. 2005): steadier estimates from few elites;
- some elites are kept among the next iteration's candidates, and, shifted by a step, among the next step's (iCEM);
- means are shifted to the next step, variances start anew (PETS): a warm start that can still leave its optimum;
- the best candidate of the last iteration is executed (of all, where elites are kept), not the mean (iCEM);
- values outside [0, 1] are drawn again: a truncated normal, drawn in one shot through its quantile function.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from affmap.lazy import torch
from affmap.planning.planner import Generators, Objective, Plan, evaluate, shift
from affmap.planning.registry import register
from affmap.settings import Count, CountOrNone, Positive, Settings, Share

if TYPE_CHECKING:
    from torch import Tensor

SQRT_2 = math.sqrt(2)


class CEMState(NamedTuple):
    """What the method remembers from step to step."""

    mean: Tensor
    """`[B, H, 4]`"""
    elites: Tensor
    """`[B, K, H, 4]`, candidates kept for the next iteration; K is 0 before the first plan."""


@register
class CEMPlanner(Settings):
    """The cross-entropy method (`conf/planner/cem.yaml`)."""

    kind: Literal["cem"]
    horizon: Count
    """H, steps."""
    num_candidates: Count
    """N, candidates drawn an iteration; kept elites are evaluated besides."""
    num_elites: Count
    """Candidates that the distribution is estimated from."""
    num_kept: CountOrNone
    """K, elites that join the next iteration's candidates."""
    num_iterations: Count
    initial_mean: Share
    initial_variance: Positive
    momentum: Annotated[Share, Field(lt=1)]
    """Weight of the old mean and variance."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.num_kept <= self.num_elites <= self.num_candidates:
            raise ValueError(
                f"num_kept = {self.num_kept}, num_elites = {self.num_elites}, num_candidates = {self.num_candidates}: "
                "they must not decrease in this order."
            )
        return self

    def initial(self, num_problems: int, device: torch.device | str = "cpu") -> CEMState:
        """Means at `initial_mean`, no elites."""
        mean = torch.full((num_problems, self.horizon, 4), self.initial_mean, device=device)
        return CEMState(mean, mean.new_empty(num_problems, 0, self.horizon, 4))

    def plan(self, objective: Objective, state: CEMState, generators: Generators) -> tuple[Plan, CEMState]:
        """Improve the distribution `num_iterations` times; see `Planner.plan`."""
        with torch.inference_mode():  # many small operations: without autograd's bookkeeping they are a tenth faster
            mean, kept = state
            variance = torch.full_like(mean, self.initial_variance)
            for _ in range(self.num_iterations):
                drawn = truncated_normal(mean[:, None], variance.sqrt()[:, None], self._uniform(generators, mean))
                candidates = torch.cat([kept, drawn], dim=1)
                costs, order = evaluate(objective, candidates).topk(self.num_elites, dim=1, largest=False)  # ascending
                elites = candidates.gather(1, order[..., None, None].expand(-1, -1, *candidates.shape[2:]))
                mean, variance = self._estimate(elites, costs.isfinite(), mean, variance)
                kept = elites[:, : self.num_kept]
        # Copies, because what was made in inference mode may not meet autograd later.
        return Plan(elites[:, 0].clone(), costs[:, 0].clone()), CEMState(shift(mean), shift(kept))

    def _uniform(self, generators: Generators, mean: Tensor) -> Tensor:
        """Uniform numbers in [0, 1), `[B, N, H, 4]`, each problem's from its own generator."""
        draws = np.empty((len(mean), self.num_candidates, self.horizon, 4), np.float32)
        for generator, draw in zip(generators, draws, strict=True):
            generator.random(out=draw, dtype=np.float32)
        return torch.from_numpy(draws).to(mean.device)

    def _estimate(self, elites: Tensor, usable: Tensor, mean: Tensor, variance: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and variance of the usable elites, `[B, E, H, 4]` and `[B, E]` bool, mixed with the old ones."""
        weight = usable / usable.sum(1, keepdim=True).clamp_min(1)
        weight = weight[..., None, None]
        elite_mean = (weight * elites).sum(1)
        elite_variance = (weight * (elites - elite_mean[:, None]).square()).sum(1)
        # A problem none of whose candidates has a finite cost keeps its distribution.
        momentum = torch.where(usable.any(1), self.momentum, 1.0)[:, None, None]
        return torch.lerp(elite_mean, mean, momentum), torch.lerp(elite_variance, variance, momentum)


def truncated_normal(mean: Tensor, std: Tensor, uniform: Tensor) -> Tensor:
    """Normal variables given that they lie in [0, 1], from uniform ones, by the quantile function.

    The same distribution as drawing again until a value lies in [0, 1].

    Args:
        mean: in [0, 1], broadcast against `uniform`.
        std: likewise; 0 gives the mean.
        uniform: numbers in [0, 1), of any shape.
    """
    # In terms of erf, of which PyTorch has a fast inverse; z = value in standard deviations from the mean / sqrt(2).
    std = std.clamp_min(torch.finfo(std.dtype).tiny ** 0.5)
    low, high = (-mean / (std * SQRT_2)).erf(), ((1 - mean) / (std * SQRT_2)).erf()
    z = torch.lerp(low, high, uniform).erfinv_().clamp_(-6, 6)  # rounding may make it infinite
    return torch.addcmul(mean, std, z, value=SQRT_2).clamp_(0, 1)
