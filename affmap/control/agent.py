"""The paper's agent, which plans by the imagination of a stack of models.

One agent object steers B vehicles at once, the same number for each member of a stack (member-major). It knows a
stack, a look-up and a planner; it knows no environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import torch
from torch import Tensor

from affmap import compiled
from affmap.control.controller import Controller
from affmap.control.controller import Decision as Decision
from affmap.control.controller import Observation as Observation
from affmap.control.mpc import AgentState as AgentState
from affmap.control.mpc import PlanningAgent
from affmap.control.settings import ControlSettings as ControlSettings
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian, nll
from affmap.lazy import notebook
from affmap.model.code_cache import CachedEncoder
from affmap.model.direct import DirectEncoder
from affmap.model.lookup import Lookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import Stack
from affmap.model.transition import Carry
from affmap.planning.planner import Objective, Planner
from affmap.settings import ConfigError
from affmap.settings.messages import counted
from affmap.view import VisibleLayout

if TYPE_CHECKING:  # needs numba
    from affmap.control.imagination import CompiledImagination


class Agent(PlanningAgent):
    """The paper's agent: at every step, it plans in the imagination of its models. B of them fly side by side.

    `affmap.load` and `affmap.train` return one; `affmap.fly`, `affmap.evaluate` and `affmap.Pilot` fly it.

    Attributes:
        stack: M members.
        lookup: context codes of the same members, in the world or the worlds that they fly in.
        planner: the planner.
        settings: the settings of control.
        channels: names of the K channels that the members have learned to see; None if unknown.
        vehicle: physical constants of the vehicle that they have learned to fly; None if unknown.
        losses: those of their training, a row for each member and epoch, with the columns `member` (its seed), `epoch`
            (from 1), `training_nll` and `validation_nll` (nats); None if unknown.
    """

    def __init__(
        self,
        stack: Stack,
        lookup: Lookup,
        planner: Planner,
        settings: ControlSettings,
        channels: Sequence[str] | None = None,
        vehicle: Vehicle | None = None,
        losses: pd.DataFrame | None = None,
    ) -> None:
        """Assemble an agent; `lookup` must belong to `stack`, whose weights cease to require gradients."""
        super().__init__(planner, settings)
        self.stack, self.lookup = stack.requires_grad_(False), lookup
        self.channels, self.vehicle, self.losses = channels, vehicle, losses
        self._direct, self._cached = DirectEncoder(self.stack), CachedEncoder(self.stack)
        self._compiled = loops_of(stack, lookup)

    def __repr__(self) -> str:
        members, size = counted(len(self.seeds), "member"), self.stack.context_size
        kind, planner = self.stack.settings.transition_name, type(self.planner).__name__
        return f"Agent({members}, C = {size}, {kind}, {planner}, {self.lookup!r})"

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the M members."""
        return self.stack.seeds

    @property
    def worlds(self) -> Sequence[VisibleLayout]:
        """Visible layouts of its look-up: one shared by all, or one for each vehicle."""
        return self.lookup.worlds

    def elsewhere(self, worlds: Sequence[VisibleLayout]) -> Agent:
        """Copy of the agent for another world, or for B others (member-major).

        Raises:
            ConfigError: the worlds are no list of visible layouts, such as `[layout.map]`.
        """
        return self.looking_up(self.lookup.elsewhere(self.stack, worlds))

    def merged(self, is_open: Sequence[bool]) -> Agent:
        """Copy in which some worlds are without doors, see `PlanningAgent.merged`."""
        return self.looking_up(self.lookup.merged(self._opened, is_open))

    def looking_up(self, lookup: Lookup) -> Agent:
        """Copy of the agent that has its codes from another look-up of the same stack."""
        return Agent(self.stack, lookup, self.planner, self.settings, self.channels, self.vehicle, self.losses)

    @cached_property
    def _opened(self) -> Lookup:
        """The look-up in the same worlds without doors."""
        return self.lookup.elsewhere(self.stack, [world.opened or world for world in self.worlds])

    def save(self, folder: str | Path) -> None:
        """Write the agent into a folder, from where `affmap.load` makes an agent that flies the same runs.

        The folder holds weights, settings, vehicle, losses and the visible part of its world. An agent that was saved
        there earlier is replaced, and nothing else is: any other file stays, and is an error.

        Raises:
            ConfigError: the folder cannot be used, or holds something else; or a part of the agent cannot be saved,
                because no settings describe it.
        """
        from affmap.control.saved import save

        save(self, folder)

    def _repr_html_(self) -> str | None:
        return notebook.agent(self)

    def initial_carry(self, num_problems: int) -> Carry:
        """Hidden state of the transition models where flights of B problems begin."""
        return self.stack.transition.initial(num_problems // len(self.seeds))

    def objective(self, observation: Observation, carry: Carry | None = None) -> Objective:
        """Objective for plans, see `PlanningAgent.objective`."""
        if self._compiled is None or self.settings.reports == "noisy":
            return super().objective(observation, carry)
        situation, std = self._situation(observation, carry), self.goal_std(observation)
        return self._compiled.objective(situation, observation.goal, std, self.settings.beta)

    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Imagine candidates, see `PlanningAgent.imagine`."""
        situation = self._situation(observation, carry)
        if self.settings.reports == "noisy":
            sensed = self.sensed(observation)
            return rollout(self.stack.transition, self.lookup, situation, actions, code=sensed)
        if self._compiled and not (torch.is_grad_enabled() and actions.requires_grad):
            return self._compiled.positions(situation, actions)
        return rollout(self.stack.transition, self.lookup, situation, actions)

    def _situation(self, observation: Observation, carry: Carry | None) -> Situation:
        """Start of imagined paths; without a carry, the start of a flight."""
        if carry is None:
            carry = self.initial_carry(len(observation.position))
        return Situation(observation.position, observation.delta, carry)

    def predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """Predict the next step from the true view, as in training; see `PlanningAgent.predict`."""
        delta, action = (part.unflatten(0, (len(self.stack.seeds), -1)) for part in (observation.delta, action))
        carry, prediction = self.stack.transition.step()(carry, self.sensed(observation), delta, action)
        return carry, Gaussian(*(part.flatten(0, 1) for part in prediction))

    def sensed(self, observation: Observation) -> Tensor:
        """Context codes of the views at the vehicles, `[M, B / M, C]`."""
        view = observation.view.unflatten(0, (len(self.stack.seeds), -1))
        codes = self._direct.of_views(view)
        return self._cached(view) if codes is None else codes


def loops_of(stack: Stack, lookup: Lookup) -> CompiledImagination | None:
    """Imagination in compiled loops, if there is one for these models and this look-up."""
    if not compiled.enabled():
        return None
    from affmap.control.imagination import compiled_imagination

    return compiled_imagination(stack, lookup)


def check_channels(agent: Agent, layout: Layout) -> None:
    """Check that an agent can see a layout.

    Raises:
        ConfigError: it has been trained with other channels.
    """
    names, number = agent.channels, agent.stack.num_channels
    if len(layout.channels) != number or (names and tuple(names) != layout.channels):
        raise ConfigError(
            f"layout {layout.name!r} has channels {list(layout.channels)}, and the agent was trained with "
            f"{list(names) if names else number}; a model sees the same ones everywhere."
        )


def seeds_of(controller: Controller) -> tuple[int, ...]:
    """Seeds of an agent's members; only 0 for a controller that does not plan."""
    return controller.seeds if isinstance(controller, PlanningAgent) else (0,)


def prediction_error(decision: Decision, delta: Tensor) -> Tensor:
    """Negative log-likelihood of the observed changes of position `[B, 2]`: `[B]` in nats, NaN without a prediction."""
    return nll(decision.delta, delta)
