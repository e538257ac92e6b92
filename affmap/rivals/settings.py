"""Rivals of the agents that plan: the kinds of policies and of their training, in a module without torch."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from affmap.settings import Count, Name, Positive, Settings, preset

Source = Literal["data", "plans", "worlds"]
"""Where a policy comes from: from the data set, from the plans of trained agents, or from flights of its own."""

Activation = Literal["tanh", "relu"]
"""Of hidden layers."""

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
    activation: ClassVar[Activation] = "tanh"
    """Between the layers of its network."""
    squash: ClassVar[bool] = True
    """Whether outputs, too, pass through a tanh; else they are clipped where they are executed."""

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


class TD3BC(Rival, defaults="rival/td3_bc"):
    """Offline reinforcement learning from the data set, by TD3 with behaviour cloning (`conf/rival/td3_bc.yaml`).

    Goals are chosen in hindsight; the reward of a step is minus the distance to the goal that remains.
    """

    source: ClassVar[Source] = "data"
    efforts: ClassVar[tuple[str, ...]] = ("updates",)
    activation: ClassVar[Activation] = "relu"

    kind: Literal["td3_bc"] = preset()
    rounds: Count = preset()
    """Rounds of training; an interrupted training goes on after the last one."""
    updates: Count = preset()
    """Updates of the critics in a round; every second one is also one of the policy."""
    batch_size: Count = preset()
    """Steps in an update."""
    learning_rate: Positive = preset()
    """Of Adam."""
    weight: Positive = preset()
    """Of values beside squared differences from the actions of the data; values are divided by their mean size."""
    max_delay: Count = preset()
    """Largest number of steps until the position that is taken for the goal; drawn uniformly from 1 up."""


class Reinforcement(Rival):
    """Keys of policies that learn from flights of their own, by Stable-Baselines3, whose defaults they have else."""

    source: ClassVar[Source] = "worlds"
    efforts: ClassVar[tuple[str, ...]] = ("steps",)

    steps: Count = preset()
    """Steps in the world, of all vehicles together."""
    num_vehicles: Annotated[Count, Field(le=2048)] = preset()
    """Vehicles that fly side by side."""
    batch_size: Annotated[Count, Field(le=2048)] = preset()
    """Steps in an update."""
    num_steps: Count = preset()
    """Steps of a flight."""


class PPO(Reinforcement, defaults="rival/ppo"):
    """Proximal policy optimization (`conf/rival/ppo.yaml`).

    Steps are rounded up to whole rollouts of 2048, in which each vehicle has 2048 / num_vehicles.
    """

    squash: ClassVar[bool] = False

    kind: Literal["ppo"] = preset()


class SAC(Reinforcement, defaults="rival/sac"):
    """Soft actor-critic, with an update for each step (`conf/rival/sac.yaml`).

    Steps are rounded up to whole ones of all vehicles.
    """

    activation: ClassVar[Activation] = "relu"

    kind: Literal["sac"] = preset()


AnyRival = Annotated[NoRival | Cloning | Distillation | TD3BC | PPO | SAC, Field(discriminator="kind")]
"""Settings from a file of `conf/rival`, distinguished by `kind`."""

NONE = NoRival(kind="none")
"""Default, also of all configurations that predate the others."""
