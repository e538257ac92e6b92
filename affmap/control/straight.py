"""An agent that flies straight ahead, as a baseline without perception."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from affmap.control.controller import Decision, Observation
from affmap.control.registry import register_agent
from affmap.env.body import THROTTLES
from affmap.lazy import torch
from affmap.planning.planner import Generators
from affmap.settings import Length, NonNegative, Settings, preset


@register_agent
class StraightAgent(Settings, defaults="agent/straight"):
    """Pushes straight towards the goal with the two throttles beside that direction (`conf/agent/straight.yaml`).

    It slows down: it steers from where it would be some steps later at its present speed, and near the goal closes the
    throttles in proportion to the remaining distance. It has no model, predicts nothing, and avoids nothing.
    """

    kind: Literal["straight"] = preset()
    foresight: Annotated[NonNegative, Field(le=1e6)] = preset()
    """Steps for which its speed is assumed to last; 0 for a vehicle that does not brake before the goal."""
    slow_distance: Length = preset()
    """Distance along the direction of a throttle from which that throttle is fully open, u."""

    def initial(self, num_problems: int) -> None:
        """Return no state: nothing is remembered."""

    def act(self, observation: Observation, state: None, generators: Generators) -> tuple[Decision, None]:
        """Push from the reported position to the goal; see `Controller.act`. Nothing is random here."""
        way = observation.goal - observation.position - self.foresight * observation.delta
        # The two throttles are at right angles: the parts of the way along them, together, are the way.
        parts = (way @ torch.from_numpy(THROTTLES).to(way).T).clamp(min=0)  # [B, 4]
        return Decision.without_prediction(parts / parts.amax(1, keepdim=True).clamp(min=self.slow_distance)), None
