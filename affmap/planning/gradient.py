"""Gradient-based planning: action inference with the adjustments of Appendix B.

Gradient descent on the objective, with learning rates that decay from the far future to the present, actions clamped
to [0, 1], and an early stop: a problem whose last update made its cost larger takes that update back and is finished.
After the search the actions are shifted by a step for a warm start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from pydantic import Field

from affmap.lazy import torch
from affmap.planning.planner import Generators, Objective, Plan, evaluate, shift
from affmap.planning.registry import register_planner
from affmap.settings import Count, Positive, Settings, Share, preset

if TYPE_CHECKING:
    from torch import Tensor


class GradientState(NamedTuple):
    """The method's state between steps."""

    actions: Tensor
    """`[B, H, 4]`"""


@register_planner
class GradientPlanner(Settings, defaults="planner/gradient"):
    """Gradient-based planning: gradient descent on actions (`conf/planner/gradient.yaml`)."""

    kind: Literal["gradient"] = preset()
    horizon: Count = preset()
    """H, steps."""
    num_iterations: Count = preset()
    """Largest number of updates."""
    initial_action: Share = preset()
    """Opening of all throttles before the first plan."""
    learning_rate: Positive = preset()
    """Learning rate, the mean over the horizon."""
    decay: Annotated[Share, Field(gt=0)] = preset()
    """Ratio of the learning rates of a step and the next."""

    def initial(self, num_problems: int, device: torch.device | str = "cpu") -> GradientState:
        """All throttles at `initial_action`."""
        shape = num_problems, self.horizon, 4
        return GradientState(torch.full(shape, self.initial_action, dtype=torch.float32, device=device))

    def plan(self, objective: Objective, state: GradientState, generators: Generators) -> tuple[Plan, GradientState]:
        """Descend for at most `num_iterations` updates; see `Planner.plan`. Nothing is random here."""
        rates = self.learning_rates().to(state.actions.device)[:, None]  # [H, 1]
        actions = best = state.actions
        cost = actions.new_full((len(actions),), torch.inf)
        active = torch.ones_like(cost, dtype=torch.bool)
        for iteration in range(self.num_iterations + 1):  # the last update, too, is kept only if it helps
            # NaN: a compiled objective skips finished problems.
            unfinished = actions.where(active[:, None, None], torch.nan)
            new_cost, gradient = self._cost_and_gradient(objective, unfinished, iteration < self.num_iterations)
            active = active & (new_cost <= cost)
            best = torch.where(active[:, None, None], actions, best)
            cost = torch.where(active, new_cost, cost)
            if not active.any():
                break
            actions = (best - rates * gradient).clamp(0, 1)
        return Plan(best, cost), GradientState(shift(best))

    def learning_rates(self) -> Tensor:
        """`[H]`: proportional to decay ** (H - tau) for tau = 1 to H, with mean `learning_rate`.

        The formula printed in Appendix B makes them sum to the "mean learning rate"; this makes it their mean.
        """
        weight = self.decay ** torch.arange(self.horizon - 1, -1, -1, dtype=torch.float32, device="cpu")
        return self.learning_rate * weight / weight.mean()

    @staticmethod
    def _cost_and_gradient(objective: Objective, actions: Tensor, with_gradient: bool) -> tuple[Tensor, Tensor]:
        """Cost `[B]` of actions `[B, H, 4]`, and its gradient (or zeros)."""
        with torch.set_grad_enabled(with_gradient):
            variable = actions.detach().requires_grad_(with_gradient)
            cost = evaluate(objective, variable[:, None])[:, 0]
            if not with_gradient:
                return cost, torch.zeros_like(actions)
            (gradient,) = torch.autograd.grad(cost.sum(), variable)
        # Where the objective is NaN, so is its gradient; such actions stay as they are.
        return cost.detach(), gradient.nan_to_num(0.0, 0.0, 0.0)
