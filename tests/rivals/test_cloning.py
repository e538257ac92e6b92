"""Behaviour cloning with goals in hindsight."""

import numpy as np
import torch

from affmap.rivals.cloning import Cloner
from affmap.rivals.policy import CHANGE
from affmap.rivals.settings import Cloning

RNG = np.random.default_rng(0)
DATA = {
    "position": RNG.uniform(0, 2, (3, 13, 2)).astype(np.float32),
    "view": RNG.integers(2, size=(3, 12, 1, 11, 11)).astype(bool),
    "action": RNG.uniform(size=(3, 12, 4)).astype(np.float32),
}
SMALL = Cloning.load("rival", "cloning", hidden_sizes=[5], rounds=2, updates=3, batch_size=8, max_delay=4)


def test_a_goal_is_a_position_that_was_reached_later_in_the_sequence() -> None:
    """A loop over all steps and delays, for which every drawn example is looked up."""
    known = {}
    for sequence in range(3):
        for step in range(12):
            now = DATA["position"][sequence, step]
            delta = now - DATA["position"][sequence, max(step - 1, 0)]
            for later in range(step + 1, min(step + 4, 12) + 1):
                state = np.concatenate([now, CHANGE * delta, DATA["position"][sequence, later] - now])
                known[tuple(state.round(4))] = DATA["view"][sequence, step].ravel(), DATA["action"][sequence, step]
    cloner = Cloner(SMALL, [0], DATA)
    drawn = cloner.draw(0, 3000, np.random.default_rng(1))
    keys = [tuple(state.round(4)) for state in drawn.state.numpy()]
    assert {*keys} == {*known}
    for key, pixels, action in zip(keys, drawn.pixels.numpy(), drawn.action.numpy(), strict=True):
        np.testing.assert_array_equal(pixels, known[key][0])
        np.testing.assert_array_equal(action, known[key][1])


def test_a_member_learns_as_it_would_alone() -> None:
    """Two members, and each by itself."""
    both = Cloner(SMALL, [4, 7], DATA)
    alone = [Cloner(SMALL, [seed], DATA) for seed in (4, 7)]
    for each in (both, *alone):
        each.round()
        each.round()
    for member, own in enumerate(alone):
        for one, other in zip(both.network.parameters(), own.network.parameters(), strict=True):
            torch.testing.assert_close(one[member], other[0])


def test_a_policy_learns_what_the_data_show() -> None:
    """Actions that follow from the way to the goal are found again, those of chance become their mean."""
    rng = np.random.default_rng(0)
    position = np.cumsum(rng.normal(0, 0.3, (40, 2, 2)), axis=1).astype(np.float32)
    way = np.diff(position, axis=1)
    action = np.concatenate([(way > 0), rng.uniform(size=(40, 1, 2))], axis=2).astype(np.float32)
    data = {"position": position, "view": np.zeros((40, 1, 1, 11, 11), bool), "action": action}
    settings = Cloning.load("rival", "cloning", hidden_sizes=[8], updates=600, batch_size=32, learning_rate=0.01)
    cloner = Cloner(settings, [0], data)
    cloner.round()
    own = cloner.examples(np.arange(40), np.zeros(40, int), np.ones(40, int))
    outputs = (cloner.network(own.state[None], own.pixels[None])[0] + 1) / 2
    assert ((outputs[:, :2] > 0.5) == (own.action[:, :2] > 0.5)).float().mean() > 0.95
