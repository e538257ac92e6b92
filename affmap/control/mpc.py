"""Model-predictive control: observe, plan, execute the first action, repeat (Section 3.4).

The base of all agents that plan, whether a learned model (`agent`) or the true physics (`oracle`) imagines outcomes.
One object steers B vehicles at once; it knows a planner, and no environment.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap.control.controller import Decision, Observation
from affmap.control.settings import ControlSettings
from affmap.control.time_to_go import TimeToGo
from affmap.env.body import ROUNDING
from affmap.gaussian import Gaussian
from affmap.model.transition import Carry
from affmap.planning.objective import expected_free_energy, goal_std
from affmap.planning.planner import Generators, Objective, Planner, is_planner
from affmap.settings import ConfigError
from affmap.settings.messages import format_value
from affmap.view import VisibleLayout


class AgentState(NamedTuple):
    """Memory of B agents from step to step."""

    planner: Any
    """State of their planner."""
    carry: Carry
    """Hidden state of their transition models, tensors `[M, B / M, hidden]`."""
    time_to_go: TimeToGo | None = None
    """Map by which they find their way; None before the first step, and without a guide."""
    is_open: np.ndarray | None = None
    """`[B]`, whether the doors of their worlds are open, because they have been at a key; None before the first step,
    and without doors."""


Watch = Callable[[Tensor, Tensor], None]
"""Called with the candidates `[B, N, H, 4]` of each iteration of a planner, and their costs `[B, N]`."""


class PlanningAgent(ABC):
    """B agents side by side.

    Attributes:
        planner: the planner.
        settings: the settings of control.
    """

    def __init__(self, planner: Planner, settings: ControlSettings) -> None:
        """Set the planner and the settings of control.

        Raises:
            ConfigError: the planner is none, or lacks a method.
        """
        if not is_planner(planner):
            raise ConfigError(
                f"planner = {format_value(planner)} is not allowed; give an object with the methods initial and plan, "
                "such as affmap.CEMPlanner()."
            )
        self.planner, self.settings = planner, settings
        self._present: tuple[np.ndarray, PlanningAgent] | None = None

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the M members; only 0 if nothing is learned."""
        return (0,)

    @property
    @abstractmethod
    def worlds(self) -> Sequence[VisibleLayout]:
        """Visible layouts as they are when flights begin: one shared by all agents, or one for each."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the arena that the agents are in, u."""
        return self.worlds[0].size

    @property
    def has_doors(self) -> bool:
        """Whether there are doors in any of the worlds."""
        return any(world.opened for world in self.worlds)

    @abstractmethod
    def merged(self, is_open: Sequence[bool]) -> PlanningAgent:
        """Copy of the agents in which the worlds of some are without doors; `is_open` `[B]` says of which."""

    def now(self, is_open: np.ndarray | None) -> PlanningAgent:
        """The agents in their present worlds, see `AgentState.is_open`; the last such copy is kept."""
        if is_open is None or not is_open.any():
            return self
        if self._present is None or not np.array_equal(self._present[0], is_open):
            self._present = is_open, self.merged(is_open.tolist())
        return self._present[1]

    def at_keys(self, positions: np.ndarray) -> np.ndarray:
        """Whether positions `[B, ..., 2]` (u) are inside a key of the world of each agent: `[B, ...]`."""
        share = len(positions) // len(self.worlds)
        return np.concatenate(
            [world.at_key(positions[number * share : (number + 1) * share]) for number, world in enumerate(self.worlds)]
        )

    @abstractmethod
    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Imagine positions along candidates `[B, N, H, 4]`: Gaussian of `[B, N, H, 2]`, u; `carry` see `objective`."""

    @abstractmethod
    def predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """Predict the next carry and the change of position caused by `action` `[B, 4]`."""

    def initial_carry(self, num_problems: int) -> Carry:
        """Hidden state where flights of B problems begin; empty without one."""
        return ()

    def initial(self, num_problems: int) -> AgentState:
        """State before the first step, for B problems."""
        return AgentState(self.planner.initial(num_problems, self.settings.device), self.initial_carry(num_problems))

    def act(
        self, observation: Observation, state: AgentState, generators: Generators, watch: Watch | None = None
    ) -> tuple[Decision, AgentState]:
        """Plan for all vehicles, starting from the last plans.

        With a guide, the desired position is a sub-goal on the shortest way to the goal.

        Args:
            observation: the present sensations of B vehicles.
            state: the result of `initial` or of the last `act`.
            generators: a generator for each of the B.
            watch: called with the candidates of the planner and their costs.

        Returns:
            The decisions, and the state for the next step.

        Raises:
            ValueError: the planner's candidates or its plan have another shape or type, or an action that would be
                executed is outside [0, 1].
        """
        is_open = self._open(observation, state.is_open)
        present, time_to_go = self.now(is_open), self._time_to_go(observation, state.time_to_go)
        objective = present.objective(self._toward_subgoals(observation, time_to_go, is_open), state.carry)
        num_problems, dtype, name = len(observation.position), observation.position.dtype, type(self.planner).__name__

        def watched(actions: Tensor) -> Tensor:
            _check(actions, f"candidates of {name}", (num_problems, "N", "H", 4), dtype)
            costs = objective(actions)
            if watch:
                watch(actions.clone(), costs)  # planners may write their candidates again
            return costs

        planned = self.planner.plan(watched, state.planner, generators)
        if not (isinstance(planned, tuple) and len(planned) == 2 and hasattr(planned[0], "actions")):
            raise ValueError(
                f"{name}.plan returned the type {type(planned).__name__}; it should return a tuple of a Plan and the "
                "state for the next step."
            )
        plan, planner_state = planned
        _check(plan.actions, f"actions of the plan of {name}", (num_problems, "H", 4), dtype)
        action = plan.actions[:, 0]
        wrong = ~((action >= -ROUNDING) & (action <= 1 + ROUNDING))  # NaN, too
        if wrong.any():
            raise ValueError(f"the first action of a plan of {name} has {action[wrong][0]:g}; it should be in [0, 1].")
        with torch.no_grad():
            path = present.imagine(observation, plan.actions[:, None], state.carry)
            carry, delta = present.predict(observation, action, state.carry)
        decision = Decision(action, Gaussian(*(part[:, 0] for part in path)), delta)
        return decision, AgentState(planner_state, carry, time_to_go, is_open)

    def _open(self, observation: Observation, before: np.ndarray | None) -> np.ndarray | None:
        """Whether doors are open now, see `AgentState.is_open`: a vehicle that is reported at a key has opened them."""
        if not self.has_doors:
            return None
        at_keys = self.at_keys(observation.position.cpu().numpy())
        return at_keys if before is None else before | at_keys

    def _time_to_go(self, observation: Observation, last: TimeToGo | None) -> TimeToGo | None:
        """The map of times to go; `last` as long as the goals are its own."""
        if self.settings.guide == "none":
            return None
        goals = observation.goal.cpu().numpy()
        return last if last and np.array_equal(last.goals, goals) else TimeToGo.imagine(self, goals)

    def _toward_subgoals(
        self, observation: Observation, time_to_go: TimeToGo | None, is_open: np.ndarray | None
    ) -> Observation:
        """The observation with sub-goals in place of the goals, if there is a map."""
        if time_to_go is None:
            return observation
        subgoals = time_to_go.subgoals(observation.position.cpu().numpy(), self.settings.guide_distance, is_open)
        return observation._replace(goal=torch.from_numpy(subgoals).to(observation.goal))

    def objective(self, observation: Observation, carry: Carry | None = None) -> Objective:
        """Objective for plans: the expected free energy of the paths imagined from an observation.

        `carry` is that of the agents' state; without one, the flight begins here.
        """
        goal, std = observation.goal[:, None], self.goal_std(observation)[:, None]  # one for all candidates

        def objective(actions: Tensor) -> Tensor:
            path = self.imagine(observation, actions, carry)
            if self.settings.reports == "noisy":
                path = path._replace(log_std=std.log()[..., None, None].expand_as(path.mean))
            return expected_free_energy(path, goal, std, self.settings.beta).total

        return objective

    def goal_std(self, observation: Observation) -> Tensor:
        """Standard deviation of the desired position, `[B]` (u)."""
        settings = self.settings
        return goal_std(
            observation.position,
            observation.goal,
            settings.goal_std_far,
            settings.goal_std_near,
            settings.near_distance,
        )


def _check(actions: Any, name: str, shape: tuple[int | str, ...], dtype: torch.dtype) -> None:
    """Check what a planner hands over; letters of `shape` stand for any number above 0.

    Raises:
        ValueError: it is another thing, or has another shape or type.
    """
    if isinstance(actions, Tensor):
        fits = len(actions.shape) == len(shape) and all(
            there > 0 if isinstance(number, str) else there == number
            for there, number in zip(actions.shape, shape, strict=True)
        )
        if fits and actions.dtype == dtype:
            return
        came = f"the shape {list(actions.shape)} and the type {actions.dtype}"
    else:
        came = f"the type {type(actions).__name__}"
    expected = f"[{', '.join(map(str, shape))}]"
    raise ValueError(f"the {name} have {came}; they should be a tensor {expected} of {dtype}.")
