"""The stage `train` of agents that learn online: rounds of exploration and training, and what agents saw meanwhile."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from affmap.config.root import Config
from affmap.data.batches import DataModule
from affmap.data.collect import DATASET, coverage
from affmap.learning.goals import is_reached
from affmap.learning.learners import Learners
from affmap.learning.settings import AnyOnlineLearning, GoalLearning
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, WEIGHTS, copy, save
from affmap.pipeline.progress import track
from affmap.results.files import VALIDATION_COLUMNS, Experience, write_experience, write_validation
from affmap.settings.messages import counted
from affmap.store.attempt import Attempt
from affmap.store.files import guarded_read
from affmap.training.fit import keep, last


def beginners(config: Config, settings: AnyOnlineLearning) -> Learners:
    """Agents that have learned nothing yet."""
    stack = Stack(config.model, len(config.channels), config.seeds)
    return Learners(stack, config.training_layouts, config.vehicle, config.data, settings, config.training)


def make_learners(config: Config, settings: AnyOnlineLearning, data: Path, attempt: Attempt) -> None:
    """Let agents learn online; write weights, losses and where they were.

    Losses are those of the validation sequences of the data set in the folder `data`, as in a training on its others.
    Each round leaves a checkpoint, from which an interrupted attempt goes on.
    """
    training = config.training
    batches = DataModule(data / DATASET, config.data, training.batch_size, training.chunk_length)
    held_out = [chunk for chunks in batches.val_dataloader() for chunk in chunks]
    learners = beginners(config, settings)
    losses: list[Tensor] = []
    snapshots: dict[int, dict[str, Tensor]] = {}
    if checkpoint := last(attempt.scratch):
        with guarded_read(checkpoint):  # untrusted checkpoint: `weights_only` refuses pickled code
            content = torch.load(checkpoint, weights_only=True)
            learners.load(content["learners"])
            losses, snapshots = content["losses"], content["snapshots"]
    agents = counted(len(learners.agents), "agent")
    description = f"learning online of {agents}, {config.model.name}, {settings.kind}"
    with track(description, training.num_epochs, "rounds", attempt.progress) as update:
        update(learners.num_rounds)
        while learners.num_rounds < training.num_epochs:
            own = learners.round()
            losses.append(torch.stack([own, learners.evaluate(held_out)]))
            if learners.num_rounds in training.snapshot_epochs:
                snapshots[learners.num_rounds] = copy(learners.stack)
            state = {"learners": learners.state(), "losses": losses, "snapshots": snapshots}
            keep(attempt.scratch, partial(torch.save, state))
            update(learners.num_rounds, f"validation {losses[-1][1].quantile(0.5):.2f} nats")
    for number, weights in snapshots.items():
        save(weights, attempt.folder / SNAPSHOT.format(epoch=f"{number:03d}"))
    save(copy(learners.stack), attempt.folder / WEIGHTS)
    write_validation(attempt.folder, _table(config.seeds, losses))
    write_experience(attempt.folder, _experience(learners))


def _table(seeds: range, losses: list[Tensor]) -> pd.DataFrame:
    """Table of losses, a list of `[2, M]` (training, validation) by rounds."""
    rows = [
        (seed, number + 1, *pair[:, member].tolist())
        for member, seed in enumerate(seeds)
        for number, pair in enumerate(losses)
    ]
    return pd.DataFrame(rows, columns=VALIDATION_COLUMNS)


def _experience(learners: Learners) -> Experience:
    """Where the agents were."""
    covered = [coverage(layout, learners.vehicle, np.empty((0, 2))) for layout in learners.layouts]
    rounds = [[(learners.layout(number), each) for number, each in enumerate(own)] for own in learners.rounds]
    counts = [
        [coverage(layout, learners.vehicle, each.true_position[1:])["counts"] for layout, each in own] for own in rounds
    ]
    shares = [[(each.touching.mean(), each.in_fog.mean()) for each in own] for own in learners.rounds]
    touching, in_fog = np.array(shares, np.float32).transpose(2, 0, 1)
    free = np.stack([each["free"] for each in covered])
    return Experience(np.array(counts, np.int32), free, touching, in_fog, np.array(learners.agents), _reached(learners))


def _reached(learners: Learners) -> np.ndarray | None:
    """Goals that each agent reached in each round, `[A, R]`, if it had some."""
    settings = learners.settings
    if not isinstance(settings, GoalLearning):
        return None
    reached = [
        [
            is_reached(each.true_position[1:], each.goal, settings.goal_radius).sum()
            for each in own
            if each.goal is not None
        ]
        for own in learners.rounds
    ]
    return np.array(reached, np.int32)
