"""One training from start to end: Lightning's loop, checkpoints to resume from, snapshots, the table of losses.

Called again with the checkpoints of an interrupted training, it goes on from there.
"""

import logging
import signal
import warnings
from collections.abc import Callable
from contextlib import nullcontext
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
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings
from affmap.training.tensorboard import Board

log = logging.getLogger("affmap")


class _Epochs(Checkpoint):
    """After each epoch: a snapshot where one is wanted, a checkpoint, the losses on a board, word of how far it is.

    Lightning calls its kind of callback after the module's own hook, when the losses of the epoch are noted. Snapshots
    are part of the checkpoint, so that a single file holds all that an interrupted training needs.
    """

    def __init__(
        self, checkpoints: Path, snapshot_epochs: set[int], on_epoch: Callable[[int], None], board: Board | None
    ) -> None:
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
        self._on_epoch(epoch)


def keep(checkpoints: Path, save: Callable[[Path], None]) -> None:
    """Put a checkpoint into a folder, named by its own digest, and remove the one before."""
    temporary = checkpoints / "checkpoint.tmp"
    save(temporary)
    digest = sha256(temporary)
    with atomic_write(checkpoints / f"{digest}.ckpt") as place:
        temporary.replace(place)
    for old in checkpoints.glob("*.ckpt"):
        if old.stem != digest:
            old.unlink()


def last(checkpoints: Path) -> Path | None:
    """The last whole checkpoint in a folder, or None; damaged ones are passed over with a warning."""
    for path in sorted(checkpoints.glob("*.ckpt"), key=lambda path: path.stat().st_mtime_ns, reverse=True):
        if sha256(path) == path.stem:
            return path
        log.warning("%s is damaged; without it, more of the training is done again.", path)
    return None


def fit(
    stack: Stack,
    data: DataModule,
    settings: TrainingSettings,
    folder: Path,
    checkpoints: Path,
    on_epoch: Callable[[int], None] = lambda epoch: None,
    board: Path | None = None,
) -> None:
    """Train `stack` and write `weights.safetensors`, snapshots and `validation.csv` into `folder`.

    A checkpoint after each epoch, in the folder `checkpoints`, is what an interrupted training resumes from, with the
    result that it would have had (on a GPU, which adds in no fixed order: to rounding). `on_epoch` is called with the
    number of epochs done. TensorBoard finds the losses in the folder `board`, where there is one.
    """
    # Lightning greets, advises and says good-bye; it warns of its own use of a renamed class of PyTorch, and of data
    # read without helpers (all of it is in memory).
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*LeafSpec.* is deprecated")
    warnings.filterwarnings("ignore", message=".*does not have many workers")
    module = TrainingModule(stack, settings)
    with Board(board) if board else nullcontext() as shown:
        epochs = _Epochs(checkpoints, {*settings.snapshot_epochs, settings.num_epochs}, on_epoch, shown)
        _train(module, data, checkpoints, epochs)
        if shown:  # nothing is left to train where the last epoch was done before an interruption
            shown.show(module, settings.num_epochs)
    for epoch, weights in epochs.snapshots.items():
        save(weights, folder / SNAPSHOT.format(epoch=f"{epoch:03d}"))
    save(copy(stack), folder / WEIGHTS)
    write_validation(folder, losses(module))


def _train(module: TrainingModule, data: DataModule, checkpoints: Path, epochs: _Epochs) -> None:
    """All of Lightning's loop, from the last checkpoint on."""
    trainer = lightning.Trainer(
        accelerator=module.settings.accelerator,
        devices=1,
        plugins=[LightningEnvironment()],  # in a cluster's job, too, a training is a single process
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
        with guarded_read(checkpoint):  # that of a stranger executes nothing, and is told
            torch.load(checkpoint, map_location="cpu", weights_only=True)
    listener = signal.getsignal(signal.SIGINT)
    try:
        trainer.fit(module, data, ckpt_path=checkpoint, weights_only=True)
    except SystemExit as leaving:
        if isinstance(leaving.__context__, KeyboardInterrupt):  # Lightning makes an exit of it, and goes deaf for more
            signal.signal(signal.SIGINT, listener)
            raise KeyboardInterrupt from None
        raise


def losses(module: TrainingModule) -> pd.DataFrame:
    """The tidy table of a training: member, epoch (from 1), training and validation NLL in nats.

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
