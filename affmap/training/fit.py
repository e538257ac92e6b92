"""One training from start to end: Lightning's loop, checkpoints to resume from, snapshots, the table of losses.

Everything goes into one folder; called again with the folder of an interrupted training, it goes on from there.
"""

import logging
import warnings
from collections.abc import Callable
from pathlib import Path

import lightning
import pandas as pd
from lightning.pytorch.callbacks import Callback, ModelCheckpoint
from safetensors.torch import load_file, save_file

from affmap.data.module import DataModule
from affmap.model.stack import Stack
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

WEIGHTS = "weights.safetensors"
VALIDATION = "validation.csv"


class _Epochs(Callback):
    """Keeps snapshots, and tells how far the training is."""

    def __init__(self, folder: Path, epochs: set[int], on_epoch: Callable[[int], None]) -> None:
        self._folder, self._epochs, self._on_epoch = folder, epochs, on_epoch

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        epoch = trainer.current_epoch + 1
        if epoch in self._epochs:
            assert isinstance(pl_module, TrainingModule)
            save(pl_module.stack, self._folder / f"weights-epoch-{epoch:03d}.safetensors")
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
    the result that it would have had. `on_epoch` is called with the number of epochs done.
    """
    # Lightning greets, advises and says good-bye; and it warns of its own use of a renamed class of PyTorch.
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*LeafSpec.* is deprecated")
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
        callbacks=[
            _Epochs(folder, {*settings.snapshot_epochs, settings.num_epochs}, on_epoch),
            ModelCheckpoint(folder, save_last=True, save_top_k=0, every_n_epochs=1, save_on_train_epoch_end=True),
        ],
    )
    trainer.fit(module, data, ckpt_path=checkpoint if checkpoint.exists() else None)
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


def save(stack: Stack, path: Path) -> None:
    """Write the weights of a stack, `[M, ...]` each."""
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in stack.state_dict().items()}, path)


def restore(stack: Stack, path: Path) -> Stack:
    """Give a stack the weights at `path`; safetensors, so that reading a stranger's file executes nothing."""
    stack.load_state_dict(load_file(path))
    return stack.eval()
