"""One agent at the controls of one environment, step by step: observations in, actions out.

For flights in a loop of the caller: Gymnasium, a window, a camera. `episodes` has many runs at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap.control import arguments
from affmap.control.agent import seeds_of
from affmap.control.controller import Controller, Decision, Observation
from affmap.control.episodes import bring
from affmap.control.mpc import PlanningAgent
from affmap.control.time_to_go import TimeToGo
from affmap.env.procedural import AnyLayout, first_layout
from affmap.random import generator
from affmap.settings.messages import format_value
from affmap.threads import limited
from affmap.view import PIXELS


class Thought(NamedTuple):
    """Details of the plan behind an action; lengths in u. Positions are NaN for agents that predict nothing."""

    path: np.ndarray
    """`[H, 2]`, expected positions."""
    std: np.ndarray
    """`[H, 2]`, standard deviations of the predicted positions."""
    candidates: np.ndarray
    """`[N, H, 2]`, expected positions of the planner's last candidates; N is 0 without a planner."""
    costs: np.ndarray
    """`[N]`, their expected free energy, nats."""


class Pilot:
    """Flies `affmap/Vehicle-v0` with any controller, such as an agent of one member: `action = pilot(observation)`."""

    def __init__(
        self,
        agent: Controller,
        layout: AnyLayout,
        seed: int = 0,
        *,
        threads: int = 1,
    ) -> None:
        """Take the controls in a world; all randomness comes from `seed`.

        Each call computes with `threads` threads of PyTorch.

        Raises:
            ConfigError: there is no such world, or the agent was trained with other channels, or there are no threads.
            ValueError: the agent has several members.
        """
        seeds = seeds_of(arguments.agent(agent))
        if len(seeds) != 1:
            raise ValueError(f"a pilot is one member, and this agent has {list(seeds)}; load a single one.")
        self._seed, self._threads = seed, threads
        world = first_layout(layout, seeds[0])
        self._shapes = {"position": [2], "delta": [2], "goal": [2], "view": [len(world.channels), PIXELS, PIXELS]}
        with limited(threads):
            self.agent = bring(agent, world)
        self._device = agent.settings.device if isinstance(agent, PlanningAgent) else "cpu"
        self.reset()

    def __repr__(self) -> str:
        return f"Pilot({self.agent!r}, seed {self._seed})"

    def reset(self) -> None:
        """Forget the last plan; to be called when the environment is reset."""
        self._state: Any = self.agent.initial(1)
        self._generators = [generator(self._seed, "planner", 0)]
        self._last: tuple[Observation, Any, Decision] | None = None

    def __call__(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Action `[4]` for an observation of the environment.

        Raises:
            ValueError: it is no observation of one vehicle in the pilot's world, or a number in it is not finite.
        """
        self._check(observation)
        batch, state = Observation.of([observation], self._device), self._state
        with limited(self._threads):
            if isinstance(self.agent, PlanningAgent):
                decision, self._state = self.agent.act(batch, state, self._generators, self._watch)
            else:
                decision, self._state = self.agent.act(batch, state, self._generators)
        self._last = batch, state, decision
        return decision.action[0].cpu().numpy()

    def _check(self, observation: Mapping[str, np.ndarray]) -> None:
        if fault := self._fault(observation):
            expected = ", ".join(f"{key} {shape}" for key, shape in self._shapes.items())
            raise ValueError(f"{fault}; give a dictionary of finite numbers for one vehicle: {expected}.")

    def _fault(self, observation: Mapping[str, np.ndarray]) -> str | None:
        """The first mistake of an observation."""
        if not isinstance(observation, Mapping):
            return f"the observation is {format_value(observation)}"
        for key, shape in self._shapes.items():
            if key not in observation:
                return f"the observation has no {key}"
            value = observation[key]
            try:
                array = np.asarray(value)
            except (TypeError, ValueError, RuntimeError):  # rows of several lengths, or a tensor that NumPy cannot read
                return f"the observation's {key} is {format_value(value)}"
            if list(array.shape) != shape:
                return f"the observation's {key} has the shape {list(array.shape)}"
            if array.dtype.kind not in "biuf" or not (abs(array) <= np.finfo(np.float32).max).all():
                return f"the observation's {key} is {format_value(array.tolist())}"
        return None

    def consider(self, observation: Mapping[str, np.ndarray]) -> Thought:
        """Preview the plan for an observation; the state of the pilot stays as it is."""
        state = self._state
        self(observation)
        self._state = state
        return self.thought

    @property
    def time_to_go(self) -> TimeToGo | None:
        """Map by which the agent finds its way now; None without a guide, and before it has acted."""
        if not isinstance(self.agent, PlanningAgent):
            return None
        made, is_open = self._state.time_to_go, self._state.is_open
        return made.opened if made and is_open is not None and is_open.any() else made

    def _watch(self, actions: Tensor, costs: Tensor) -> None:
        self._candidates = actions.detach(), costs.detach()

    @property
    def thought(self) -> Thought:
        """Details of the plan behind the last action.

        Raises:
            ValueError: it has not acted yet.
        """
        if self._last is None:
            raise ValueError("the pilot has not acted yet; call it with an observation first.")
        batch, state, decision = self._last
        path, std = decision.path.mean[0], decision.path.log_std[0].exp()
        candidates, costs = path[None][:0], path.new_empty(0)
        if isinstance(self.agent, PlanningAgent):
            actions, (costs,) = self._candidates
            with torch.no_grad(), limited(self._threads):
                candidates = self.agent.now(self._state.is_open).imagine(batch, actions, state.carry).mean[0]
        return Thought(*(part.cpu().numpy() for part in (path, std, candidates, costs)))
