"""Batches of an agent's experience."""

from collections import Counter

import numpy as np
import torch

from affmap.learning.experience import Round, batches
from affmap.model.windows import take_apart


def rounds(number: int, steps: int = 12) -> list[Round]:
    """Rounds of noise; each step has an action of its own."""
    rng = np.random.default_rng(0)
    return [
        Round(
            position=rng.normal(size=(steps + 1, 2)).astype(np.float32),
            true_position=rng.normal(size=(steps + 1, 2)).astype(np.float32),
            view=rng.random((steps, 1, 11, 11)) < 0.3,
            action=rng.random((steps, 4)).astype(np.float32),
            touching=np.zeros(steps, bool),
            in_fog=np.zeros(steps, bool),
        )
        for _ in range(number)
    ]


def test_a_chunk_is_a_piece_of_a_round() -> None:
    """Slices of the rounds' arrays; the vehicle is at rest before the first step of a round, and only there."""
    own = rounds(3)
    (batch,) = batches(own, 9, 4, 1, np.random.default_rng(1))
    assert batch.action.shape == (1, 9, 4, 4)
    found = set()
    for chunk, action in enumerate(batch.action[0]):
        number, step = next(
            (number, step)
            for number, each in enumerate(own)
            for step in (0, 4, 8)
            if (each.action[step] == action[0].numpy()).all()
        )
        found.add((number, step))
        each, cut = own[number], slice(step, step + 4)
        np.testing.assert_array_equal(action, each.action[cut])
        np.testing.assert_array_equal(batch.target[0, chunk], each.position[step + 1 : step + 5] - each.position[cut])
        before = each.position[cut] - each.position[[max(step - 1, 0), *range(step, step + 3)]]
        np.testing.assert_array_equal(batch.delta[0, chunk], before)
        views = take_apart(torch.from_numpy(each.view[cut]))
        pictures = batch.views.patches[batch.views.patch_ids[batch.views.window_ids[batch.views.ids[0, chunk]]]]
        torch.testing.assert_close(pictures, views.patches[views.patch_ids[views.window_ids[views.ids]]])
    assert len(found) == 9


def test_each_chunk_is_as_likely_as_any_other() -> None:
    """The binomial distribution of 4,000 batches of 2 of 6 chunks: 1,333 times each, deviation 30."""
    drawn = batches(rounds(2), 2, 4, 4000, np.random.default_rng(0))
    counts = Counter(tuple(action[0].tolist()) for batch in drawn for action in batch.action[0])
    assert len(counts) == 6
    assert all(abs(count - 4000 / 3) < 4 * 30 for count in counts.values())


def test_fewer_chunks_than_a_batch_are_all_of_them() -> None:
    """The number of chunks."""
    (batch,) = batches(rounds(1), 10, 4, 1, np.random.default_rng(0))
    assert batch.action.shape[1] == 3
