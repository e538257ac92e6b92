"""Rivals of the agents that plan: the kinds of policies and of their training, in a module without torch."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from affmap.settings import Count, Name, Positive, Settings, preset

Source = Literal["data", "plans", "worlds"]
"""Where a policy comes from: from the data set, from the plans of trained agents, or from flights of its own."""

ROLLOUT = 2048
"""Steps between two updates of PPO, the default of Stable-Baselines3."""


class NoRival(Settings, defaults="rival/none"):
    """The agent itself flies (`conf/rival/none.yaml`)."""

    kind: Literal["none"] = preset()


class Rival(Settings):
    """Keys of all policies (`conf/rival`)."""

    name: Name = preset()
    """Its name in tables, in the column of planners."""
    members: Count = preset()
    """Most members that have a policy and fly, the first ones of a job."""
    hidden_sizes: tuple[Count, ...] = preset()
    """Units of each hidden layer."""

    source: ClassVar[Source]
    """What it learns from."""
    efforts: ClassVar[tuple[str, ...]]
    """Keys of the effort of a training."""

    def scaled(self, share: float) -> Self:
        """The same with a share of the effort, for toy runs."""
        return self.model_copy(update={key: math.ceil(share * getattr(self, key)) for key in self.efforts})


class Imitation(Rival):
    """Keys of policies that learn actions by regression."""

    view_units: Annotated[int, Field(ge=0, le=1000)] = preset()
    """Units of a layer that sees the view alone; 0: the first hidden layer sees everything."""
    rounds: Count = preset()
    """Rounds of training; an interrupted training goes on after the last one."""
    updates: Count = preset()
    """Updates in a round."""
    batch_size: Count = preset()
    """Examples in an update."""
    learning_rate: Positive = preset()
    """Of Adam, in the first round."""
    decay: Annotated[Positive, Field(le=1)] = preset()
    """Factor on the learning rate after each round."""


class Cloning(Imitation, defaults="rival/cloning"):
    """Behaviour cloning with hindsight goals (`conf/rival/cloning.yaml`).

    The goal of a step of the data set is the position that was reported some steps later in the same sequence.
    """

    source: ClassVar[Source] = "data"
    efforts: ClassVar[tuple[str, ...]] = ("updates",)

    kind: Literal["cloning"] = preset()
    max_delay: Count = preset()
    """Largest number of steps until then; drawn uniformly from 1 up."""


class Distillation(Imitation, defaults="rival/distilled"):
    """A small policy that imitates the agent's plans, by DAgger (`conf/rival/distilled.yaml`).

    In the first round the agent flies, later the policy does; in both the agent says at each step how it would act,
    and the policy learns from all of these steps.
    """

    source: ClassVar[Source] = "plans"
    efforts: ClassVar[tuple[str, ...]] = ("updates", "flights")

    kind: Literal["distilled"] = preset()
    flights: Count = preset()
    """Flights of each member in a round."""
    num_steps: Count = preset()
    """Steps of a flight."""


class Reinforcement(Rival, defaults="rival/ppo"):
    """PPO by Stable-Baselines3, whose defaults it has otherwise (`conf/rival/ppo.yaml`)."""

    source: ClassVar[Source] = "worlds"
    efforts: ClassVar[tuple[str, ...]] = ("steps",)

    kind: Literal["ppo"] = preset()
    steps: Count = preset()
    """Steps in the world, of all vehicles together; rounded up to whole rollouts of 2048."""
    num_vehicles: Annotated[Count, Field(le=2048)] = preset()
    """Vehicles that fly side by side; each has 2048 / num_vehicles steps in a rollout."""
    batch_size: Annotated[Count, Field(le=2048)] = preset()
    """Steps in an update."""
    num_steps: Count = preset()
    """Steps of a flight."""


AnyRival = Annotated[NoRival | Cloning | Distillation | Reinforcement, Field(discriminator="kind")]
"""Settings from a file of `conf/rival`, distinguished by `kind`."""

NONE = NoRival(kind="none")
"""Default, also of all configurations that predate the others."""
