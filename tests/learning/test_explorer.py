"""The choice of plans by committees."""

from typing import Any, get_args

import numpy as np
import pytest
import torch

from affmap import compiled
from affmap.data.collect import random_actions
from affmap.data.settings import Exploration
from affmap.env.layout import Layout
from affmap.gaussian import Gaussian
from affmap.learning.explorer import Explorer
from affmap.learning.settings import AnyPlanningLearning, GoalLearning, SeekingLearning
from affmap.model.lookup import AffordanceMap
from affmap.model.rollout import Situation, rollout
from affmap.model.settings import ModelSettings
from affmap.model.stack import Stack
from affmap.planning.information import SIGNALS, information

EXPLORATION = Exploration.load("data", "default")


def explorer(
    world: Layout, seeds: range, kind: str = "disagreement", num_plans: int = 6, weight: float = 0
) -> Explorer:
    plans: dict[str, Any] = {"committee": 3, "num_plans": num_plans, "plan_steps": 5, "executed_steps": 5}
    settings: AnyPlanningLearning
    if kind == "goals":
        settings = GoalLearning.load("learning", kind, **plans, information_weight=weight)
    else:
        settings = SeekingLearning.load("learning", kind, **plans)
    stack = Stack(ModelSettings.load("model", "default", context_size=3), 1, seeds)
    return Explorer(stack, AffordanceMap.paint(stack, [world.map], 0.1), EXPLORATION, settings)


def sensed(num_agents: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions and their last changes."""
    rng = np.random.default_rng(0)
    position = torch.from_numpy(rng.uniform(0.2, 1.8, (num_agents, 2)).astype(np.float32))
    delta = torch.from_numpy(rng.normal(0, 0.02, (num_agents, 2)).astype(np.float32))
    return position, delta


@pytest.mark.usefixtures("loops")
def test_the_news_of_a_plan_is_the_mean_information_of_its_imagined_steps(world: Layout) -> None:
    """Each model's rollout by itself, and the information of its changes of position, whose variances do not add up."""
    chooser = explorer(world, range(6), "information")
    (position, delta), plans = sensed(2), torch.rand(2, 4, 5, 4, generator=torch.Generator().manual_seed(0))
    for agent in range(2):
        changes = []
        for member in range(3 * agent, 3 * agent + 3):
            alone = chooser._stack.select([member])
            lookup = AffordanceMap.paint(alone, [world.map], 0.1)
            start = Situation(position[[agent]], delta[[agent]], alone.transition.initial(1))
            path = rollout(alone.transition, lookup, start, plans[agent : agent + 1])
            before = torch.cat([position[agent].expand(1, 4, 1, 2), path.mean[..., :-1, :]], dim=-2)
            variance = torch.cat([torch.zeros(1, 4, 1, 2), (2 * path.log_std).exp()], dim=-2).diff(dim=-2)
            changes.append(Gaussian(path.mean - before, 0.5 * (variance + 0.01**2).log()))
        committee = Gaussian(*(torch.stack(parts) for parts in zip(*changes, strict=True)))
        expected = information(committee).mean(-1)[0]
        torch.testing.assert_close(chooser.value(position, delta, None, plans)[agent], expected, rtol=1e-3, atol=1e-5)


def test_the_chosen_plan_is_the_best_of_those_that_random_exploration_would_draw(world: Layout) -> None:
    """`random_actions` with the same generator."""
    chooser, seen = explorer(world, range(3)), sensed(1)
    chosen = chooser.choose(*seen, None, [np.random.default_rng(5)])
    rng = np.random.default_rng(5)
    drawn = [random_actions(EXPLORATION.model_copy(update={"num_steps": 5}), rng) for _ in range(6)]
    plans = torch.from_numpy(np.array([drawn]))
    assert (chosen[0] == plans[0, chooser.value(*seen, None, plans)[0].argmax()]).all()
    (only,) = explorer(world, range(3), num_plans=1).choose(*seen, None, [np.random.default_rng(5)])
    np.testing.assert_array_equal(only, drawn[0])


@pytest.mark.usefixtures("loops")
def test_the_worth_of_a_plan_on_the_way_to_a_goal_is_information_minus_free_energy(world: Layout) -> None:
    """Each model's rollout by itself, and the closed form of its cross-entropy with the desired Gaussian, in double
    precision: log(2 pi s^2) + (squared distance of the mean + both variances) / (2 s^2), s = 0.1 u."""
    (position, delta), plans = sensed(1), torch.rand(1, 4, 5, 4, generator=torch.Generator().manual_seed(0))
    goal = torch.tensor([[0.3, 0.4]])
    costs = []
    for member in range(3):
        stack = explorer(world, range(3))._stack.select([member])
        lookup = AffordanceMap.paint(stack, [world.map], 0.1)
        path = rollout(stack.transition, lookup, Situation(position, delta, stack.transition.initial(1)), plans)
        mean, variance = path.mean[0].double(), (2 * path.log_std[0].double()).exp()
        square = ((mean - goal[0]) ** 2 + variance).sum(-1)
        costs.append((np.log(2 * np.pi * 0.1**2) + square / (2 * 0.1**2)).mean(-1))
    alone = explorer(world, range(3), "goals").value(position, delta, goal, plans)
    torch.testing.assert_close(alone[0].double(), -torch.stack(costs).mean(0), rtol=1e-3, atol=1e-3)
    news = explorer(world, range(3), "information").value(position, delta, None, plans)
    curious = explorer(world, range(3), "goals", weight=10).value(position, delta, goal, plans)
    torch.testing.assert_close(curious, alone + 10 * news, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("kind", ["disagreement", "goals"])
@pytest.mark.parametrize("enabled", [True, False])
def test_an_agent_chooses_as_it_would_alone(world: Layout, enabled: bool, kind: str) -> None:
    """The same alone: two agents side by side, and each by itself."""
    goal = torch.tensor([[0.3, 0.4], [2.5, 1.5]]) if kind == "goals" else None
    compiled.use(enabled)
    try:
        seen = sensed(2)
        both = explorer(world, range(6), kind).choose(*seen, goal, [np.random.default_rng(seed) for seed in (0, 1)])
        for agent, seeds in enumerate((range(3), range(3, 6))):
            own = (part[[agent]] for part in seen)
            alone = explorer(world, seeds, kind).choose(
                *own, None if goal is None else goal[[agent]], [np.random.default_rng(agent)]
            )
            assert (alone[0] == both[agent]).all()
    finally:
        compiled.use(True)


def test_agents_can_seek_each_signal_that_there_is() -> None:
    """Those of the settings, which know no torch, and those that are computed."""
    assert {*get_args(SeekingLearning.model_fields["kind"].annotation)} == {*SIGNALS}
