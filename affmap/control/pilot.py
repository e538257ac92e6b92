"""One agent at the controls of one environment, step by step: observations in, actions out.

For flights that something else drives: a Gymnasium loop, a window, a camera. Many runs at once are in `episodes`.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap.control.agent import seeds_of
from affmap.control.controller import Controller, Decision, Observation
from affmap.control.episodes import bring
from affmap.control.mpc import PlanningAgent
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural, first_layout
from affmap.random import generator


class Thought(NamedTuple):
    """What the pilot had in mind when it chose an action; lengths in u. Positions that nothing expects are NaN."""

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

    def __init__(self, agent: Controller, layout: Layout | Procedural | str, seed: int = 0) -> None:
        """Take the controls in a world; everything random comes from `seed`.

        Raises:
            ConfigError: there is no such world, or the agent was trained with other channels.
            ValueError: the agent has several members.
        """
        seeds = seeds_of(agent)
        if len(seeds) != 1:
            raise ValueError(f"a pilot is one member, and this agent has {list(seeds)}; load a single one.")
        self.agent, self._seed = bring(agent, first_layout(layout, seeds[0])), seed
        self._device = agent.settings.device if isinstance(agent, PlanningAgent) else "cpu"
        self.reset()

    def reset(self) -> None:
        """Forget the last plan; to be called where the environment is reset."""
        self._state: Any = self.agent.initial(1)
        self._generators = [generator(self._seed, "planner", 0)]
        self._last: tuple[Observation, Any, Decision] | None = None

    def __call__(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """The action `[4]` for what the environment has returned."""
        seen, state = Observation.of([observation], self._device), self._state
        if isinstance(self.agent, PlanningAgent):
            decision, self._state = self.agent.act(seen, state, self._generators, self._watch)
        else:
            decision, self._state = self.agent.act(seen, state, self._generators)
        self._last = seen, state, decision
        return decision.action[0].cpu().numpy()

    def consider(self, observation: Mapping[str, np.ndarray]) -> Thought:
        """What it would have in mind; its memory stays as it is."""
        state = self._state
        self(observation)
        self._state = state
        return self.thought

    def _watch(self, actions: Tensor, costs: Tensor) -> None:
        self._tried = actions.detach(), costs.detach()

    @property
    def thought(self) -> Thought:
        """What it had in mind with its last action.

        Raises:
            ValueError: it has not acted yet.
        """
        if self._last is None:
            raise ValueError("the pilot has not acted yet; call it with an observation first.")
        seen, state, decision = self._last
        path, std = decision.path.mean[0], decision.path.log_std[0].exp()
        candidates, costs = path[None][:0], path.new_empty(0)
        if isinstance(self.agent, PlanningAgent):
            actions, (costs,) = self._tried
            with torch.no_grad():
                candidates = self.agent.imagine(seen, actions, state.carry).mean[0]
        return Thought(*(part.cpu().numpy() for part in (path, std, candidates, costs)))
