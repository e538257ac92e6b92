"""Batches: changes of position aligned with actions, each sequence once an epoch, cut in order of time."""

from itertools import chain, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from affmap.data.batches import Batch, DataModule, read
from affmap.data.collect import Exploration
from affmap.settings import ConfigError
from affmap.view import VisibleLayout, view

NUM_SEQUENCES, NUM_STEPS = 9, 25


def write(path: Path, num_sequences: int, num_steps: int) -> Path:
    """A data set whose actions tell sequence and step, with random positions, and views of some world there."""
    rng = np.random.default_rng(0)
    position = rng.uniform(0, 1, (num_sequences, num_steps + 1, 2)).astype(np.float32)
    sequence, step = np.meshgrid(np.arange(num_sequences), np.arange(num_steps), indexing="ij")
    action = np.stack([sequence, step, 0 * step, 0 * step], axis=-1).astype(np.float32)
    world = VisibleLayout((1.0, 1.0), 2, 0, ((0.5, 0.5, 0.2, 1),))
    np.savez(path, position=position, view=view(world, position[:, :-1]), action=action)
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("data") / "dataset.npz", NUM_SEQUENCES, NUM_STEPS)


def module(path: Path, epoch: int = 0, batch_size: int = 2, chunk_length: int = 10, **changes: int) -> DataModule:
    small = {"num_sequences": NUM_SEQUENCES, "num_validation": 3, "num_steps": NUM_STEPS, **changes}
    data = DataModule(path, Exploration.load("data", "default", **small), batch_size, chunk_length)
    data.trainer = cast(Any, SimpleNamespace(current_epoch=epoch))
    return data


def places(loader: Any) -> list[tuple[list[int], list[int], bool]]:
    """Sequences, steps and `is_first` of each batch."""
    actual = []
    for batch in chain.from_iterable(loader):
        sequences, steps = batch.action[0, :, :, 0].int(), batch.action[0, :, :, 1].int()
        assert (sequences == sequences[:, :1]).all() and (steps == steps[:1]).all()
        actual.append((sequences[:, 0].tolist(), steps[0].tolist(), batch.is_first))
    return actual


def order(loader: Any) -> list[int]:
    """Sequences in the order in which they begin."""
    return [sequence for sequences, _, is_first in places(loader) if is_first for sequence in sequences]


def test_changes_of_position_meet_the_actions_that_cause_them(path: Path) -> None:
    """Differences by hand: target[t] = position[t + 1] - position[t], delta[t] = target[t - 1], delta[0] = 0."""
    batch = read(path)
    position = np.load(path)["position"]
    shape = (1, NUM_SEQUENCES, NUM_STEPS)
    assert batch.delta.shape == batch.target.shape == (*shape, 2) and batch.action.shape == (*shape, 4)
    assert batch.is_first is True
    for sequence in range(NUM_SEQUENCES):
        for step in range(NUM_STEPS):
            target = position[sequence, step + 1] - position[sequence, step]
            delta = position[sequence, step] - position[sequence, step - 1] if step else np.zeros(2, np.float32)
            np.testing.assert_array_equal(batch.target[0, sequence, step], target)
            np.testing.assert_array_equal(batch.delta[0, sequence, step], delta)
            assert batch.action[0, sequence, step, :2].tolist() == [sequence, step]


def middles(batch: Batch) -> np.ndarray:
    """`[B, T, K, 4, 4]`, the middle pixels of all windows."""
    ids, window_ids, patch_ids, patches = batch.views
    nine = patches[patch_ids[window_ids[ids]]]  # [1, B, T, 16, 9, K * 9]
    return nine[0, :, :, :, 4].unflatten(-1, (-1, 9))[..., 4].transpose(-1, -2).unflatten(-1, (4, 4)).bool().numpy()


def test_views_stay_with_their_steps(path: Path) -> None:
    """Pixels of the views on disk, for all sequences and for each batch."""
    views = np.load(path)["view"][..., 2:9:2, 2:9:2]
    np.testing.assert_array_equal(middles(read(path)), views)
    for batch in chain.from_iterable(module(path).train_dataloader()):
        sequences, steps = batch.action[0, ..., 0].int(), batch.action[0, ..., 1].int()
        np.testing.assert_array_equal(middles(batch), views[sequences, steps])


def test_training_and_validation_are_disjoint_and_fixed(path: Path) -> None:
    """The last `num_validation` sequences are for validation, in every epoch and with every seed."""
    for epoch in range(3):
        for seed in (0, 1):
            data = module(path, epoch, seed=seed)
            assert order(data.val_dataloader()) == [6, 7, 8]
            assert sorted(order(data.train_dataloader())) == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("batch_size", "chunk_length"), [(2, 10), (4, 25), (6, 7), (10, 100), (1, 1)])
def test_each_epoch_holds_every_step_of_every_sequence_once_and_in_order(
    path: Path, batch_size: int, chunk_length: int
) -> None:
    """Every pair of sequence and step written out; chunks of a batch follow each other, and the first is marked."""
    data = module(path, 0, batch_size, chunk_length)
    for loader, expected in ((data.train_dataloader(), range(6)), (data.val_dataloader(), range(6, 9))):
        actual = places(loader)
        pairs = [(sequence, step) for sequences, steps, _ in actual for sequence in sequences for step in steps]
        assert sorted(pairs) == [(sequence, step) for sequence in expected for step in range(NUM_STEPS)]
        assert all(len(sequences) <= batch_size and len(steps) <= chunk_length for sequences, steps, _ in actual)
        for (before, steps_before, _), (sequences, steps, is_first) in pairwise(actual):
            if is_first:
                assert steps[0] == 0 and steps_before[-1] == NUM_STEPS - 1 and not set(sequences) & set(before)
            else:
                assert sequences == before and steps[0] == steps_before[-1] + 1
        assert actual[0][2] and actual[0][1][0] == 0


def test_the_order_follows_from_seed_and_epoch_alone(path: Path) -> None:
    """Same again, with other batches, and whatever was asked for before; other seeds and epochs have others."""
    orders = {
        (seed, epoch): order(module(path, epoch, seed=seed).train_dataloader()) for seed in (0, 1) for epoch in range(4)
    }
    assert len({tuple(sequences) for sequences in orders.values()}) == len(orders)
    for (seed, epoch), sequences in orders.items():
        assert order(module(path, epoch, 3, 25, seed=seed).train_dataloader()) == sequences
    data = module(path)
    for epoch in (3, 0, 2, 2):
        data.trainer = cast(Any, SimpleNamespace(current_epoch=epoch))
        assert order(data.train_dataloader()) == orders[0, epoch]


def test_each_world_keeps_its_last_sequences_for_validation(path: Path) -> None:
    """Nine sequences as three worlds of three, one of each for validation."""
    data = module(path, num_sequences=3, num_validation=1)
    assert sorted(order(data.val_dataloader())) == [2, 5, 8]
    assert sorted(order(data.train_dataloader())) == [0, 1, 3, 4, 6, 7]
    assert order(data.train_dataloader()) != [0, 1, 3, 4, 6, 7]  # worlds are mixed


def test_96_updates_an_epoch_at_the_paper_s_scale(tmp_path: Path) -> None:
    """Appendix A: 160 sequences of 300 steps, batches of 10, an update every 50 steps: 16 x 6; 40 for validation."""
    settings = Exploration.load("data", "default")
    shape = (settings.num_sequences, settings.num_steps)
    assert shape == (200, 300)
    np.savez(
        tmp_path / "dataset.npz",
        position=np.zeros((shape[0], shape[1] + 1, 2), np.float32),
        view=np.zeros((*shape, 1, 11, 11), bool),
        action=np.zeros((*shape, 4), np.float32),
    )
    data = DataModule(tmp_path / "dataset.npz", settings, 10, 50)
    steps = list(data.train_dataloader())
    assert [len(step) for step in steps] == 16 * [6]
    batches = list(chain(*steps))
    assert len(batches) == 96 and sum(batch.is_first for batch in batches) == 16
    assert {tuple(batch.action.shape) for batch in batches} == {(1, 10, 50, 4)}
    assert {tuple(batch.views.ids.shape) for batch in batches} == {(1, 10, 50)}
    assert sum(batch.action[..., 0].numel() for batch in chain(*data.val_dataloader())) == 40 * 300


def test_a_file_with_pickles_is_refused(tmp_path: Path) -> None:
    """Reading a stranger's data set executes nothing."""
    np.savez(tmp_path / "dataset.npz", position=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(ConfigError, match="an array has the type object"):
        read(tmp_path / "dataset.npz")


def test_reading_uses_float32(path: Path) -> None:
    """The precision of the models' weights."""
    batch = read(path)
    assert {part.dtype for part in (batch.delta, batch.action, batch.target)} == {torch.float32}
