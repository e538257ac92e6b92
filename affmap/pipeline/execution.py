"""Execution of a job: its stages in order, each skipped if it is complete. Knows no command lines.

Imports everything that stages are made with, which takes seconds; `affmap.pipeline.job` does without.
"""

import logging
from pathlib import Path

import numpy as np
import torch

from affmap import compiled
from affmap.config.root import Config, label
from affmap.pipeline.collect import make_data
from affmap.pipeline.control import make_runs
from affmap.pipeline.job import as_setting, check_logger, check_models, check_trials, open_store
from affmap.pipeline.paint import make_maps
from affmap.pipeline.predict import make_predictions
from affmap.pipeline.stage import CONTROL, DATA, MAP, PREDICT, TRAIN
from affmap.pipeline.train import make_models
from affmap.results import files
from affmap.results.setting import Setting
from affmap.store.store import Store

log = logging.getLogger("affmap")


def run(config: Config) -> Setting:
    """Complete all stages of a job; returns them as a setting.

    Raises:
        ConfigError: there are no models for it, or models of several trials; or a package is missing.
    """
    check_models(config)
    check_trials(config)
    check_logger(config)
    _set_up(config)
    store = open_store(config)
    data, train = _models(config, store)
    predictions = store.ensure(PREDICT.of(config), lambda attempt: make_predictions(config, data, train, attempt))
    maps = store.ensure(MAP.of(config), lambda attempt: make_maps(config, train, attempt))
    runs = store.ensure(CONTROL.of(config), lambda attempt: make_runs(config, train, attempt))
    log.info("%s: complete", label(config))
    return as_setting(config, (data, train, predictions, maps, runs))


def validation(config: Config) -> np.ndarray:
    """Complete a training, without maps and control; returns the validation NLL at its end.

    `[R]`, one for each trial (a single one without trials), nats: medians over members, because members have outliers
    in single epochs; NaN where a member has diverged.

    Raises:
        ConfigError: there are no models for it; or a package is missing.
    """
    check_models(config)
    check_logger(config)
    _set_up(config)
    _, train = _models(config, open_store(config))
    table = files.read_validation(train).query(f"epoch == {config.training.num_epochs}")
    losses = table["validation_nll"].to_numpy().reshape(-1, config.members)
    return np.median(losses, axis=1)


def score(config: Config) -> float | list[float]:
    """The `objective` of a search for a job, which is completed as far as needed.

    A number, or one for each trial: median validation NLL of the members (nats), mean distance to the goal over all
    runs (u), or the share of successful runs.

    Raises:
        ConfigError: there are no models for it, or several trials are to fly, or a package is missing.
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


def _models(config: Config, store: Store) -> tuple[Path, Path]:
    """Complete exploration and training; returns their folders."""
    data = store.ensure(DATA.of(config), lambda attempt: make_data(config, attempt))
    return data, store.ensure(TRAIN.of(config), lambda attempt: make_models(config, data, attempt))
