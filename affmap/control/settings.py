"""Settings of control, in a module without torch, which takes seconds to import."""

from pydantic import Field

from affmap.settings import Count, NonNegative, Positive, Settings


class ControlSettings(Settings):
    """Settings of control and its evaluation (`conf/control`)."""

    num_steps: Count
    """T, steps of a run."""
    runs_per_member: Count
    """Run r of a member starts in corner r modulo 4."""
    beta: NonNegative
    """Weight of the uncertainty in the expected free energy."""
    goal_std_far: Positive
    """Standard deviation of the desired position, u."""
    goal_std_near: Positive
    """Standard deviation of the desired position once the goal is near, u."""
    near_distance: Positive
    """Distance to the goal below which it is near, u."""
    goal_radius: Positive
    """Distance to the goal below which it is reached, u."""
    device: str = Field(pattern=r"^(cpu|cuda(:[0-9]{1,2})?)$", exclude=True)
    """Device for planning: cpu or cuda."""
