"""What every agent is: a rule for the actions of B vehicles, state in and state out.

A controller sees what vehicles sense, and nothing else: it may hold a model, a look-up and a planner, as
`affmap.control.agent.Agent` does, or none of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from affmap.gaussian import Gaussian
from affmap.lazy import torch
from affmap.planning.planner import Generators

if TYPE_CHECKING:
    from torch import Tensor


class Observation(NamedTuple):
    """What B vehicles sense."""

    position: Tensor
    """Reported position, `[B, 2]`, u."""
    delta: Tensor
    """Its last change, `[B, 2]`, u/step."""
    view: Tensor
    """`[B, K, 11, 11]` bool"""
    goal: Tensor
    """`[B, 2]`, u."""

    @classmethod
    def of(cls, observations: Sequence[Mapping[str, np.ndarray]], device: str = "cpu") -> Observation:
        """What B environments have returned, as tensors."""
        parts = {key: np.stack([each[key] for each in observations]) for key in cls._fields}
        parts["view"] = parts["view"].astype(bool)
        return cls(**{key: torch.from_numpy(part).to(device) for key, part in parts.items()})


class Decision(NamedTuple):
    """What B vehicles do next, and what they expect; NaN where nothing is expected."""

    action: Tensor
    """`[B, 4]`, to be executed now."""
    path: Gaussian
    """Expected positions if the whole plan were executed, of `[B, H, 2]`, u."""
    delta: Gaussian
    """Expected change of position in the next step, of `[B, 2]`, u/step, from the view at the vehicle."""

    @classmethod
    def without_prediction(cls, action: Tensor) -> Decision:
        """Return the decision of a controller that has no model: only actions `[B, 4]`, and a step that is unknown."""
        unknown = action.new_full((len(action), 2), torch.nan)
        delta = Gaussian(unknown, unknown)
        return cls(action, Gaussian(*(part[:, None] for part in delta)), delta)


class Controller(Protocol):
    """Steers B vehicles side by side; whatever has these two methods is one.

    Vehicles do not see each other: B steered together are B steered alone. What is random comes from the generators.
    """

    def initial(self, num_problems: int) -> Any:
        """Return the state before the first step, for B problems."""
        ...

    def act(self, observation: Observation, state: Any, generators: Generators) -> tuple[Decision, Any]:
        """Decide for all.

        Args:
            observation: what B vehicles sense now.
            state: what `initial` or the last `act` returned.
            generators: a generator for each of the B.

        Returns:
            The decisions, on the device of the observation, and the state for the next step.
        """
        ...
