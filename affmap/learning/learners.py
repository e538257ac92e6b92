"""The loop of agents that learn online: explore for a round, train on all experience so far, begin again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from affmap.data.batches import Batch
from affmap.data.collect import free_position, random_actions
from affmap.data.settings import Exploration
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.learning.experience import Round, batches
from affmap.learning.explorer import Explorer
from affmap.learning.goals import Goals
from affmap.learning.settings import AnyOnlineLearning, AnyPlanningLearning, GoalLearning, RandomLearning
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import Stack
from affmap.random import generator, integer
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

SAVED = ("position", "true_position", "action", "touching", "in_fog", "goal")
"""Parts of a round that a checkpoint needs, where there are any; views follow from true positions."""

Act = Callable[[Tensor, Tensor, Tensor | None, int], np.ndarray]
"""Actions `[A, 4]` of all agents, from reported positions `[A, 2]`, their last changes, their goals
`[A, 2]` if they have any, and the step of the round."""


@dataclass
class Learners:
    """A agents that learn online in the same layouts, each from its own experience.

    Rounds take place in one layout after the other, in turn. A round begins at rest where the last one in that layout
    ended, the first one at a random free place.
    """

    stack: Stack
    """All M members, committee by committee; trained in place."""
    layouts: Sequence[Layout]
    vehicle: Vehicle
    exploration: Exploration
    """How random actions are drawn."""
    settings: AnyOnlineLearning
    training: TrainingSettings
    rounds: list[list[Round]] = field(default_factory=list, repr=False)
    """Of each agent, R so far."""

    def __post_init__(self) -> None:
        members = range(len(self.stack.seeds))
        size = self.settings.committee_size(len(members))
        self._committees = [self.stack.select(members[first : first + size]) for first in members[::size]]
        self._modules = [TrainingModule(committee, self.training) for committee in self._committees]
        self._optimizers = [module.configure_optimizers() for module in self._modules]
        self.rounds = self.rounds or [[] for _ in self._committees]

    @property
    def num_rounds(self) -> int:
        """Number of rounds so far."""
        return len(self.rounds[0])

    @property
    def agents(self) -> list[int]:
        """Seeds of the first members of the A committees, by which agents are known."""
        return [committee.seeds[0] for committee in self._committees]

    def layout(self, number: int) -> Layout:
        """The layout of a round."""
        return self.layouts[number % len(self.layouts)]

    def round(self) -> Tensor:
        """Explore for a round, and train on all experience so far.

        Returns:
            Mean NLL of each member over the updates, `[M]` in nats.
        """
        number = self.num_rounds
        layout = self.layout(number)
        for own, new in zip(self.rounds, self._explore(layout, number), strict=True):
            own.append(new)
        losses = []
        for module, optimizer, own in zip(self._modules, self._optimizers, self.rounds, strict=True):
            module.set_rates(optimizer, number)
            rng = generator(module.stack.seeds[0], "batches of a round", number)
            sizes = self.training.batch_size, self.training.chunk_length
            updates = [module.update(batch, optimizer) for batch in batches(own, *sizes, self.settings.updates, rng)]
            losses.append(torch.stack(updates).mean(0))
        self.stack.load_state_dict(Stack.joined(self._committees).state_dict())
        return torch.cat(losses)

    def evaluate(self, chunks: Sequence[Batch]) -> Tensor:
        """Mean NLL of each member over the steps of consecutive chunks of sequences, `[M]` in nats."""
        steps = [chunk.action[..., 0].numel() for chunk in chunks]
        losses = [torch.cat([module.evaluate(chunk) for module in self._modules]) for chunk in chunks]
        return torch.stack([number * loss for number, loss in zip(steps, losses, strict=True)]).sum(0) / sum(steps)

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors."""
        return {
            "weights": [module.stack.state_dict() for module in self._modules],
            "optimizers": [optimizer.state_dict() for optimizer in self._optimizers],
            "rounds": [
                [
                    {key: torch.from_numpy(part) for key in SAVED if (part := getattr(each, key)) is not None}
                    for each in own
                ]
                for own in self.rounds
            ],
        }

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""
        for module, weights in zip(self._modules, state["weights"], strict=True):
            module.stack.load_state_dict(weights)
        for optimizer, own in zip(self._optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(own)
        self.stack.load_state_dict(Stack.joined(self._committees).state_dict())
        self.rounds = [
            [
                self._restored(number, {key: part.numpy() for key, part in each.items()})
                for number, each in enumerate(own)
            ]
            for own in state["rounds"]
        ]

    def _restored(self, number: int, saved: dict[str, np.ndarray]) -> Round:
        layout = self.layout(number)
        return Round(view=layout.views(saved["true_position"][:-1]), **saved)

    def _explore(self, layout: Layout, number: int) -> list[Round]:
        """Fly a round in a layout; returns the experience of each agent."""
        seeds = self.agents
        envs = [VehicleEnv(layout, self.vehicle, views=False) for _ in seeds]
        rngs = [generator(seed, "round", number) for seed in seeds]
        begun = [
            env.reset(seed=integer(seed, "world of a round", number), options={"position": start})
            for env, seed, start in zip(envs, seeds, self._starts(layout, number, rngs), strict=True)
        ]
        goals = self._goals(layout, number)
        act = (
            self._random(rngs)
            if isinstance(self.settings, RandomLearning)
            else self._informed(self.settings, layout, rngs)
        )
        sensed, infos = [list(each) for each in zip(*begun, strict=True)]
        records: list[dict[str, list[Any]]] = [
            {"position": [each["position"]], "true_position": [info["position"]], "action": []}
            | {"touching": [], "in_fog": [], **({"goal": []} if goals else {})}
            for each, info in begun
        ]
        for step in range(self.settings.round_steps):
            position, delta = (
                torch.from_numpy(np.stack([each[key] for each in sensed]).astype(np.float32))
                for key in ("position", "delta")
            )
            actions = act(position, delta, torch.from_numpy(goals.position) if goals else None, step)
            results = [env.step(action) for env, action in zip(envs, actions, strict=True)]
            sensed, infos = [result[0] for result in results], [result[4] for result in results]
            for record, action, each, info in zip(records, actions, sensed, infos, strict=True):
                news = {"position": each["position"], "true_position": info["position"], "action": action}
                for key, value in {**news, "touching": info["touching"], "in_fog": info["in_fog"]}.items():
                    record[key].append(value)
            if goals:
                for record, goal in zip(records, goals.position, strict=True):
                    record["goal"].append(goal)
                goals.move_on(np.stack([info["position"] for info in infos]))
        return [self._restored(number, {key: _array(part) for key, part in record.items()}) for record in records]

    def _starts(self, layout: Layout, number: int, rngs: Sequence[np.random.Generator]) -> list[np.ndarray]:
        """The places where a round begins, `[2]` in u: the last one in this layout that is free, or a random one."""
        last = number - len(self.layouts)
        if last < 0:
            return [free_position(layout, self.vehicle, rng) for rng in rngs]
        paths = [own[last].true_position[::-1] for own in self.rounds]
        # Where the vehicle touches something, it is a hair's breadth inside.
        return [path[layout.is_free(path, self.vehicle.radius)][0] for path in paths]

    def _goals(self, layout: Layout, number: int) -> Goals | None:
        """The goals of all agents in a round, if they have some."""
        if not isinstance(self.settings, GoalLearning):
            return None
        rngs = [generator(seed, "goals of a round", number) for seed in self.agents]
        return Goals(layout, self.vehicle, self.settings.goal_radius, rngs)

    def _random(self, rngs: Sequence[np.random.Generator]) -> Act:
        exploration = self.exploration.model_copy(update={"num_steps": self.settings.round_steps})
        drawn = np.stack([random_actions(exploration, rng) for rng in rngs], axis=1)  # [S, A, 4]
        return lambda position, delta, goal, step: drawn[step]

    def _informed(self, settings: AnyPlanningLearning, layout: Layout, rngs: Sequence[np.random.Generator]) -> Act:
        lookup = AffordanceMap.paint(self.stack, [layout.map], settings.spacing)
        explorer = Explorer(self.stack, lookup, self.exploration, settings)
        plans = np.empty(0)

        def act(position: Tensor, delta: Tensor, goal: Tensor | None, step: int) -> np.ndarray:
            nonlocal plans
            place = step % settings.executed_steps
            if place == 0:
                plans = explorer.choose(position, delta, goal, rngs).numpy()
            return plans[:, place]

        return act


def _array(values: list[Any]) -> np.ndarray:
    array = np.array(values)
    return array if array.dtype == bool else array.astype(np.float32)
