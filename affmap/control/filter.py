"""An oracle that keeps track of its place in fog: the bound for beliefs that are learned.

It is the Kalman filter with the exact physics, as far as that differs from dead reckoning. In fog, the gain of a report
is P / (P + fog_std^2), where P is the variance of the belief: after 50 steps of 0.0005 u it is 1e-5, and the report
moves the belief by less than 0.00002 u. So reports from fog are not used. Outside, they are exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from affmap.control.controller import Observation
from affmap.control.oracle import Oracle
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian
from affmap.model.transition import Carry

NEAR = 0.05
"""u; error of a belief that is reckoned with at the rim. Box2D and its twin differ in contacts, and errors add up."""

_AROUND = NEAR * np.array([[0, 0], *([math.cos(angle), math.sin(angle)] for angle in np.arange(8) * math.pi / 4)])


class Filter(Oracle):
    """B agents that plan with the true physics from where they believe to be, and know what fog does to reports.

    The belief is carried from step to step: the place where the true physics puts the vehicle, and the last place.
    A report replaces it where the vehicle is surely outside fog; and at the rim, where that is uncertain, if both are
    near each other.
    """

    def elsewhere(self, layouts: Sequence[Layout], vehicle: Vehicle | None = None) -> Filter:
        """Copy of the agent for another world, or for B others (member-major), and perhaps for another vehicle."""
        return Filter(layouts, vehicle or self.vehicle, self.planner, self.settings, self.step_std)

    def initial_carry(self, num_problems: int) -> Carry:
        """No belief before the first report, which is taken for exact: NaN, two places `[1, B, 2]`."""
        return (torch.full((1, num_problems, 2), torch.nan),) * 2

    def believed(self, observation: Observation, carry: Carry) -> Observation:
        """The observation with the place and its change that the agent believes in, in place of those reported."""
        expected, last = (place[0] for place in carry)
        known = ~expected.isnan().any(-1, keepdim=True)
        around = expected.cpu().numpy()[:, None] + _AROUND
        worlds = self._worlds(len(around), around[..., 0].size)
        foggy = torch.from_numpy(self._twin.in_fog(worlds, around.reshape(-1, 2)).reshape(around.shape[:-1]))
        near = torch.linalg.vector_norm(observation.position - expected, dim=-1) < NEAR
        trusted = ~foggy.any(-1) | (near & ~foggy.all(-1))
        position = torch.where(known & ~trusted[:, None], expected, observation.position)
        return observation._replace(position=position, delta=torch.where(known, position - last, observation.delta))

    def imagine(self, observation: Observation, actions: Tensor, carry: Carry | None = None) -> Gaussian:
        """Imagine where the vehicle will be, not where it will be reported, see `PlanningAgent.imagine`."""
        carry = self.initial_carry(len(actions)) if carry is None else carry
        mean = self.true_path(self.believed(observation, carry), actions)
        steps = torch.arange(1, actions.shape[2] + 1).to(mean)
        return Gaussian(mean, (0.5 * steps.log() + math.log(self.step_std))[:, None].expand_as(mean))

    def predict(self, observation: Observation, action: Tensor, carry: Carry) -> tuple[Carry, Gaussian]:
        """Predict the next step, see `PlanningAgent.predict`: the change to the next report, which fog makes noisy."""
        here = self.believed(observation, carry)
        expected = self.true_path(here, action[:, None, None])[:, 0, 0]
        in_fog = self._twin.in_fog(self._worlds(len(expected), len(expected)), expected.cpu().numpy())
        variance = torch.from_numpy(in_fog * self.vehicle.fog_std**2 + self.step_std**2).to(expected)
        delta = Gaussian(expected - observation.position, (0.5 * variance.log())[:, None].expand_as(expected))
        return (expected[None], here.position[None]), delta
