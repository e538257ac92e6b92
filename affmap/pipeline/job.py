"""The stages of a job, in order; each is skipped where it is complete. Knows no command lines."""

import logging
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch

from affmap import compiled
from affmap.config.root import Config, label
from affmap.pipeline.collect import DATA, make_data
from affmap.pipeline.control import CONTROL, make_runs
from affmap.pipeline.paint import MAP, make_maps
from affmap.pipeline.train import TRAIN, make_models
from affmap.results import files
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, STAGES, Setting, Value
from affmap.settings.messages import ConfigError
from affmap.store.provenance import canonical
from affmap.store.stage import Stage
from affmap.store.store import Store

log = logging.getLogger("affmap")


def stages(config: Config) -> tuple[Stage, ...]:
    """The stages of a job, in their order."""
    return DATA.of(config), TRAIN.of(config), MAP.of(config), CONTROL.of(config)


def open_store(config: Config) -> Store:
    """Where the stages of a job are."""
    return Store(config.store, [config.reference] if config.models == "reference" else [], config.versions == "any")


def is_complete(config: Config) -> bool:
    """Whether all stages of a job are complete; their files are not looked at."""
    store = open_store(config)
    return all(store.has(stage) for stage in stages(config))


def find(config: Config, values: Mapping[str, Value] = MappingProxyType({})) -> Setting | None:
    """The stages of a job as a setting, or None if one is not complete.

    Args:
        config: of the job.
        values: those of the keys that its sweep varies, beside context size, planner and layout.

    Raises:
        StoreError: a file is damaged, or other versions of packages have made a stage.
    """
    store = open_store(config)
    folders = [store.find(stage) for stage in stages(config)]
    complete = [folder for folder in folders if folder]
    return _setting(config, complete, values) if len(complete) == len(folders) else None


def _setting(config: Config, folders: Sequence[Path], values: Mapping[str, Value] = MappingProxyType({})) -> Setting:
    always: dict[str, Value] = {
        CONTEXT_SIZE.key: config.model.context_size,
        PLANNER.key: config.controller,
        LAYOUT.key: config.control_layout.name,
    }
    return Setting({**always, **values}, {name: (folder,) for name, folder in zip(STAGES, folders, strict=True)})


def run(config: Config) -> Setting:
    """Bring all stages of a job to completion; returns them as a setting.

    Raises:
        ConfigError: there are no models for it, or models of several trials; or a package is missing.
    """
    check_models(config)
    check_trials(config)
    check_logger(config)
    store = open_store(config)
    data, train = _models(config, store)
    painted = store.ensure(MAP.of(config), lambda attempt: make_maps(config, train, attempt))
    controlled = store.ensure(CONTROL.of(config), lambda attempt: make_runs(config, train, attempt))
    log.info("%s: complete", label(config))
    return _setting(config, (data, train, painted, controlled))


def validation(config: Config) -> np.ndarray:
    """Bring a training to completion, without maps and control; returns the validation NLL at its end.

    `[R]`, one for each trial (a single one without trials), nats: medians over members, because single members have
    single epochs that stand out; NaN where a member is lost.

    Raises:
        ConfigError: there are no models for it; or a package is missing.
    """
    check_models(config)
    check_logger(config)
    _, train = _models(config, open_store(config))
    table = files.read_validation(train).query(f"epoch == {config.training.num_epochs}")
    losses = table["validation_nll"].to_numpy().reshape(-1, config.members)
    return np.median(losses, axis=1)


def score(config: Config) -> float | list[float]:
    """What a search is for (`objective`), of a job that is brought to completion as far as that needs.

    A number, or one for each trial: median validation NLL of the members (nats), mean distance to the goal over all
    runs (u), or the share of successful runs.

    Raises:
        ConfigError: there are no models for it; or trials fly; or a package is missing.
    """
    if config.objective == "validation_nll":
        values = validation(config)
        return values.tolist() if config.training.num_trials else float(values[0])
    objective, (folder,) = str(config.objective), run(config).control
    return float(files.read_runs(folder, [objective])[objective].mean())


def _models(config: Config, store: Store) -> tuple[Path, Path]:
    """Bring exploration and training to completion; returns where they are."""
    torch.set_num_threads(config.threads)
    compiled.use(config.compiled)
    data = store.ensure(DATA.of(config), lambda attempt: make_data(config, attempt))
    return data, store.ensure(TRAIN.of(config), lambda attempt: make_models(config, data, attempt))


def check_trials(config: Config) -> None:
    """Make sure that a job's maps and agents are to be of one training.

    Raises:
        ConfigError: they are to be of several trials.
    """
    if config.training.num_trials is not None:
        key, values = next(iter(config.training.per_trial.items()))
        raise ConfigError(
            f"training.{key} = {list(values)} makes a training of {len(values)} trials, which is validated only; "
            "give numbers to paint maps and fly agents."
        )


def check_models(config: Config) -> None:
    """Make sure that the reference run has the models that a job wants of it.

    Raises:
        ConfigError: it has not.
    """
    stage = TRAIN.of(config)
    if config.models == "reference" and not Store(config.reference).has(stage):
        raise ConfigError(
            f"{config.reference} holds no models of this configuration (stage train, {stage.digest}); "
            "train them with models=train, or undo the changes to them and to their data."
        )


def check_logger(config: Config) -> None:
    """Make sure that what logs trainings is installed.

    Raises:
        ConfigError: it is not.
    """
    if config.logger == "tensorboard" and not find_spec("tensorboard"):
        raise ConfigError(
            "logger = 'tensorboard' needs a package that is not installed: pip install 'affmap[tensorboard]', or say "
            "logger=csv."
        )


def check_members(configs: Sequence[Config]) -> None:
    """Refuse a member in two jobs of one setting: tables count each once.

    Raises:
        ConfigError: there is one.
    """
    jobs: dict[str, list[range]] = {}
    for config in configs:
        parts = [definition.of(config).config for definition in (MAP, CONTROL)]
        rest = [{key: value for key, value in part.items() if key not in ("seed", "members")} for part in parts]
        jobs.setdefault(canonical(rest), []).append(config.seeds)
    for seeds in jobs.values():
        for one, other in pairwise(sorted(seeds, key=attrgetter("start"))):
            if other.start < one.stop:
                raise ConfigError(
                    f"member {other.start} would be in two jobs (seed={one.start} members={len(one)} and "
                    f"seed={other.start} members={len(other)}); give each member to one, as members=5 seed=0,5,10 does."
                )
