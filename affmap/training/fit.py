"""A whole training: Lightning's loop, checkpoints, snapshots and the table of losses.

Called again with the checkpoints of an interrupted training, it resumes.
"""

from __future__ import annotations

import logging
import signal
import warnings
from collections.abc import Callable
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import pandas as pd
import torch
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.pytorch.callbacks import Checkpoint
from torch import Tensor

from affmap.data.batches import DataModule
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, WEIGHTS, copy, save
from affmap.results.files import write_validation
from affmap.store.files import atomic_write, guarded_read, sha256
from affmap.training.boards import Board
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

log = logging.getLogger("affmap")

OnEpoch = Callable[[int, float], None]
"""Called with the number of completed epochs, and the members' median validation NLL after the last of them, nats."""


class _Epochs(Checkpoint):
    """Writes snapshots, a checkpoint and losses for a board after each epoch, and reports progress.

    Lightning calls this kind of callback after the module's own hook, which stores the losses of the epoch. Snapshots
    are part of the checkpoint, so a single file holds everything that an interrupted training needs.
    """

    def __init__(self, checkpoints: Path, snapshot_epochs: set[int], on_epoch: OnEpoch, board: Board | None) -> None:
        self._checkpoints, self._snapshot_epochs, self._on_epoch = checkpoints, snapshot_epochs, on_epoch
        self._board = board
        self.snapshots: dict[int, dict[str, Tensor]] = {}

    def state_dict(self) -> dict[str, Any]:
        return {"snapshots": self.snapshots}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.snapshots = state_dict["snapshots"]

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        assert isinstance(pl_module, TrainingModule)
        epoch = trainer.current_epoch + 1
        if epoch in self._snapshot_epochs:
            self.snapshots[epoch] = copy(pl_module.stack)
        keep(self._checkpoints, trainer.save_checkpoint)
        if self._board:
            self._board.show(pl_module, epoch)
        self._on_epoch(epoch, pl_module.validation_nll[epoch - 1].quantile(0.5).item())


def keep(checkpoints: Path, save: Callable[[Path], None]) -> None:
    """Save a checkpoint in a folder, named by its digest, and remove its predecessors."""
    temporary = checkpoints / "checkpoint.tmp"
    save(temporary)
    digest = sha256(temporary)
    with atomic_write(checkpoints / f"{digest}.ckpt") as place:
        temporary.replace(place)
    for old in checkpoints.glob("*.ckpt"):
        if old.stem != digest:
            old.unlink()


def last(checkpoints: Path) -> Path | None:
    """Last intact checkpoint in a folder, or None; corrupted ones are skipped with a warning."""
    for path in sorted(checkpoints.glob("*.ckpt"), key=lambda path: path.stat().st_mtime_ns, reverse=True):
        if sha256(path) == path.stem:
            return path
        log.warning("%s is corrupted; without it, more of the training is repeated.", path)
    return None


def fit(
    stack: Stack,
    data: DataModule,
    settings: TrainingSettings,
    folder: Path,
    checkpoints: Path,
    on_epoch: OnEpoch = lambda epoch, validation_nll: None,
    board: Board | None = None,
) -> None:
    """Train `stack` and write `weights.safetensors`, snapshots and `validation.csv` into `folder`.

    An interrupted training resumes from the checkpoint that each epoch leaves in the folder `checkpoints`, with the
    same result (up to rounding on a GPU, which adds in no fixed order). `on_epoch` is called after each epoch. `board`
    shows the losses meanwhile, and is closed.
    """
    # Lightning logs advice, and warns of its own use of a renamed class of PyTorch and of data loaded without workers
    # (all data are in memory).
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*LeafSpec.* is deprecated")
    warnings.filterwarnings("ignore", message=".*does not have many workers")
    module = TrainingModule(stack, settings)
    with closing(board) if board else nullcontext():
        epochs = _Epochs(checkpoints, {*settings.snapshot_epochs, settings.num_epochs}, on_epoch, board)
        _train(module, data, checkpoints, epochs)
        if board:  # nothing is left to train if the last epoch was complete before an interruption
            board.show(module, settings.num_epochs)
    for epoch, weights in epochs.snapshots.items():
        save(weights, folder / SNAPSHOT.format(epoch=f"{epoch:03d}"))
    save(copy(stack), folder / WEIGHTS)
    write_validation(folder, losses(module))


def _train(module: TrainingModule, data: DataModule, checkpoints: Path, epochs: _Epochs) -> None:
    """Run Lightning's loop, from the last checkpoint on."""
    trainer = lightning.Trainer(
        accelerator=module.settings.accelerator,
        devices=1,
        plugins=[LightningEnvironment()],  # a training is a single process, in a cluster's job as well
        max_epochs=module.settings.num_epochs,
        reload_dataloaders_every_n_epochs=1,  # each epoch has an order of its own
        num_sanity_val_steps=0,
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[epochs],
    )
    checkpoint = last(checkpoints)
    if checkpoint:
        with guarded_read(checkpoint):  # untrusted checkpoint: `weights_only` refuses pickled code
            content = torch.load(checkpoint, map_location="cpu", weights_only=True)
            module.load_state_dict(content["state_dict"])
    listener = signal.getsignal(signal.SIGINT)
    try:
        trainer.fit(module, data, ckpt_path=checkpoint, weights_only=True)
    except SystemExit as leaving:
        if isinstance(leaving.__context__, KeyboardInterrupt):  # Lightning exits on it, and ignores further ones
            signal.signal(signal.SIGINT, listener)
            raise KeyboardInterrupt from None
        raise


def losses(module: TrainingModule) -> pd.DataFrame:
    """Tidy table of the losses of a training: member, epoch (from 1), training and validation NLL in nats.

    With trials, a column `trial` (from 0) comes first.
    """
    rows = [
        (seed, epoch + 1, module.training_nll[epoch, member].item(), module.validation_nll[epoch, member].item())
        for member, seed in enumerate(module.stack.seeds)
        for epoch in range(module.settings.num_epochs)
    ]
    table = pd.DataFrame(rows, columns=["member", "epoch", "training_nll", "validation_nll"])
    if num_trials := module.settings.num_trials:
        table.insert(0, "trial", np.repeat(range(num_trials), len(table) // num_trials))
    return table
