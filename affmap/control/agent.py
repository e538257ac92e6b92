"""Model-predictive control: observe, plan, execute the first action, and do it again (Section 3.4).

One agent object steers B vehicles at once, the same number for each member of a stack (member-major). It knows a
stack, a look-up and a planner; it knows no environment.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from affmap import compiled
from affmap.control.controller import Controller
from affmap.control.controller import Decision as Decision
from affmap.control.controller import Observation as Observation
from affmap.control.settings import ControlSettings as ControlSettings
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian, nll
from affmap.model.code_cache import CachedEncoder
from affmap.model.direct import DirectEncoder
from affmap.model.lookup import Lookup
from affmap.model.rollout import Situation, rollout
from affmap.model.stack import Stack
from affmap.model.transition import Carry
from affmap.planning.objective import expected_free_energy, goal_std
from affmap.planning.planner import Generators, Objective, Planner
from affmap.settings import ConfigError
from affmap.view import Map

if TYPE_CHECKING:  # needs numba
    from affmap.control.imagination import CompiledImagination


class AgentState(NamedTuple):
    """What B agents remember from step to step."""

    planner: Any
    """State of their planner."""
    carry: Carry
    """Hidden state of their transition models, tensors `[M, B / M, hidden]`."""


Watch = Callable[[Tensor, Tensor], None]
"""Called with the candidates `[B, N, H, 4]` of each iteration of a planner, and their costs `[B, N]`."""


class Agent:
    """B agents side by side.

    Attributes:
        stack: M members.
        lookup: context codes of the same members, in the world or the worlds that they fly in.
        planner: how plans are made.
        settings: what plans are for.
        channels: names of the K channels that the members have learned to see; None where they are not known.
    """

    def __init__(
        self,
        stack: Stack,
        lookup: Lookup,
        planner: Planner,
        settings: ControlSettings,
        channels: Sequence[str] | None = None,
    ) -> None:
        """Put an agent together; `lookup` must belong to `stack`, whose weights cease to require gradients."""
        self.stack = stack.requires_grad_(False)
        self.lookup, self.planner, self.settings, self.channels = lookup, planner, settings, channels
        self._direct, self._cached = DirectEncoder(self.stack), CachedEncoder(self.stack)
        self._compiled = self._compile()

    @property
    def seeds(self) -> tuple[int, ...]:
        """The members' own seeds, M of them."""
        return self.stack.seeds

    def elsewhere(self, worlds: Sequence[Map]) -> "Agent":
        """The same agent in another world, or in B others (member-major)."""
        lookup = self.lookup.elsewhere(self.stack, worlds)
        return Agent(self.stack, lookup, self.planner, self.settings, self.channels)

    def initial(self, num_problems: int) -> AgentState:
        """The state before the first step, for B problems."""
        carry = self.stack.transition.initial(num_problems // len(self.seeds))
        return AgentState(self.planner.initial(num_problems, self.settings.device), carry)

    def act(
        self, observation: Observation, state: AgentState, generators: Generators, watch: Watch | None = None
    ) -> tuple[Decision, AgentState]:
        """Plan for all, from where the last plans ended.

        Args:
            observation: what B vehicles sense now.
            state: what `initial` or the last `act` returned.
            generators: a generator for each of the B.
            watch: gets to see what the planner tries.

        Returns:
            The decisions, and the state for the next step.
        """
        objective = self.objective(observation, state.carry)

        def watched(actions: Tensor) -> Tensor:
            costs = objective(actions)
            if watch:
                watch(actions.clone(), costs)  # planners may write their candidates again
            return costs

        plan, planner_state = self.planner.plan(watched, state.planner, generators)
        with torch.no_grad():
            path = self.imagine(observation, plan.actions[:, None], state.carry)
            action = plan.actions[:, 0]
            carry, delta = self._predict(observation, action, state.carry)
        return Decision(action, Gaussian(*(part[:, 0] for part in path)), delta), AgentState(planner_state, carry)

    def objective(self, observation: Observation, carry: Carry | None = None) -> Objective:
        """What plans are to minimise: the expected free energy of the paths that are imagined from an observation.

        `carry` is that of the agents' state; without one, the flight begins here.
        """
        goal, std = observation.goal, self._goal_std(observation)
        if self._compiled:
            return self._compiled.objective(self._situation(observation, carry), goal, std, self.settings.beta)
        goal, std = goal[:, None], std[:, None]  # one for all candidates

        def objective(actions: Tensor) -> Tensor:
            path = self.imagine(observation, actions, carry)
            return expected_free_energy(path, goal, std, self.settings.beta).total

        return objective

    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Positions along candidates `[B, N, H, 4]`: a Gaussian of `[B, N, H, 2]`, u; `carry` as in `objective`."""
        situation = self._situation(observation, carry)
        if self._compiled and not (torch.is_grad_enabled() and actions.requires_grad):
            return self._compiled.positions(situation, actions)
        return rollout(self.stack.transition, self.lookup, situation, actions)

    def _compile(self) -> "CompiledImagination | None":
        """Imagination in compiled loops, where there is one for these models and this look-up."""
        if not compiled.enabled():
            return None
        from affmap.control.imagination import compiled_imagination

        return compiled_imagination(self.stack, self.lookup)

    def _situation(self, observation: Observation, carry: Carry | None) -> Situation:
        """Where imagined paths start; without a carry, where a flight begins."""
        if carry is None:
            carry = self.stack.transition.initial(len(observation.position) // len(self.seeds))
        return Situation(observation.position, observation.delta, carry)

    def _goal_std(self, observation: Observation) -> Tensor:
        settings = self.settings
        return goal_std(
            observation.position,
            observation.goal,
            settings.goal_std_far,
            settings.goal_std_near,
            settings.near_distance,
        )

    def _predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """The next carry and change of position, from the view that the vehicle really has, as in training."""
        num_members = len(self.stack.seeds)
        view, delta, action = (
            part.unflatten(0, (num_members, -1)) for part in (observation.view, observation.delta, action)
        )
        codes = self._direct.of_views(view)
        if codes is None:
            codes = self._cached(view)
        carry, prediction = self.stack.transition.step()(carry, codes, delta, action)
        return carry, Gaussian(*(part.flatten(0, 1) for part in prediction))


def check_channels(agent: Agent, layout: Layout) -> None:
    """Make sure that an agent can see a world.

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
    """The seeds of an agent's members; 0 alone for a controller that is no `Agent`."""
    return controller.seeds if isinstance(controller, Agent) else (0,)


def bring(controller: Controller, layout: Layout) -> Controller:
    """The controller in a world: an `Agent` with a look-up of that world, any other as it is.

    Raises:
        ConfigError: the agent was trained with other channels.
    """
    if not isinstance(controller, Agent):
        return controller
    check_channels(controller, layout)
    return controller.elsewhere([layout.map])


def prediction_error(decision: Decision, delta: Tensor) -> Tensor:
    """Negative log-likelihood of the changes of position `[B, 2]` that came to be: `[B]` in nats, NaN without one."""
    return nll(decision.delta, delta)
