"""The interface of all agents: a controller maps observations and a state to actions of B vehicles and a new state.

A controller receives only the sensations of its vehicles. It may hold a model, a look-up and a planner, as
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
    """Sensations of B vehicles."""

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
        """Stack the observations of B environments, arrays of any kind or lists of numbers, as tensors."""
        parts = {key: np.stack([each[key] for each in observations]) for key in cls._fields}
        arrays = {key: part.astype(bool if key == "view" else np.float32) for key, part in parts.items()}
        return cls(**{key: torch.from_numpy(array).to(device) for key, array in arrays.items()})


class Decision(NamedTuple):
    """Next actions of B vehicles and their predictions; NaN where nothing is predicted."""

    action: Tensor
    """`[B, 4]`, to be executed now."""
    path: Gaussian
    """Expected positions if the whole plan were executed, of `[B, H, 2]`, u."""
    delta: Gaussian
    """Expected change of position in the next step, of `[B, 2]`, u/step, from the view at the vehicle."""

    @classmethod
    def without_prediction(cls, action: Tensor) -> Decision:
        """Decision of a controller without a model: actions `[B, 4]`, and NaN for all predictions."""
        unknown = action.new_full((len(action), 2), torch.nan)
        delta = Gaussian(unknown, unknown)
        return cls(action, Gaussian(*(part[:, None] for part in delta)), delta)


class Controller(Protocol):
    """Steers B vehicles side by side; any object with these two methods is a controller.

    Vehicles are independent: B steered together behave as B steered alone. All randomness comes from the generators.
    """

    def initial(self, num_problems: int) -> Any:
        """State before the first step, for B problems."""
        ...

    def act(self, observation: Observation, state: Any, generators: Generators) -> tuple[Decision, Any]:
        """Decide for all vehicles.

        Args:
            observation: the present sensations of B vehicles.
            state: the result of `initial` or of the last `act`.
            generators: a generator for each of the B.

        Returns:
            The decisions, on the device of the observation, and the state for the next step.
        """
        ...
