"""One agent at the controls of one environment, step by step: observations in, actions out.

For flights that something else drives: a Gymnasium loop, a window, a camera. Many runs at once are in `episodes`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap.control.agent import Agent, AgentState, Decision, Observation, check_channels
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural, world
from affmap.model.transition import Carry
from affmap.random import generator


class Thought(NamedTuple):
    """What the pilot had in mind when it chose an action; lengths in u."""

    path: np.ndarray
    """`[H, 2]`, expected positions."""
    std: np.ndarray
    """`[H, 2]`, standard deviations of the predicted positions."""
    candidates: np.ndarray
    """`[N, H, 2]`, expected positions of the planner's last candidates."""
    costs: np.ndarray
    """`[N]`, their expected free energy, nats."""


class Pilot:
    """Flies `affmap/Vehicle-v0` with an agent of one member: `action = pilot(observation)`."""

    def __init__(self, agent: Agent, layout: Layout | Procedural | str, seed: int = 0) -> None:
        """Take the controls in a world; everything random comes from `seed`.

        Raises:
            ConfigError: there is no such world, or the agent was trained with other channels.
            ValueError: the agent has several members.
        """
        if len(agent.seeds) != 1:
            raise ValueError(f"a pilot is one member, and this agent has {list(agent.seeds)}; load a single one.")
        flown = world(layout, agent.seeds[0])
        check_channels(agent, flown)
        self.agent, self._seed = agent.elsewhere([flown.map]), seed
        self.reset()

    def reset(self) -> None:
        """Forget the last plan; to be called where the environment is reset."""
        self._state: AgentState = self.agent.initial(1)
        self._generators = [generator(self._seed, "planner", 0)]
        self._last: tuple[Observation, Carry, Decision] | None = None

    def __call__(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """The action `[4]` for what the environment has returned."""
        seen, carry = Observation.of([observation], self.agent.settings.device), self._state.carry
        decision, self._state = self.agent.act(seen, self._state, self._generators, self._watch)
        self._last = seen, carry, decision
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
        seen, carry, decision = self._last
        actions, costs = self._tried
        with torch.no_grad():
            candidates = self.agent.imagine(seen, actions, carry).mean[0]
        parts = decision.path.mean[0], decision.path.log_std[0].exp(), candidates, costs[0]
        return Thought(*(part.cpu().numpy() for part in parts))
