"""Settings of control, in a module without torch, which takes seconds to import."""

import re
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from affmap.settings import Count, Length, Neutral, NonNegative, Positive, Settings, preset

Guide = Literal["none", "time_to_go"]
"""Where an agent that plans has its sub-goals from."""

GUIDES: tuple[Guide, ...] = get_args(Guide)


def _check_device(device: str) -> str:
    if not re.fullmatch(r"cpu|cuda(:(0|[1-9][0-9]?))?", device, re.ASCII):
        raise ValueError("should be cpu, cuda or cuda:<number>")
    return device


class ControlSettings(Settings, defaults="control/default"):
    """Settings of control and its evaluation (`conf/control`)."""

    num_steps: Count = preset()
    """T, steps of a run."""
    runs_per_member: Count = preset()
    """R, runs of each member; run r starts in corner r modulo 4."""
    beta: Annotated[NonNegative, Field(le=1e6)] = preset()
    """Weight of the uncertainty in the expected free energy; from a million on, rounding loses the divergence."""
    goal_std_far: Length = preset()
    """Standard deviation of the desired position, u."""
    goal_std_near: Length = preset()
    """Standard deviation of the desired position once the goal is near, u."""
    near_distance: Length = preset()
    """Distance to the goal below which it is near, u."""
    goal_radius: Length = preset()
    """Distance to the goal below which it is reached, u."""
    goal_distance: Annotated[Length | None, Neutral(None)] = preset()
    """Distance between start and goal, u, in any direction; None for goals in the opposite corner."""
    reports: Annotated[Literal["exact", "noisy"], Neutral("exact")] = preset()
    """Worth of reported positions. Where they are noisy, imagination begins with the view that is sensed, not with the
    map at the reported position; and plans count imagined means alone, because deviations are those of reports."""
    guide: Annotated[Guide, Neutral("none")] = preset()
    """Sub-goals of an agent that plans: none, or points ahead on the shortest way by its own imagination."""
    guide_spacing: Annotated[Length, Neutral(0.1), Field(ge=0.02)] = preset()
    """Largest distance between neighbouring nodes of the map of times to go, u."""
    guide_steps: Annotated[Positive, Neutral(4.0), Field(le=100)] = preset()
    """Steps within which a vehicle must be imagined to get a spacing ahead from rest; in proportion on a diagonal."""
    guide_uncertainty: Annotated[NonNegative, Neutral(3000.0), Field(le=1e6)] = preset()
    """Cost of an imagined standard deviation, steps per u."""
    guide_distance: Annotated[Length, Neutral(0.6)] = preset()
    """Distance of the sub-goal along the way, u."""
    device: Annotated[str, AfterValidator(_check_device), Field(exclude=True)] = preset()
    """Device for planning: cpu or cuda."""
