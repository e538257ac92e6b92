"""Model-predictive control: observe, plan, execute the first action, and do it again (Section 3.4).

One agent object steers B vehicles at once, the same number for each member of a stack (member-major). It knows a
stack, a look-up and a planner; it knows no environment.
"""

from typing import Any, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from affmap.gaussian import Gaussian, nll
from affmap.model.codes import ViewCodes
from affmap.model.lookup import Lookup
from affmap.model.stack import Stack
from affmap.model.world import Situation, rollout
from affmap.planning.objective import expected_free_energy, goal_std
from affmap.planning.planner import Generators, Objective, Planner
from affmap.settings import Count, NonNegative, Positive, Settings


class ControlSettings(Settings):
    """How agents are controlled and evaluated (`conf/control`)."""

    num_steps: Count
    """T, steps of a run."""
    runs_per_member: Count
    """Run r of a member starts in corner r modulo 4."""
    beta: NonNegative
    """Weight of the uncertainty in the expected free energy."""
    goal_std_far: Positive
    """Standard deviation of the desired position, u."""
    goal_std_near: Positive
    """The same once the goal is near, u."""
    near_distance: Positive
    """Distance to the goal below which it is near, u."""
    goal_radius: Positive
    """Distance to the goal below which it is reached, u."""
    device: str = Field(pattern=r"^(cpu|cuda(:[0-9]{1,2})?)$", exclude=True)
    """Where to plan: cpu or cuda."""


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


class Decision(NamedTuple):
    """What B vehicles do next, and what they expect."""

    action: Tensor
    """`[B, 4]`, to be executed now."""
    path: Gaussian
    """Expected positions if the whole plan were executed, of `[B, H, 2]`, u."""
    delta: Gaussian
    """Expected change of position in the next step, of `[B, 2]`, u/step, from the view at the vehicle."""


class Agent:
    """B agents side by side."""

    def __init__(self, stack: Stack, lookup: Lookup, planner: Planner, settings: ControlSettings) -> None:
        """Put an agent together; `lookup` must belong to `stack`, whose weights cease to require gradients."""
        self._stack = stack.requires_grad_(False)
        self._lookup, self._planner, self._settings = lookup, planner, settings
        self._codes = ViewCodes(self._stack)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The members' own seeds, M of them."""
        return self._stack.seeds

    def initial(self, num_problems: int) -> Any:
        """The planner's state before the first step, for B problems."""
        return self._planner.initial(num_problems, self._settings.device)

    def act(self, observation: Observation, state: Any, generators: Generators) -> tuple[Decision, Any]:
        """Plan for all, from where the last plans ended.

        Args:
            observation: what B vehicles sense now.
            state: what `initial` or the last `act` returned.
            generators: a generator for each of the B.

        Returns:
            The decisions, and the state for the next step.
        """
        plan, state = self._planner.plan(self.objective(observation), state, generators)
        with torch.no_grad():
            path = self._imagine(observation, plan.actions[:, None])
            action = plan.actions[:, 0]
            decision = Decision(action, Gaussian(*(part[:, 0] for part in path)), self._predict(observation, action))
        return decision, state

    def objective(self, observation: Observation) -> Objective:
        """What plans are to minimise: the expected free energy of the paths that are imagined from an observation."""
        goal = observation.goal[:, None]  # one for all candidates
        std = self._goal_std(observation)[:, None]

        def objective(actions: Tensor) -> Tensor:
            path = self._imagine(observation, actions)
            return expected_free_energy(path, goal, std, self._settings.beta).total

        return objective

    def _imagine(self, observation: Observation, actions: Tensor) -> Gaussian:
        """Positions along candidates `[B, N, H, 4]`: a Gaussian of `[B, N, H, 2]`, u."""
        transition = self._stack.transition
        situation = Situation(observation.position, observation.delta, transition.initial())
        return rollout(transition, self._lookup, situation, actions)

    def _goal_std(self, observation: Observation) -> Tensor:
        settings = self._settings
        return goal_std(
            observation.position,
            observation.goal,
            settings.goal_std_far,
            settings.goal_std_near,
            settings.near_distance,
        )

    def _predict(self, observation: Observation, action: Tensor) -> Gaussian:
        """The next change of position, from the view that the vehicle really has, as in training."""
        num_members = len(self._stack.seeds)
        view, delta, action = (
            part.unflatten(0, (num_members, -1)) for part in (observation.view, observation.delta, action)
        )
        transition = self._stack.transition
        _, prediction = transition.step()(transition.initial(), self._codes(view), delta, action)
        return Gaussian(*(part.flatten(0, 1) for part in prediction))


def prediction_error(decision: Decision, delta: Tensor) -> Tensor:
    """Negative log-likelihood of the changes of position `[B, 2]` that came to be: `[B]` in nats."""
    return nll(decision.delta, delta)
