"""One training from start to end: Lightning's loop, checkpoints to resume from, snapshots, the table of losses.

Everything goes into one folder; called again with the folder of an interrupted training, it goes on from there.
"""

import logging
import os
import warnings
from collections.abc import Callable
from pathlib import Path

import lightning
import pandas as pd
import torch
from lightning.pytorch.callbacks import Checkpoint

from affmap.data.module import DataModule
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, WEIGHTS, save
from affmap.reading import reading
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

VALIDATION = "validation.csv"


class _Epochs(Checkpoint):
    """After each epoch: a snapshot where one is wanted, a checkpoint, and word of how far the training is.

    Lightning calls its kind of callback after the module's own hook, when the losses of the epoch are noted.
    """

    def __init__(self, checkpoint: Path, snapshots: set[int], on_epoch: Callable[[int], None]) -> None:
        self._checkpoint, self._snapshots, self._on_epoch = checkpoint, snapshots, on_epoch

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        epoch = trainer.current_epoch + 1
        if epoch in self._snapshots:
            assert isinstance(pl_module, TrainingModule)
            save(pl_module.stack, self._checkpoint.with_name(SNAPSHOT.format(epoch=f"{epoch:03d}")))
        partial = self._checkpoint.with_suffix(".partial")
        trainer.save_checkpoint(partial)
        os.replace(partial, self._checkpoint)  # a kill at any moment leaves a whole one
        self._on_epoch(epoch)


def fit(
    stack: Stack,
    data: DataModule,
    settings: TrainingSettings,
    folder: Path,
    on_epoch: Callable[[int], None] = lambda epoch: None,
) -> None:
    """Train `stack` and write `weights.safetensors`, snapshots and `validation.csv` into `folder`.

    A checkpoint after each epoch (`last.ckpt`, removed at the end) is what an interrupted training resumes from, with
    the result that it would have had (on a GPU, which adds in no fixed order: to rounding). `on_epoch` is called with
    the number of epochs done.
    """
    # Lightning greets, advises and says good-bye; it warns of its own use of a renamed class of PyTorch, and of data
    # read without helpers (all of it is in memory).
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*LeafSpec.* is deprecated")
    warnings.filterwarnings("ignore", message=".*does not have many workers")
    module = TrainingModule(stack, settings)
    checkpoint = folder / "last.ckpt"
    trainer = lightning.Trainer(
        accelerator=settings.accelerator,
        devices=1,
        max_epochs=settings.num_epochs,
        reload_dataloaders_every_n_epochs=1,  # each epoch has an order of its own
        num_sanity_val_steps=0,
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[_Epochs(checkpoint, {*settings.snapshot_epochs, settings.num_epochs}, on_epoch)],
    )
    if checkpoint.exists():
        with reading(checkpoint):  # a damaged one is told; that of a stranger executes nothing
            torch.load(checkpoint, map_location="cpu", weights_only=True)
    trainer.fit(module, data, ckpt_path=checkpoint if checkpoint.exists() else None, weights_only=True)
    save(stack, folder / WEIGHTS)
    losses(module).to_csv(folder / VALIDATION, index=False, float_format="%.6f")
    checkpoint.unlink()


def losses(module: TrainingModule) -> pd.DataFrame:
    """The tidy table of a training: member, epoch (from 1), training and validation NLL in nats."""
    rows = [
        (seed, epoch + 1, module.training_nll[epoch, member].item(), module.validation_nll[epoch, member].item())
        for member, seed in enumerate(module.stack.seeds)
        for epoch in range(module.settings.num_epochs)
    ]
    return pd.DataFrame(rows, columns=["member", "epoch", "training_nll", "validation_nll"])
