"""Views laid over each other: unions by hand, pairs that share no channel, and chosen anew for each chunk."""

from pathlib import Path

import numpy as np
import torch

from affmap.data.batches import DataModule
from affmap.data.collect import Exploration
from affmap.data.pasted import NUM_PAIRS, PAIRS_PER_UPDATE, paste
from affmap.model.windows import Windows, take_apart

SMALL = {"num_sequences": 6, "num_validation": 2, "num_steps": 12}


def recorded(seed: int = 0) -> np.ndarray:
    """`[6, 12, 3, 11, 11]`: sequences with a channel each, whose first views are empty."""
    rng = np.random.default_rng(seed)
    views = np.zeros((6, 12, 3, 11, 11), bool)
    for sequence, channel in enumerate([0, 1, 2, 2, 0, 1]):
        views[sequence, 1:, channel] = rng.random((11, 11, 11)) < 0.3
    return views


def pictures(windows: Windows) -> torch.Tensor:
    """Pixels `[..., 16, 9, K, 9]` of the patches that views are made of."""
    return windows.patches.unflatten(1, (-1, 9))[windows.patch_ids[windows.window_ids[windows.ids]]]


def test_both_is_the_union_of_two_views_without_a_channel_in_common() -> None:
    """Maximum of the pixels of the two, which are recorded views with a circle; the fourth is empty."""
    views = recorded()
    pasted = paste(views, np.random.default_rng(1))
    assert pasted is not None
    first, second, both, empty = pictures(pasted)[0].unbind(1)
    assert len(first) == NUM_PAIRS and torch.equal(both, torch.maximum(first, second)) and not empty.any()
    used = [each.flatten(1, 2).movedim(2, 1).flatten(2).any(2) for each in (first, second)]  # [P, K]
    assert not (used[0] & used[1]).any() and (used[0].sum(1) == 1).all() and (used[1].sum(1) == 1).all()
    there = {each.numpy().tobytes() for each in pictures(take_apart(torch.from_numpy(views))).flatten(0, 1)}
    assert {each.numpy().tobytes() for each in (*first[:50], *second[:50])} <= there
    assert len({tuple(row.tolist()) for row in torch.cat(used, dim=1)}) == 6, "all ordered pairs of channels"


def test_views_of_one_channel_have_nothing_to_compose() -> None:
    """Worlds like those of Experiment I; an agent is trained in them without pairs."""
    assert paste(recorded()[:, :, :1], np.random.default_rng(0)) is None


def write(folder: Path) -> Path:
    rng, views = np.random.default_rng(0), recorded()
    position, action = rng.random((6, 13, 2), np.float32), rng.random((6, 12, 4), np.float32)
    np.savez(folder / "dataset.npz", position=position, view=views, action=action)
    return folder / "dataset.npz"


def module(path: Path, pasted: bool) -> DataModule:
    return DataModule(path, Exploration.load("data", "default", **SMALL), 2, 5, pasted)


def test_each_chunk_of_training_has_its_own_pairs_and_validation_has_none(tmp_path: Path) -> None:
    """The same pairs in a second module of the same seed; other batches stay as they are without pairs."""
    path = write(tmp_path)
    data, again, without = (module(path, pasted) for pasted in (True, True, False))
    chunks, same, plain = ([each for batch in m.train_dataloader() for each in batch] for m in (data, again, without))
    shown = []
    for chunk, twin, bare in zip(chunks, same, plain, strict=True):
        assert chunk.pasted is not None and twin.pasted is not None and bare.pasted is None
        assert chunk.pasted.ids.shape == (1, PAIRS_PER_UPDATE, 4)
        shown.append(pictures(chunk.pasted))
        assert torch.equal(shown[-1], pictures(twin.pasted))
        assert torch.equal(chunk.action, bare.action) and torch.equal(chunk.views.ids, bare.views.ids)
    assert not torch.equal(shown[0], shown[1])
    assert all(each.pasted is None for batch in data.val_dataloader() for each in batch)
