"""Losses of single steps: their mean is the validation loss, their kinds are those of a data set written by hand."""

from pathlib import Path

import numpy as np
import pytest
import torch

from affmap.data.batches import DataModule
from affmap.data.collect import DATASET, collect, write_dataset
from affmap.data.settings import Exploration
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.model.stack import ModelSettings, Stack
from affmap.results.files import EVERYWHERE, KINDS
from affmap.settings import ConfigError
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings
from affmap.training.steps import classify_steps, step_losses, summarise

EXPLORATION = Exploration.load("data", "default", num_sequences=5, num_steps=120, num_validation=2)
VEHICLE = Vehicle.load("vehicle", "default")
WORLDS = [Layout.load("layout", name) for name in ("training_fog", "training_obstacles")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of two worlds."""
    path = tmp_path_factory.mktemp("steps")
    write_dataset(path, collect(WORLDS, VEHICLE, EXPLORATION))
    return path


def test_the_mean_over_all_steps_is_the_validation_loss(folder: Path) -> None:
    """Against the training's own mean, `TrainingModule.loss` weighted by the length of chunks."""
    batches = DataModule(folder / DATASET, EXPLORATION, batch_size=3, chunk_length=50)
    stack = Stack(ModelSettings.load("model", "default", context_size=3), 4, seeds=(0, 7))
    losses = step_losses(stack, batches.val_dataloader())
    assert losses.shape == (2, 4, 120)
    module, total, count = TrainingModule(stack, TrainingSettings.load("training", "default")), torch.zeros(2), 0
    for chunks in batches.val_dataloader():
        for chunk in chunks:
            number = chunk.action[..., 0].numel()
            total, count = total + number * module.loss(chunk).detach(), count + number
    torch.testing.assert_close(losses.mean((1, 2)), total / count, rtol=1e-5, atol=1e-5)


def test_a_member_s_losses_are_the_same_alone(folder: Path) -> None:
    batches = DataModule(folder / DATASET, EXPLORATION, batch_size=3, chunk_length=50)
    stack = Stack(ModelSettings.load("model", "default", context_size=3), 4, seeds=(0, 7))
    both, alone = (step_losses(each, batches.val_dataloader()) for each in (stack, stack.select([1])))
    torch.testing.assert_close(both[1:], alone, rtol=1e-5, atol=1e-5)


def test_kinds_of_steps_by_hand(tmp_path: Path) -> None:
    """Noise where the reported position is not the true one; fog goes before contact."""
    true = np.zeros((1, 7, 2), np.float32)
    in_fog = np.array([0, 0, 1, 1, 0, 0, 0])
    arrays = {
        "position": true + in_fog[None, :, None],
        "true_position": true,
        "touching": np.array([[False, True, True, True, True, False]]),
    }
    np.savez(tmp_path / "dataset.npz", **arrays)
    found = classify_steps(tmp_path / "dataset.npz", np.array([0]))
    assert [KINDS[kind] for kind in found[0]] == ["free", "entering", "inside", "leaving", "touching", "free"]


def test_in_fog_is_what_the_layout_says(folder: Path) -> None:
    """The steps with noise are those that begin or end inside a circle of fog; in the other world there are none."""
    found = classify_steps(folder / DATASET, np.arange(10))
    positions = np.load(folder / DATASET)["true_position"].astype(float)
    inside = [np.linalg.norm(positions[:5] - circle.center, axis=-1) < circle.radius for circle in WORLDS[0].circles]
    ends = np.any(inside, axis=0)
    noisy = ends[:, 1:].astype(int) + ends[:, :-1]
    names = np.array(KINDS)[found]
    np.testing.assert_array_equal(
        noisy, np.select([names[:5] == "inside", names[:5] == "touching"], [2, 0], names[:5] != "free")
    )
    assert (noisy > 0).any() and not np.isin(names[5:], ["entering", "inside", "leaving"]).any()


def test_the_table_has_a_row_for_what_occurs_in_each_world_and_in_all() -> None:
    """By hand: two members, two worlds of one sequence each."""
    losses = torch.tensor([[[1.0, 2.0, 6.0], [0.0, 4.0, 8.0]], [[2.0, 3.0, 7.0], [1.0, 5.0, 9.0]]])
    table = summarise(losses, np.array([[0, 0, 1], [0, 0, 0]]), ["a", "b"], (3, 9))
    rows = [tuple(row) for row in table[table["member"] == 9].itertuples(index=False)]
    assert rows == [
        (9, "a", "free", 2, 2.5, 2.5),
        (9, "a", "touching", 1, 7.0, 7.0),
        (9, "b", "free", 3, 5.0, 5.0),
        (9, EVERYWHERE, "free", 5, 4.0, 3.0),
        (9, EVERYWHERE, "touching", 1, 7.0, 7.0),
    ]


def test_a_damaged_data_set_is_told(tmp_path: Path) -> None:
    (tmp_path / "dataset.npz").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match=r"dataset\.npz"):
        classify_steps(tmp_path / "dataset.npz", np.array([0]))
