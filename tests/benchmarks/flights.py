"""A small data set of real flights, in the form that a stack wants and in the one that anybody would have."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from affmap.data.batches import Batch, DataModule
from affmap.data.collect import Exploration, collect
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.random import generator
from affmap.training.settings import TrainingSettings
from affmap.view import view

EPOCHS = 4
"""Of a whole fit: enough updates that what Lightning does before the first of them hardly counts."""

EXPLORATION = Exploration.load("data", "default", num_sequences=60, num_validation=10)
SETTINGS = TrainingSettings.load("training", "default", num_epochs=EPOCHS)


class PlainBatch(NamedTuple):
    """A batch of P samples as anybody would have it."""

    views: Tensor
    """`[P, K, 11, 11]` float"""
    delta: Tensor
    """`[P, 2]`, u/step."""
    action: Tensor
    """`[P, 4]`"""
    target: Tensor
    """`[P, 2]`, u/step."""


@cache
def explored() -> dict[str, np.ndarray]:
    """A small data set."""
    return collect([Layout.load("layout", "original")], Vehicle.load("vehicle", "default"), EXPLORATION)


def coloured(channels: int) -> Layout:
    """Experiment I's layout, its circles in `channels` channels in turn."""
    original = Layout.load("layout", "original")
    names = [f"channel {number}" for number in range(channels)]
    circles = [circle.model_dump() | {"channel": names[n % channels]} for n, circle in enumerate(original.circles)]
    return Layout.load("layout", "original", channels=names, border_channel=names[-1], circles=circles)


@cache
def dataset(channels: int = 1) -> Path:
    """Its file, as it would look with circles in so many channels; removed when the program ends."""
    arrays = explored()
    views = view(coloured(channels).map, arrays["true_position"][:, :-1])
    path = Path(_folder().name) / f"{channels}.npz"
    np.savez(path, allow_pickle=False, **{**arrays, "view": views})
    return path


@cache
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory()


def data_module(path: Path | None = None) -> DataModule:
    """The data set for training a stack."""
    return DataModule(path or dataset(), EXPLORATION, SETTINGS.batch_size, SETTINGS.chunk_length)


@cache
def batches(channels: int = 1) -> list[Batch]:
    """The first epoch's batches."""
    return [batch for step in data_module(dataset(channels)).train_dataloader() for batch in step]


def plain_batches() -> list[PlainBatch]:
    """The same batches, each sample by itself."""
    with np.load(dataset()) as arrays:
        position = arrays["position"]
        change = np.diff(position, axis=1, prepend=position[:, :1])
        parts = (arrays["view"].astype(np.float32), change[:, :-1], arrays["action"], change[:, 1:])
    num_training = EXPLORATION.num_sequences - EXPLORATION.num_validation
    order = generator(EXPLORATION.seed, "batch order", 0).permutation(num_training)
    cuts = [
        (sequences, slice(start, start + SETTINGS.chunk_length))
        for sequences in order.reshape(-1, SETTINGS.batch_size)
        for start in range(0, EXPLORATION.num_steps, SETTINGS.chunk_length)
    ]
    return [PlainBatch(*(torch.from_numpy(part[cut]).flatten(0, 1) for part in parts)) for cut in cuts]
