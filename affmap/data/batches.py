"""The data set as batches for training: sequences cut into chunks, views as references to distinct windows.

Knows data sets and Lightning, and of models only the form of their views.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import lightning
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset

from affmap.data.collect import Exploration, read_dataset
from affmap.data.pasted import PAIRS_PER_UPDATE, paste
from affmap.model.windows import Windows, take_apart
from affmap.random import generator
from affmap.store.files import guarded_read


class Batch(NamedTuple):
    """A chunk of T steps of B sequences; the leading 1 is the axis of members, which share all data."""

    views: Windows
    """Views before each step, `[1, B, T]`."""
    delta: Tensor
    """Last change of the reported position, `[1, B, T, 2]`, u/step."""
    action: Tensor
    """`[1, B, T, 4]`"""
    target: Tensor
    """The change of the reported position that the action causes, `[1, B, T, 2]`, u/step."""
    is_first: bool
    """These are the first chunks of their sequences: a hidden state begins anew."""
    pasted: Windows | None = None
    """Views laid over each other, `[1, P, 4]`, see `affmap.data.pasted`."""


def read(path: Path) -> Batch:
    """Read a data set (see `affmap.data.collect`) as one batch of all its S sequences."""
    arrays = read_dataset(path)
    with guarded_read(path):
        delta = torch.from_numpy(np.diff(arrays["position"], axis=1, prepend=arrays["position"][:, :1]))
        views, action = torch.from_numpy(arrays["view"]), torch.from_numpy(arrays["action"])
    return Batch(take_apart(views[None]), delta[None, :, :-1], action[None], delta[None, :, 1:], is_first=True)


class Chunks(IterableDataset[list[Batch]]):
    """Batches of sequences in a given order: for each batch all chunks, which follow each other in time."""

    def __init__(
        self,
        data: Batch,
        order: np.ndarray,
        batch_size: int,
        chunk_length: int,
        rng: np.random.Generator | None = None,
    ) -> None:
        """`order` holds the numbers of the sequences; the last batch and the last chunk may be shorter.

        `rng` chooses from the pasted views of `data`, for each chunk some; without it there are none.
        """
        self._data, self._order = data, torch.from_numpy(order)
        self._batch_size, self._chunk_length, self._rng = batch_size, chunk_length, rng

    def __iter__(self) -> Iterator[list[Batch]]:
        starts = range(0, self._data.action.shape[2], self._chunk_length)
        for sequences in self._order.split(self._batch_size):
            yield [self._chunk(sequences, start) for start in starts]

    def _chunk(self, sequences: Tensor, start: int) -> Batch:
        data, cut = self._data, (slice(None), sequences, slice(start, start + self._chunk_length))
        return Batch(
            data.views.select(cut), data.delta[cut], data.action[cut], data.target[cut], start == 0, self._pasted()
        )

    def _pasted(self) -> Windows | None:
        pasted = self._data.pasted
        if pasted is None or self._rng is None:  # no generator in validation
            return None
        chosen = torch.from_numpy(self._rng.integers(pasted.ids.shape[1], size=PAIRS_PER_UPDATE))
        return pasted.select((slice(None), chosen))


class DataModule(lightning.LightningDataModule):
    """Training and validation batches of a data set on disk.

    The order of the batches follows from the data set's seed and the epoch alone: members share it, and a resumed
    training sees the same batches as an undisturbed one.
    """

    def __init__(
        self, path: Path, exploration: Exploration, batch_size: int, chunk_length: int, pasted: bool = False
    ) -> None:
        """Read the data set at `path`; each layout's last `num_validation` sequences are kept for validation.

        With `pasted`, batches for training have views laid over each other, too.

        Raises:
            ConfigError: the file is corrupted.
        """
        super().__init__()
        self._data = read(path)
        self._exploration = exploration
        self._batch_size, self._chunk_length = batch_size, chunk_length
        sequences = np.arange(self._data.action.shape[1]).reshape(-1, exploration.num_sequences)  # a row per layout
        num_training = exploration.num_sequences - exploration.num_validation
        self._training, self._validation = sequences[:, :num_training].ravel(), sequences[:, num_training:].ravel()
        if pasted:
            views = read_dataset(path)["view"][self._training]
            self._data = self._data._replace(pasted=paste(views, generator(exploration.seed, "pasted views")))

    @property
    def validation(self) -> np.ndarray:
        """Numbers of the validation sequences in the data set, `[S]`, in their order."""
        return self._validation

    def train_dataloader(self) -> DataLoader[list[Batch]]:
        """Batches of the current epoch, in its own order."""
        epoch = self.trainer.current_epoch if self.trainer else 0
        seed = self._exploration.seed
        order = generator(seed, "batch order", epoch).permutation(self._training)
        return self._loader(order, generator(seed, "choice of pasted views", epoch) if self._data.pasted else None)

    def val_dataloader(self) -> DataLoader[list[Batch]]:
        """All validation sequences, always in the same order."""
        return self._loader(self._validation)

    def _loader(self, order: np.ndarray, rng: np.random.Generator | None = None) -> DataLoader[list[Batch]]:
        return DataLoader(Chunks(self._data, order, self._batch_size, self._chunk_length, rng), batch_size=None)
