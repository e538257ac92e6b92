"""How models come by their experience, in a module without torch."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from affmap.settings import Count, Length, NonNegative, Positive, Settings, preset


class OfflineLearning(Settings, defaults="learning/offline"):
    """All exploration first, at random, and then the training (`conf/learning/offline.yaml`), as in the paper."""

    kind: Literal["offline"] = preset()


class OnlineLearning(Settings):
    """Rounds of exploration, each followed by training on all experience so far.

    The M members form committees of K: a committee is one agent, which flies one vehicle, and all of its models learn
    from the same experience. An epoch of such a training is a round, so that `training.num_epochs` is their number.
    """

    committee: Annotated[Count, Field(ge=2)] = preset()
    """K, models of an agent, which differ in their initial weights; all members where there are fewer."""
    round_steps: Count = preset()
    """S, steps of an agent between two trainings; each round begins at rest."""
    updates: Count = preset()
    """Updates of each model after a round, on batches of chunks of all steps so far."""

    def committee_size(self, num_members: int) -> int:
        """K, for M members."""
        return min(self.committee, num_members)


class RandomLearning(OnlineLearning, defaults="learning/random"):
    """Agents that seek nothing: actions are drawn as in `data` (`conf/learning/random.yaml`)."""

    kind: Literal["random"] = preset()


class PlanningLearning(OnlineLearning):
    """Agents that choose among plans, which they imagine with all models of their committees."""

    num_plans: Count = preset()
    """N, plans that an agent chooses from; they are drawn as random actions are."""
    plan_steps: Count = preset()
    """H, steps of a plan."""
    executed_steps: Count = preset()
    """Steps that are executed of a plan before the next choice."""
    resolution: Positive = preset()
    """Standard deviation that is added to predicted changes, so that smaller differences are no news, u/step."""
    spacing: Positive = preset()
    """Largest distance between nodes of the affordance maps in which plans are imagined, u."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.executed_steps > self.plan_steps:
            raise ValueError(
                f"executed_steps = {self.executed_steps} is more than plan_steps = {self.plan_steps}; plan as many "
                "steps as are executed, or more."
            )
        return self


class SeekingLearning(PlanningLearning, defaults="learning/disagreement"):
    """Agents that seek what they could learn from (`conf/learning/disagreement.yaml` and others)."""

    kind: Literal["deviation", "disagreement", "information"] = preset()
    """The signal of `affmap.planning.information` that a plan should promise."""


class GoalLearning(PlanningLearning, defaults="learning/goals"):
    """Agents that fly to random goals from the very beginning (`conf/learning/goals.yaml` and others)."""

    kind: Literal["goals"] = preset()
    information_weight: Annotated[NonNegative, Field(le=1e6)] = preset()
    """Weight of the information gain against the expected free energy; 0 for goals alone."""
    goal_std: Length = preset()
    """Standard deviation of the desired position, u."""
    goal_radius: Length = preset()
    """Distance below which a goal is reached, u; then the next one is drawn."""


AnyPlanningLearning = SeekingLearning | GoalLearning
AnyOnlineLearning = RandomLearning | AnyPlanningLearning

AnyLearning = Annotated[OfflineLearning | AnyOnlineLearning, Field(discriminator="kind")]
"""Settings from a file of `conf/learning`, distinguished by `kind`."""

OFFLINE = OfflineLearning(kind="offline")
"""Default, also of all configurations that predate the others."""
