"""The stage `train`: a stack of members, trained on the data."""

from pathlib import Path

from affmap.config.root import Config
from affmap.data.collect import DATASET
from affmap.model.stack import Stack
from affmap.model.weights import WEIGHTS, restore
from affmap.pipeline.progress import track
from affmap.pipeline.stage import TRAIN
from affmap.store.attempt import Attempt


def make_models(config: Config, data: Path, attempt: Attempt) -> None:
    """Train; write weights and losses."""
    from affmap.data.batches import DataModule  # Lightning takes seconds to import
    from affmap.training.fit import fit

    batches = DataModule(data / DATASET, config.data, config.training.batch_size, config.training.chunk_length)
    num_trials = config.training.num_trials
    trials = f"{num_trials} trials of " if num_trials else ""
    description = f"training of {trials}{config.members} members, {config.model.name}"
    with track(description, config.training.num_epochs, "epochs", attempt.progress) as update:

        def on_epoch(epoch: int, validation_nll: float) -> None:
            update(epoch, f"validation {validation_nll:.2f} nats")

        fit(untrained(config), batches, config.training, attempt.folder, attempt.scratch, on_epoch, _board(config))


def _board(config: Config) -> Path | None:
    """TensorBoard's folder of a job's training, which other jobs may share."""
    if config.logger != "tensorboard":
        return None
    return config.output / "tensorboard" / f"context{config.model.context_size}_{TRAIN.of(config).digest}"


def untrained(config: Config) -> Stack:
    """The stack before training; with R trials it has R x M members, trial by trial, with equal initial weights."""
    return Stack(config.model, len(config.channels), (config.training.num_trials or 1) * tuple(config.seeds))


def trained(config: Config, train: Path) -> Stack:
    """The stack after training, from the folder of its stage."""
    return restore(untrained(config), train / WEIGHTS)
