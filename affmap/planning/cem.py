"""Evolutionary planning: the cross-entropy method with the modifications of Appendix B.

Each problem has a normal distribution over each throttle of each future step. Candidates are drawn from it and
evaluated, and the distribution moves to the elites. The modifications and their purposes:

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

from affmap import compiled
from affmap.lazy import torch
from affmap.planning.planner import Generators, Objective, Plan, evaluate, shift
from affmap.planning.registry import register_planner
from affmap.settings import Count, CountOrNone, Positive, Settings, Share, preset

if TYPE_CHECKING:
    from torch import Tensor

SQRT_2 = math.sqrt(2)


class CEMState(NamedTuple):
    """The method's state between steps."""

    mean: Tensor
    """`[B, H, 4]`"""
    elites: Tensor
    """`[B, K, H, 4]`, candidates kept for the next iteration; K is 0 before the first plan."""


@register_planner
class CEMPlanner(Settings, defaults="planner/cem"):
    """Evolutionary planning: the cross-entropy method (`conf/planner/cem.yaml`)."""

    kind: Literal["cem"] = preset()
    horizon: Count = preset()
    """H, steps."""
    num_candidates: Count = preset()
    """N, candidates drawn an iteration; kept elites are evaluated besides."""
    num_elites: Count = preset()
    """Candidates that the distribution is estimated from."""
    num_kept: CountOrNone = preset()
    """K, elites that join the next iteration's candidates."""
    num_iterations: Count = preset()
    """Iterations a plan."""
    initial_mean: Share = preset()
    """Opening of all throttles before the first plan."""
    initial_variance: Positive = preset()
    """Variance of all throttles where a plan begins."""
    momentum: Annotated[Share, Field(lt=1)] = preset()
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
        mean = torch.full((num_problems, self.horizon, 4), self.initial_mean, dtype=torch.float32, device=device)
        return CEMState(mean, mean.new_empty(num_problems, 0, self.horizon, 4))

    def plan(self, objective: Objective, state: CEMState, generators: Generators) -> tuple[Plan, CEMState]:
        """Improve the distribution `num_iterations` times; see `Planner.plan`."""
        with torch.inference_mode():  # many small operations: without autograd's bookkeeping they are a tenth faster
            search = self._search_compiled if compiled.enabled() and state.mean.device.type == "cpu" else self._search
            elites, costs, mean = search(objective, state, generators)
        # Copies, because tensors of inference mode cannot enter autograd later.
        plan = Plan(elites[:, 0].clone(), costs[:, 0].clone())
        return plan, CEMState(shift(mean), shift(elites[:, : self.num_kept]))

    def _search(self, objective: Objective, state: CEMState, generators: Generators) -> tuple[Tensor, Tensor, Tensor]:
        """Search; returns the last elites `[B, E, H, 4]`, best first, their costs `[B, E]` and the last mean."""
        mean, kept = state
        variance = torch.full_like(mean, self.initial_variance)
        for _ in range(self.num_iterations):
            numbers = np.empty((len(mean), self.num_candidates, *mean.shape[1:]), np.float32)
            uniform = torch.from_numpy(self._uniform(generators, numbers)).to(mean.device)
            draws = truncated_normal(mean[:, None], variance.sqrt()[:, None], uniform)
            candidates = torch.cat([kept, draws], dim=1)
            costs, order = evaluate(objective, candidates).topk(self.num_elites, dim=1, largest=False)  # ascending
            elites = candidates.gather(1, order[..., None, None].expand(-1, -1, *candidates.shape[2:]))
            mean, variance = self._estimate(elites, costs.isfinite(), mean, variance)
            kept = elites[:, : self.num_kept]
        return elites, costs, mean

    def _search_compiled(
        self, objective: Objective, state: CEMState, generators: Generators
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Search in compiled loops; see `_search`."""
        from affmap.compiled.search import draw, learn

        mean, kept = (part.flatten(-2).numpy().copy() for part in state)
        num_problems, length = mean.shape
        variance = np.full_like(mean, self.initial_variance)
        elites = np.empty((num_problems, self.num_elites, length), np.float32)
        costs = np.empty((num_problems, self.num_elites), np.float32)
        # Buffers for all iterations, because so much memory is slow to allocate.
        uniform = np.empty((num_problems, self.num_candidates, length), np.float32)
        candidates = np.empty(0, np.float32)
        for _ in range(self.num_iterations):
            shape = num_problems, kept.shape[1] + self.num_candidates, length
            if candidates.shape != shape:
                candidates = np.empty(shape, np.float32)
            self._uniform(generators, uniform)
            draw(mean, variance, kept, uniform, candidates)
            actions = torch.from_numpy(candidates).unflatten(-1, (self.horizon, 4))
            learn(candidates, evaluate(objective, actions).numpy(), self.momentum, mean, variance, elites, costs)
            kept = elites[:, : self.num_kept].copy()
        best, last_mean = (torch.from_numpy(part).unflatten(-1, (self.horizon, 4)) for part in (elites, mean))
        return best, torch.from_numpy(costs), last_mean

    def _uniform(self, generators: Generators, numbers: np.ndarray) -> np.ndarray:
        """Fill `numbers` `[B, N, ...]` with uniform ones in [0, 1), each problem's from its own generator."""
        for generator, own in zip(generators, numbers, strict=True):
            generator.random(out=own, dtype=np.float32)
        return numbers

    def _estimate(self, elites: Tensor, usable: Tensor, mean: Tensor, variance: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and variance of the usable elites, `[B, E, H, 4]` and `[B, E]` bool, mixed with the old ones."""
        weight = usable.to(mean) / usable.sum(1, keepdim=True).clamp_min(1)
        weight = weight[..., None, None]
        elite_mean = (weight * elites).sum(1)
        elite_variance = (weight * (elites - elite_mean[:, None]).square()).sum(1)
        # A problem none of whose candidates has a finite cost keeps its distribution.
        momentum = torch.full_like(mean[:, :1, :1], self.momentum).masked_fill(~usable.any(1)[:, None, None], 1.0)
        return torch.lerp(elite_mean, mean, momentum), torch.lerp(elite_variance, variance, momentum)


def truncated_normal(mean: Tensor, std: Tensor, uniform: Tensor) -> Tensor:
    """Normal variables conditioned on [0, 1], from uniform ones, by the quantile function.

    This equals rejection: drawing until a value lies in [0, 1].

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
