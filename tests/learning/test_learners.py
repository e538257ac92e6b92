"""The loop of agents that learn online."""

import io
from typing import Any

import numpy as np
import pytest
import torch

from affmap.data.collect import random_actions
from affmap.data.settings import Exploration
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.learning.learners import Learners
from affmap.learning.settings import AnyOnlineLearning, GoalLearning, RandomLearning, SeekingLearning
from affmap.model.registry import GRUSettings
from affmap.model.settings import ModelSettings
from affmap.model.stack import Stack
from affmap.random import generator
from affmap.training.settings import TrainingSettings

VEHICLE, EXPLORATION = Vehicle.load("vehicle", "default"), Exploration.load("data", "default")


def learners(layouts: list[Layout], seeds: range, kind: str = "disagreement", **model: Any) -> Learners:
    """Agents of two models each, whose rounds have 20 steps."""
    rounds: dict[str, Any] = {"committee": 2, "round_steps": 20, "updates": 3}
    plans: dict[str, Any] = {"num_plans": 4, "plan_steps": 6, "executed_steps": 4, "spacing": 0.2}
    settings: AnyOnlineLearning
    if kind == "random":
        settings = RandomLearning.load("learning", kind, **rounds)
    elif kind == "goals":
        settings = GoalLearning.load("learning", kind, **rounds, **plans)
    else:
        settings = SeekingLearning.load("learning", kind, **rounds, **plans)
    training = TrainingSettings.load("training", "default", chunk_length=10, batch_size=3, num_epochs=4)
    stack = Stack(ModelSettings.load("model", "default", context_size=3, **model), 1, seeds)
    return Learners(stack, layouts, VEHICLE, EXPLORATION, settings, training)


def weights(those: Learners, members: slice = slice(None)) -> list[torch.Tensor]:
    return [weight[members].clone() for weight in those.stack.state_dict().values()]


def equal(first: list[torch.Tensor], second: list[torch.Tensor]) -> bool:
    return all(torch.equal(one, other) for one, other in zip(first, second, strict=True))


@pytest.mark.parametrize("model", [{}, {"transition": GRUSettings(kind="gru")}], ids=["MLP", "GRU"])
def test_an_agent_learns_as_it_would_alone(world: Layout, model: dict[str, Any]) -> None:
    """The same alone: two agents side by side, and each by itself; and an agent that learned nothing has its weights
    of the beginning."""
    both = learners([world], range(4), **model)
    before = weights(both)
    losses = [both.round() for _ in range(2)]
    assert not equal(before, weights(both))
    for agent, members in enumerate((slice(0, 2), slice(2, 4))):
        alone = learners([world], range(2 * agent, 2 * agent + 2), **model)
        assert all(torch.equal(alone.round(), loss[members]) for loss in losses)
        assert equal(weights(alone), weights(both, members))
        for own, other in zip(alone.rounds[0], both.rounds[agent], strict=True):
            assert all(np.array_equal(one, two) for one, two in zip(own, other, strict=True))


@pytest.mark.parametrize("kind", ["random", "deviation", "disagreement", "information", "goals"])
def test_agents_go_on_from_a_checkpoint_as_if_nothing_had_happened(world: Layout, kind: str) -> None:
    """Three rounds without interruption; the checkpoint is read without unpickling."""
    undisturbed, stopped = (learners([world], range(4), kind) for _ in range(2))
    for _ in range(2):
        undisturbed.round()
        stopped.round()
    file = io.BytesIO()
    torch.save(stopped.state(), file)
    file.seek(0)
    resumed = learners([world], range(4), kind)
    resumed.load(torch.load(file, weights_only=True))
    assert torch.equal(resumed.round(), undisturbed.round())
    assert equal(weights(resumed), weights(undisturbed))
    for own, other in zip(resumed.rounds, undisturbed.rounds, strict=True):
        assert all(
            np.array_equal(*each) for one, two in zip(own, other, strict=True) for each in zip(one, two, strict=True)
        )
    assert all((each.goal is not None) == (kind == "goals") for own in resumed.rounds for each in own)


def test_rounds_take_turns_in_the_layouts_and_begin_where_the_last_one_ended(world: Layout) -> None:
    """True positions, to the last free one; views are those of the layout at these places."""
    other = Layout.load("layout", "two_obstacles")
    those = learners([world, other], range(2))
    for _ in range(4):
        those.round()
    first, _, third, fourth = those.rounds[0]
    assert those.layout(3) is other
    assert any((third.true_position[0] == place).all() for place in first.true_position[-3:])
    np.testing.assert_array_equal(fourth.view, other.views(fourth.true_position[:-1]))
    assert third.view.shape == (20, 1, 11, 11)


def test_random_agents_act_as_random_exploration_does(world: Layout) -> None:
    """`random_actions` with the stream of the round, after the draw of the start."""
    those = learners([world], range(2), "random")
    those.round()
    those.round()
    expected = random_actions(EXPLORATION.model_copy(update={"num_steps": 20}), generator(0, "round", 1))
    np.testing.assert_array_equal(those.rounds[0][1].action, expected)


def test_a_held_out_loss_is_the_mean_over_all_steps(world: Layout) -> None:
    """The loss of the whole sequences at once, of chunks of different lengths."""
    from affmap.data.batches import Batch
    from affmap.learning.experience import batches

    those = learners([world], range(4))
    those.round()
    (whole,) = batches(those.rounds[0], 1, 20, 1, np.random.default_rng(0))
    cut = [
        Batch(
            whole.views.select((slice(None), slice(None), part)),
            *(each[:, :, part] for each in whole[1:4]),
            is_first=True,
        )
        for part in (slice(0, 5), slice(5, 20))
    ]
    torch.testing.assert_close(those.evaluate(cut), those.evaluate([whole]))
