"""The stage `train`: a stack of members, trained on the data."""

from pathlib import Path
from typing import TYPE_CHECKING

from affmap.config.root import Config
from affmap.data.collect import DATASET
from affmap.learning.settings import OfflineLearning
from affmap.model.stack import Stack
from affmap.model.weights import WEIGHTS, restore
from affmap.pipeline.learn import make_learners
from affmap.pipeline.progress import track
from affmap.pipeline.stage import TRAIN
from affmap.results.provenance import leaves
from affmap.results.setting import CONTEXT_SIZE, make_factor
from affmap.settings.messages import counted
from affmap.store.attempt import Attempt

if TYPE_CHECKING:
    from affmap.training.boards import Board


def make_models(config: Config, data: Path, attempt: Attempt) -> None:
    """Train; write weights and losses."""
    if isinstance(config.learning, OfflineLearning):
        _fit(config, data, attempt)
    else:
        make_learners(config, config.learning, data, attempt)


def _fit(config: Config, data: Path, attempt: Attempt) -> None:
    """Train on the data set."""
    from affmap.data.batches import DataModule  # Lightning takes seconds to import
    from affmap.training.fit import fit

    training = config.training
    batches = DataModule(
        data / DATASET, config.data, training.batch_size, training.chunk_length, pasted=config.model.code.paste > 0
    )
    num_trials = training.num_trials
    trials = f"{counted(num_trials, 'trial')} of " if num_trials else ""
    description = f"training of {trials}{counted(config.members, 'member')}, {config.model.name}"
    with track(description, training.num_epochs, "epochs", attempt.progress) as update:

        def on_epoch(epoch: int, validation_nll: float) -> None:
            update(epoch, f"validation {validation_nll:.2f} nats")

        fit(untrained(config), batches, training, attempt.folder, attempt.scratch, on_epoch, _board(config))


def _board(config: Config) -> "Board | None":
    """The board that shows a job's training, if there is one."""
    if config.logger == "csv":
        return None
    from affmap.training.boards import Training, open_board

    stage = TRAIN.of(config)
    values = leaves({**stage.config})
    swept = [make_factor(key).format(values[key]) for key in config.sweep if key in values and key != CONTEXT_SIZE.key]
    label = ", ".join([config.model.name, *swept, stage.digest[:8]]).replace("/", "-")
    return open_board(config.logger, Training(config.name, label, stage.config, config.output))


def untrained(config: Config) -> Stack:
    """The stack before training; with R trials it has R x M members, trial by trial, with equal initial weights."""
    return Stack(config.model, len(config.channels), (config.training.num_trials or 1) * tuple(config.seeds))


def trained(config: Config, train: Path) -> Stack:
    """The stack after training, from the folder of its stage."""
    return restore(untrained(config), train / WEIGHTS)
