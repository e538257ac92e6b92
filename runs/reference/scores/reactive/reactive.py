"""An agent that is pulled by the goal, and pushed away by all that it sees: it has learned nothing."""

import torch

from affmap.control import Decision, Observation
from affmap.env.body import THROTTLES
from affmap.planning.planner import Generators


class Reactive:
    """Pulled by the goal, pushed away from the middle of what it sees, whatever that is."""

    push = 8.0

    def initial(self, num_problems: int) -> None:
        """Return no state: nothing is remembered."""

    def act(self, observation: Observation, state: None, generators: Generators) -> tuple[Decision, None]:
        """Push to the goal and away from the middle of what is seen; see `Controller.act`."""
        side = torch.linspace(-1, 1, 11)
        seen = observation.view.any(dim=1).float()  # [B, 11, 11]
        thing = torch.stack([(seen * side).mean((1, 2)), (seen * side[:, None]).mean((1, 2))], dim=-1)
        way = observation.goal - observation.position - 8 * observation.delta - self.push * thing  # [B, 2]
        action = (way @ torch.from_numpy(THROTTLES).float().T).clamp(0, 1)  # [B, 4]
        return Decision.without_prediction(action), None
