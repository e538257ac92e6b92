"""Execution of a job: its stages in order, each skipped if it is complete. Knows no command lines.

Imports everything that stages are made with, which takes seconds; `affmap.pipeline.job` does without.
"""

import logging
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path

import numpy as np
import torch

from affmap import compiled
from affmap.config.root import Config, label
from affmap.pipeline.blocks import make_blocks
from affmap.pipeline.collect import make_data
from affmap.pipeline.control import make_runs
from affmap.pipeline.job import as_setting, check_models, check_trials, incomplete, open_store
from affmap.pipeline.machine import check_devices, check_logger, check_rival
from affmap.pipeline.paint import make_maps
from affmap.pipeline.policy import make_policies
from affmap.pipeline.predict import make_predictions
from affmap.pipeline.stage import (
    BLOCKS,
    CONTROL,
    DATA,
    MAP,
    PREDICT,
    TRAIN,
    StageDefinition,
    control_of,
    policy_of,
    stages_of,
)
from affmap.pipeline.train import make_models
from affmap.results import files
from affmap.results.setting import Setting
from affmap.store.attempt import Attempt

log = logging.getLogger("affmap")


def run(config: Config) -> Setting:
    """Complete all stages of a job; returns them as a setting.

    Raises:
        ConfigError: there are no models for it, or models of several trials.
        MachineError: a package or a GPU is missing.
    """
    check_models(config)
    check_trials(config)
    check_logger(config)
    check_rival(config, incomplete(config, stages_of(config)))
    _set_up(config)
    data, train = models(config, (TRAIN, CONTROL))
    make: dict[StageDefinition, Callable[[Attempt], None]] = {
        PREDICT: lambda attempt: make_predictions(config, data, train, attempt),
        MAP: lambda attempt: make_maps(config, train, attempt),
        BLOCKS: lambda attempt: make_blocks(config, train, attempt),
    }
    folders = {
        stage.name: _ensure(config, stage, (CONTROL,), make[stage]) for stage in stages_of(config) if stage in make
    }
    if policy := policy_of(config):
        folders[policy.name] = _ensure(
            config, policy, (CONTROL,), lambda attempt: make_policies(config, data, train, attempt)
        )
    fly = partial(make_runs, config, train, folders.get("policy"))
    others = [*folders.values(), _ensure(config, control_of(config), (CONTROL,), fly)]
    log.info("%s: complete", label(config))
    return as_setting(config, (data, train, *others))


def validation(config: Config) -> np.ndarray:
    """Complete a training, without maps and control; returns the validation NLL at its end.

    `[R]`, one for each trial (a single one without trials), nats: medians over members, because members have outliers
    in single epochs; NaN where a member has diverged.

    Raises:
        ConfigError: there are no models for it.
        MachineError: a package or a GPU is missing.
    """
    check_models(config)
    check_logger(config)
    _set_up(config)
    _, train = models(config, (TRAIN,))
    table = files.read_validation(train).query(f"epoch == {config.training.num_epochs}")
    losses = table["validation_nll"].to_numpy().reshape(-1, config.members)
    return np.median(losses, axis=1)


def score(config: Config) -> float | list[float]:
    """The `objective` of a search for a job, which is completed as far as needed.

    A number, or one for each trial: median validation NLL of the members (nats), mean distance to the goal over all
    runs (u), or the share of successful runs.

    Raises:
        ConfigError: there are no models for it, or several trials are to fly.
        MachineError: a package or a GPU is missing.
    """
    if config.objective == "validation_nll":
        values = validation(config)
        return values.tolist() if config.training.num_trials else float(values[0])
    objective, (folder,) = str(config.objective), run(config).control
    return float(files.read_runs(folder, [objective])[objective].mean())


def _set_up(config: Config) -> None:
    """Configure the process: threads, and whether loops are compiled."""
    torch.set_num_threads(config.threads)
    compiled.use(config.compiled)


def models(config: Config, planned: Collection[StageDefinition], dataset: Path | None = None) -> tuple[Path, Path]:
    """Complete exploration, unless there is a data set, and training; returns their folders."""
    data = dataset or _ensure(config, DATA, planned, lambda attempt: make_data(config, attempt))
    return data, _ensure(config, TRAIN, planned, lambda attempt: make_models(config, data, attempt))


def _ensure(
    config: Config, stage: StageDefinition, planned: Collection[StageDefinition], make: Callable[[Attempt], None]
) -> Path:
    """Complete a stage; returns its folder. The devices of all `planned` stages are checked before the first is made.

    That is part of an attempt, so that the status of the job gives the reason.
    """

    def build(attempt: Attempt) -> None:
        check_devices(config, incomplete(config, planned))
        make(attempt)

    return open_store(config).ensure(stage.of(config), build)
