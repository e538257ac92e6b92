"""The stage `policy`: the policies of a rival, one a member."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.data.collect import DATASET, read_dataset
from affmap.model.lookup import make_lookup
from affmap.pipeline.progress import track
from affmap.pipeline.train import trained
from affmap.rivals.cloning import Cloner
from affmap.rivals.distilled import Distiller
from affmap.rivals.learned import Reinforced
from affmap.rivals.policy import Network, Policy
from affmap.rivals.settings import TD3BC, Cloning, Distillation, Reinforcement, Rival
from affmap.rivals.td3_bc import Offline
from affmap.settings.messages import counted
from affmap.store.attempt import Attempt
from affmap.store.files import guarded_read
from affmap.training.fit import keep, last

WEIGHTS = "policy.safetensors"


class Learner(Protocol):
    """A training in rounds, which can go on later."""

    network: Network
    num_rounds: int

    @property
    def total(self) -> int:
        """Number of rounds of the whole training."""

    def round(self) -> None:
        """Learn for a round."""

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors and numbers."""

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""


def make_policies(config: Config, data: Path, train: Path, attempt: Attempt) -> None:
    """Train the policies of a rival, from the last round that an interrupted attempt has left; write their weights."""
    learner, rival = _learner(config, data, train), config.rival
    if checkpoint := last(attempt.scratch):
        with guarded_read(checkpoint):  # untrusted checkpoint: `weights_only` refuses pickled code
            learner.load(torch.load(checkpoint, weights_only=True))
    description = f"{config.controller} of {counted(len(config.pilots), 'member')}"
    unit = "members" if isinstance(rival, Reinforcement) else "rounds"
    with track(description, learner.total, unit, attempt.progress) as update:
        update(learner.num_rounds)
        while learner.num_rounds < learner.total:
            learner.round()
            keep(attempt.scratch, partial(torch.save, learner.state()))
            update(learner.num_rounds)
    save_file({key: part.contiguous() for key, part in learner.network.state_dict().items()}, attempt.folder / WEIGHTS)


def load_policy(config: Config, folder: Path) -> Policy:
    """The policies of the stage in a folder.

    Raises:
        ConfigError: the file is corrupted, or holds the weights of others.
    """
    assert isinstance(config.rival, Rival)
    generators = [torch.Generator() for _ in config.pilots]
    network = Network.of(config.rival, generators, len(config.channels))
    with guarded_read(folder / WEIGHTS):
        network.load_state_dict(load_file(folder / WEIGHTS))
    return Policy(network)


def _learner(config: Config, data: Path, train: Path) -> Learner:
    assert isinstance(config.rival, Rival)
    rival, seeds = config.rival.scaled(config.rival_share), config.pilots
    if isinstance(rival, Cloning):
        return Cloner(rival, seeds, _for_training(config, read_dataset(data / DATASET)))
    if isinstance(rival, TD3BC):
        return Offline(rival, seeds, _for_training(config, read_dataset(data / DATASET)))
    if isinstance(rival, Distillation):
        stack = trained(config, train).select(range(len(seeds)))
        layouts = [config.training_layouts[flight % len(config.training_layouts)] for flight in range(rival.flights)]
        worlds = layouts[:1] if len(config.training_layouts) == 1 else layouts * len(seeds)
        lookup = make_lookup(config.lookup, stack, [layout.map for layout in worlds])
        agent = Agent(stack, lookup, config.planner, config.control)
        return Distiller(rival, seeds, agent, config.training_layouts, config.vehicle)
    assert isinstance(rival, Reinforcement)
    return Reinforced(rival, seeds, config.training_layouts, config.vehicle)


def _for_training(config: Config, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The sequences that models learn from, too: those that are not kept for validation."""
    exploration = config.data
    sequences = np.arange(len(arrays["action"])).reshape(-1, exploration.num_sequences)
    chosen = sequences[:, : exploration.num_sequences - exploration.num_validation].ravel()
    return {key: part[chosen] for key, part in arrays.items()}
