"""The protocol of planners: search for the actions that minimise an objective, state in and state out.

A planner sees a callable and tensors: no models, no worlds, no goals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeGuard

import numpy as np

from affmap.lazy import torch
from affmap.settings import ConfigError
from affmap.settings.messages import format_value

if TYPE_CHECKING:
    from torch import Tensor

Objective = Callable[["Tensor"], "Tensor"]
"""Cost of candidates: actions `[B, N, H, 4]` -> `[B, N]`, to be minimised.

Planners that need no gradient call it in torch's inference mode, in which it must not differentiate anything itself.
They may overwrite their candidates after it has returned. Actions that are NaN mark a problem that needs no cost; its
cost is NaN, too, or anything else.
"""

Generators = Sequence[np.random.Generator]
"""One generator a problem, B of them, so that a problem's plan does not depend on its neighbours."""


class Plan(NamedTuple):
    """The best actions found for each of B problems."""

    actions: Tensor
    """`[B, H, 4]`, each in [0, 1]; the first is to be executed."""
    cost: Tensor
    """`[B]`, value of the objective."""


class Planner(Protocol):
    """A search method."""

    horizon: int

    def initial(self, num_problems: int, device: torch.device | str = "cpu") -> Any:
        """The state before the first plan, for B problems."""
        ...

    def plan(self, objective: Objective, state: Any, generators: Generators) -> tuple[Plan, Any]:
        """Plan for B problems, starting from the last plans; returns the plans and the state for the next step."""
        ...


def is_planner(given: Any) -> TypeGuard[Planner]:
    """Whether an object has the methods of a planner; a class is none.

    Raises:
        ConfigError: it has only one of them.
    """
    methods = ("initial", "plan")
    missing = [name for name in methods if isinstance(given, type) or not callable(getattr(given, name, None))]
    if len(missing) == 1:
        raise ConfigError(
            f"planner = {format_value(given)} has no method {missing[0]}; a planner has the methods initial and plan."
        )
    return not missing


def evaluate(objective: Objective, actions: Tensor) -> Tensor:
    """The costs `[B, N]` of candidates `[B, N, H, 4]`; a cost that is not a number counts as infinite.

    Raises:
        ValueError: the objective returns another shape.
    """
    costs = objective(actions)
    if costs.shape != actions.shape[:2]:
        raise ValueError(f"the objective returned shape {list(costs.shape)}; it must be {list(actions.shape[:2])}.")
    return costs.to(actions.dtype).nan_to_num(nan=torch.inf, posinf=torch.inf, neginf=-torch.inf)


def shift(actions: Tensor) -> Tensor:
    """Actions `[..., H, 4]` one step later; the last one is repeated."""
    return torch.cat([actions[..., 1:, :], actions[..., -1:, :]], dim=-2)
