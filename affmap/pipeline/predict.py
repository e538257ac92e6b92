"""The stage `predict`: predictions of trained models, step by step and place by place, for reports."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from affmap.config.root import Config
from affmap.data.batches import DataModule
from affmap.data.collect import DATASET
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, restore
from affmap.pipeline.train import trained, untrained
from affmap.results.files import Deviations, write_deviations, write_steps
from affmap.store.attempt import Attempt
from affmap.training.steps import classify_steps, step_losses, summarise


def make_predictions(config: Config, data: Path, train: Path, attempt: Attempt) -> None:
    """Write the losses of validation steps by kind, and the deviations predicted at the map's nodes."""
    batches = DataModule(data / DATASET, config.data, config.training.batch_size, config.training.chunk_length)
    kinds = classify_steps(data / DATASET, batches.validation)
    names = [config.training_layouts[number // config.data.num_sequences].name for number in batches.validation]
    tables = []
    for epoch, stack in _epochs(config, train):
        table = summarise(step_losses(stack, batches.val_dataloader()), kinds, names, config.seeds)
        table.insert(1, "epoch", epoch)
        tables.append(table)
    write_steps(attempt.folder, pd.concat(tables))
    write_deviations(attempt.folder, _deviations(config, trained(config, train)))


def _epochs(config: Config, train: Path) -> Iterator[tuple[int, Stack]]:
    """The stack after each epoch with a snapshot of the weights, and after the last epoch."""
    snapshots = {int(path.stem.rpartition("-")[2]): path for path in train.glob(SNAPSHOT.format(epoch="*"))}
    for epoch, path in sorted(snapshots.items()):
        if epoch != config.training.num_epochs:
            yield epoch, restore(untrained(config), path)
    yield config.training.num_epochs, trained(config, train)


def _deviations(config: Config, stack: Stack) -> Deviations:
    """Predicted standard deviations of a step from rest with closed throttles."""
    codes = AffordanceMap.paint(stack, [config.map_layout.map], config.report.map_spacing).codes  # [M, Y, X, C]
    num_members, rows, columns, _ = codes.shape
    places = rows * columns
    with torch.inference_mode():
        carry = stack.transition.initial(places)
        rest = codes.new_zeros(num_members, places, 2), codes.new_zeros(num_members, places, 4)
        _, prediction = stack.transition.step()(carry, codes.flatten(1, 2), *rest)
        std = prediction.log_std.exp().unflatten(1, (rows, columns))
    width, height = config.map_layout.size
    return Deviations(std.numpy(), np.linspace(0, width, columns), np.linspace(0, height, rows), np.array(config.seeds))
