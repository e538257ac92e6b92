"""Agents that know the true physics, to measure the value of a perfect model and of each half of one.

A model-predictive agent predicts a mean and a standard deviation of every step. An oracle takes both from the world, a
half oracle takes one of them, and the other from a trained agent. Planner, sensors and starts are the same, so
the difference in performance is the cost of errors in that part of the model. An oracle that is `as_seen` knows no more
than views show: not how many fields overlap at a place. (The paper has no such agents.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from affmap import compiled
from affmap.control.agent import Agent, check_channels
from affmap.control.controller import Observation
from affmap.control.mpc import PlanningAgent
from affmap.control.registry import OracleSettings
from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian
from affmap.model.rollout import Situation, rollout
from affmap.model.transition import Carry
from affmap.planning.planner import Planner
from affmap.settings import ConfigError
from affmap.settings.messages import counted
from affmap.view import VisibleLayout


class Oracle(PlanningAgent):
    """B agents that plan with the true physics.

    A step is known up to `step_std`; only changes of position that are reported from inside fog have the noise of both
    ends. Variances add up along a path, as those of a model do.
    """

    def __init__(
        self,
        layouts: Sequence[Layout],
        vehicle: Vehicle,
        planner: Planner,
        settings: ControlSettings,
        step_std: float | None = None,
        as_seen: bool = False,
    ) -> None:
        """Know the world that all agents fly in, or the worlds of B (member-major).

        Args:
            layouts: one layout, or B.
            vehicle: its physical constants.
            planner: one that needs no gradients: physics has none.
            settings: the settings of control.
            step_std: standard deviation of a true step outside fog, u; None for that of `conf/agent/oracle.yaml`.
            as_seen: whether overlapping fields of one look and effect are taken for one.

        Raises:
            ConfigError: there is no layout, the standard deviation is not positive, or numba is not installed.
        """
        super().__init__(planner, settings)
        if not layouts:
            raise ConfigError("layouts is empty; an oracle needs the world that it flies in.")
        if step_std is not None and not step_std > 0:
            raise ConfigError(f"step_std = {step_std} should be above 0 (u).")
        if not compiled.installed():
            raise ConfigError("an oracle needs numba, which is not installed.")
        from affmap.env.twin import Twin  # needs numba

        self.vehicle = vehicle
        self.step_std = OracleSettings.load("agent", "oracle").std if step_std is None else step_std
        self._twin, self._layouts, self._as_seen = Twin(layouts, vehicle, as_seen), layouts, as_seen

    def __repr__(self) -> str:
        seen = ", as seen" if self._as_seen else ""
        return f"{type(self).__name__}({type(self.planner).__name__}, {counted(len(self._twin), 'world')}{seen})"

    @property
    def worlds(self) -> Sequence[VisibleLayout]:
        """Visible parts of the layouts that it knows: one shared by all, or one for each vehicle."""
        return [layout.map for layout in self._layouts]

    def merged(self, is_open: Sequence[bool]) -> Oracle:
        """Copy in which some worlds are without doors, see `PlanningAgent.merged`."""
        return self.elsewhere(self._merged_layouts(is_open))

    def _merged_layouts(self, is_open: Sequence[bool]) -> list[Layout]:
        """The layout of each of B agents, some without doors."""
        layouts = [self._layouts[number * len(self._layouts) // len(is_open)] for number in range(len(is_open))]
        return [each.opened if opened else each for each, opened in zip(layouts, is_open, strict=True)]

    def elsewhere(self, layouts: Sequence[Layout], vehicle: Vehicle | None = None) -> Oracle:
        """Copy of the agent for another world, or for B others (member-major), and perhaps for another vehicle."""
        return Oracle(layouts, vehicle or self.vehicle, self.planner, self.settings, self.step_std, self._as_seen)

    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Imagine candidates, see `PlanningAgent.imagine`."""
        mean = self.true_path(observation, actions)
        return Gaussian(mean, self.true_log_std(observation, mean))

    def predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """Predict the next step, see `PlanningAgent.predict`."""
        path = self.imagine(observation, action[:, None, None])
        return carry, Gaussian(path.mean[:, 0, 0] - observation.position, path.log_std[:, 0, 0])

    def true_path(self, observation: Observation, actions: Tensor) -> Tensor:
        """Positions along candidates `[B, N, H, 4]` if the vehicle is where it is reported: `[B, N, H, 2]`, u."""
        num_problems, num_candidates = actions.shape[:2]
        start, delta = (_array(part).repeat(num_candidates, 0) for part in (observation.position, observation.delta))
        worlds = self._worlds(num_problems, num_problems * num_candidates)
        paths = self._twin.fly(worlds, start, delta, _array(actions.flatten(0, 1)))
        return torch.from_numpy(paths.astype(np.float32)).to(actions.device).unflatten(0, (-1, num_candidates))

    def true_log_std(self, observation: Observation, path: Tensor) -> Tensor:
        """Logarithms of the standard deviations of reported positions along paths `[B, N, H, 2]`: `[B, N, H, 2]`."""
        start = observation.position[:, None, None].expand(-1, path.shape[1], -1, -1)
        places = _array(torch.cat([start, path], dim=2))  # [B, N, 1 + H, 2]
        worlds = self._worlds(len(places), places[..., 0].size)
        in_fog = self._twin.in_fog(worlds, places.reshape(-1, 2)).reshape(places.shape[:-1])
        noisy = in_fog[..., 1:].astype(np.float32) + in_fog[..., :-1]  # ends of a step, 0 to 2
        variance = np.cumsum(noisy * self.vehicle.fog_std**2 + self.step_std**2, axis=-1)
        log_std = torch.from_numpy(0.5 * np.log(variance)).to(path)
        return log_std[..., None].expand(path.shape)

    def _worlds(self, num_problems: int, number: int) -> np.ndarray:
        """Index of the world of each path, `[number]`; paths are in the order of the problems.

        Raises:
            ConfigError: the problems cannot be shared among the worlds in equal parts.
        """
        if num_problems % len(self._twin):
            raise ConfigError(
                f"the oracle knows {len(self._twin)} worlds, but plans for {num_problems} vehicles; give it one "
                "layout, or one for each of them."
            )
        return np.arange(number) * len(self._twin) // number


class HalfOracle(Oracle):
    """B agents that imagine one half with the true physics and the other with a trained agent."""

    def __init__(
        self, agent: Agent, layouts: Sequence[Layout], vehicle: Vehicle, true_mean: bool, step_std: float | None = None
    ) -> None:
        """Combine a trained agent, whose look-up is of the same worlds, with the true physics.

        Args:
            agent: the trained agent, which provides the planner and the learned half.
            layouts: see `Oracle`.
            vehicle: likewise.
            true_mean: whether means are true; otherwise standard deviations are.
            step_std: see `Oracle`.
        """
        super().__init__(layouts, vehicle, agent.planner, agent.settings, step_std)
        self.agent, self.true_mean = agent, true_mean

    def __repr__(self) -> str:
        return f"HalfOracle(true {'mean' if self.true_mean else 'deviation'}, {self.agent!r})"

    def elsewhere(self, layouts: Sequence[Layout], vehicle: Vehicle | None = None) -> HalfOracle:
        """Copy of the agent for another world, or for B others (member-major), and perhaps for another vehicle.

        Raises:
            ConfigError: the learned half was trained with other channels.
        """
        check_channels(self.agent, layouts[0])
        agent = self.agent.elsewhere([layout.map for layout in layouts])
        return HalfOracle(agent, layouts, vehicle or self.vehicle, self.true_mean, self.step_std)

    def merged(self, is_open: Sequence[bool]) -> HalfOracle:
        """Copy in which some worlds are without doors, see `PlanningAgent.merged`."""
        layouts = self._merged_layouts(is_open)
        return HalfOracle(self.agent.merged(is_open), layouts, self.vehicle, self.true_mean, self.step_std)

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the agent's members."""
        return self.agent.seeds

    def initial_carry(self, num_problems: int) -> Carry:
        """Hidden state where flights of B problems begin, from the agent."""
        return self.agent.initial_carry(num_problems)

    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Imagine candidates, see `PlanningAgent.imagine`."""
        if not self.true_mean:
            mean = self.agent.imagine(observation, actions, carry).mean
            return Gaussian(mean, self.true_log_std(observation, mean))
        carry = self.initial_carry(len(actions)) if carry is None else carry
        situation = Situation(observation.position, observation.delta, carry)
        path = self.true_path(observation, actions)
        return rollout(self.agent.stack.transition, self.agent.lookup, situation, actions, path)

    def predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """Predict the next step, see `PlanningAgent.predict`."""
        carry, learned = self.agent.predict(observation, action, carry)
        if self.true_mean:
            mean = self.true_path(observation, action[:, None, None])[:, 0, 0] - observation.position
            return carry, Gaussian(mean, learned.log_std)
        expected = (observation.position + learned.mean)[:, None, None]
        return carry, Gaussian(learned.mean, self.true_log_std(observation, expected)[:, 0, 0])


def _array(tensor: Tensor) -> np.ndarray:
    if tensor.requires_grad and torch.is_grad_enabled():
        raise ConfigError("the true physics has no gradients; take a planner that needs none, such as planner=cem.")
    return tensor.detach().cpu().numpy()
