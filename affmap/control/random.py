"""An agent with random throttles, as a baseline by chance."""

from __future__ import annotations

from typing import Literal

import numpy as np

from affmap.control.controller import Decision, Observation
from affmap.control.registry import register_agent
from affmap.lazy import torch
from affmap.planning.planner import Generators
from affmap.settings import Settings, preset


@register_agent
class RandomAgent(Settings, defaults="agent/random"):
    """Opens every throttle at random, uniformly between 0 and 1 and anew at every step (`conf/agent/random.yaml`).

    It has no model, and predicts nothing.
    """

    kind: Literal["random"] = preset()

    def initial(self, num_problems: int) -> None:
        """Return no state: nothing is remembered."""

    def act(self, observation: Observation, state: None, generators: Generators) -> tuple[Decision, None]:
        """Draw the actions of each vehicle from its own generator; see `Controller.act`."""
        throttles = np.stack([generator.random(4, np.float32) for generator in generators])
        return Decision.without_prediction(torch.from_numpy(throttles).to(observation.position.device)), None
