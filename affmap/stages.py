"""The stages of a job: collect, train, paint maps, control; each is skipped when it is complete.

Puts the package's parts together; knows no command lines.
"""

import json
import logging
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import repeat
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from affmap.config import Config, label
from affmap.control.agent import Agent
from affmap.control.episodes import control
from affmap.data.collect import collect, coverage
from affmap.env.crossing import crossable
from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap, ExactLookup, Lookup, lookup_error, make_lookup
from affmap.model.stack import Stack
from affmap.model.weights import SNAPSHOT, WEIGHTS, restore
from affmap.progress import track
from affmap.random import generator
from affmap.report.records import Job
from affmap.report.tables import LAYOUTS
from affmap.settings import ConfigError
from affmap.stage import Stage
from affmap.store import Store
from affmap.training.settings import VALIDATION
from affmap.work import Work

log = logging.getLogger("affmap")

DATASET = "dataset.npz"


def stages(config: Config) -> tuple[Stage, ...]:
    """The stages of a job, in their order."""
    return config.data_stage, config.train_stage, config.map_stage, config.control_stage


def is_complete(config: Config) -> bool:
    """Whether all stages of a job are complete; their files are not looked at."""
    store = config.open_store()
    return all(store.has(stage) for stage in stages(config))


def find(config: Config) -> Job | None:
    """Where the stages of a job are, or None if one is not complete.

    Raises:
        StoreError: a file is damaged, or other versions of packages have made a stage.
    """
    store = config.open_store()
    folders = [store.find(stage) for stage in stages(config)]
    complete = [folder for folder in folders if folder]
    return _job(config, *complete) if len(complete) == len(folders) else None


def _job(config: Config, *folders: Path) -> Job:
    each = [(folder,) for folder in folders]
    return Job(config.model.context_size, config.planner.kind, config.control_layout.name, *each)


def run(config: Config) -> Job:
    """Bring all stages of a job to completion; returns where they are.

    Raises:
        ConfigError: there are no models for it, or models of several trials; or a package is missing.
    """
    check_models(config)
    check_trials(config)
    check_logger(config)
    store = config.open_store()
    data, train = _models(config, store)
    painted = store.ensure(config.map_stage, lambda work: _paint(config, train, work))
    controlled = store.ensure(config.control_stage, lambda work: _control(config, train, work))
    log.info("%s: complete", label(config))
    return _job(config, data, train, painted, controlled)


def validation(config: Config) -> np.ndarray:
    """Bring a training to completion, without maps and control; returns the validation NLL at its end.

    `[R]`, one for each trial (a single one without trials), nats: medians over members, because single members have
    single epochs that stand out; NaN where a member is lost.

    Raises:
        ConfigError: there are no models for it; or a package is missing.
    """
    check_models(config)
    check_logger(config)
    _, train = _models(config, config.open_store())
    table = pd.read_csv(train / VALIDATION).query(f"epoch == {config.training.num_epochs}")
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
    runs = pd.read_csv(run(config).control[0] / "runs.csv")
    return float(runs[config.objective].mean())


def _models(config: Config, store: Store) -> tuple[Path, Path]:
    """Bring exploration and training to completion; returns where they are."""
    torch.set_num_threads(config.threads)
    data = store.ensure(config.data_stage, lambda work: _collect(config, work))
    return data, store.ensure(config.train_stage, lambda work: _train(config, data, work))


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
    if config.models == "reference" and not Store(config.reference).has(config.train_stage):
        raise ConfigError(
            f"{config.reference} holds no models of this configuration (stage train, {config.train_stage.digest}); "
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


def _collect(config: Config, work: Work) -> None:
    layouts, num_sequences = config.training_layouts, config.data.num_sequences
    names = ", ".join(layout.name for layout in layouts)
    with track(f"exploration of {names}", len(layouts) * num_sequences, "sequences", work.progress) as update:
        arrays = collect(layouts, config.vehicle, config.data, lambda sequence: update(sequence + 1))
    np.savez_compressed(work.folder / DATASET, allow_pickle=False, **arrays)
    parts = arrays["true_position"].reshape(len(layouts), num_sequences, -1, 2)
    covered = [coverage(layout, config.vehicle, part) for layout, part in zip(layouts, parts, strict=True)]
    stacked = {key: np.stack([part[key] for part in covered]) for key in covered[0]}
    np.savez_compressed(work.folder / "coverage.npz", allow_pickle=False, **stacked)
    share = 100 * stacked["coverage"].min()
    log.info("exploration of %s: %.1f %% of the free squares visited, or more", names, share)


def _train(config: Config, data: Path, work: Work) -> None:
    from affmap.data.module import DataModule  # Lightning takes seconds to import
    from affmap.training.fit import fit

    batches = DataModule(data / DATASET, config.data, config.training.batch_size, config.training.chunk_length)
    num_trials = config.training.num_trials
    trials = f"{num_trials} trials of " if num_trials else ""
    description = f"training of {trials}{config.members} members, context size {config.model.context_size}"
    with track(description, config.training.num_epochs, "epochs", work.progress) as update:
        fit(_stack(config), batches, config.training, work.folder, work.scratch, update, _board(config))


def _board(config: Config) -> Path | None:
    """Where TensorBoard finds a job's training, which other jobs may share."""
    if config.logger != "tensorboard":
        return None
    return config.output / "tensorboard" / f"context{config.model.context_size}_{config.train_stage.digest}"


def _paint(config: Config, train: Path, work: Work) -> None:
    snapshots = sorted(train.glob(SNAPSHOT.format(epoch="*"))) if config.report.snapshots else []
    codes = _codes(config, _trained(config, train))
    _, rows, columns, _ = codes.shape
    width, height = config.map_layout.size
    np.savez_compressed(
        work.folder / "maps.npz",
        allow_pickle=False,
        codes=codes,
        initial_codes=_codes(config, _stack(config)),
        snapshot_codes=np.array([_codes(config, restore(_stack(config), path)) for path in snapshots]),
        epochs=np.array([int(path.stem.rpartition("-")[2]) for path in snapshots], int),
        x=np.linspace(0, width, columns),
        y=np.linspace(0, height, rows),
        member=np.array(config.seeds),
    )


def _codes(config: Config, stack: Stack) -> np.ndarray:
    """The codes of all members at the nodes of the map's world, `[M, Y, X, C]`."""
    return AffordanceMap.paint(stack, [config.map_layout.map], config.report.map_spacing).codes.numpy()


def _control(config: Config, train: Path, work: Work) -> None:
    stack = _trained(config, train).to(config.control.device)
    layouts = _layouts(config)
    lookup = make_lookup(config.lookup, stack, [layout.map for layout in layouts])
    agent = Agent(stack, lookup, config.planner, config.control)
    num_runs = config.members * config.control.runs_per_member
    with track(
        f"control, {label(config)}: {num_runs} runs", config.control.num_steps, "steps", work.progress
    ) as update:
        runs = control(agent, layouts, config.vehicle, config.control, update)
    setting: dict[str, str | int | float] = {
        "layout": config.control_layout.name,
        "planner": config.planner.kind,
        "lookup_spacing": config.lookup.spacing,
        "context_size": config.model.context_size,
    }
    for place, (key, value) in enumerate(setting.items()):
        runs.table.insert(place, key, value)
    flown = layouts * num_runs if len(layouts) == 1 else layouts
    starts, goals = runs.trajectories["position"][:, 0], runs.trajectories["goal"]
    runs.table["crossable"] = [crossable(*run) for run in zip(flown, repeat(config.vehicle), starts, goals)]
    runs.table["lookup_error"] = _lookup_error(config, stack, lookup, layouts, runs.trajectories["position"])
    runs.table.to_csv(work.folder / "runs.csv", index=False, float_format="%.6f")
    np.savez_compressed(work.folder / "trajectories.npz", allow_pickle=False, **runs.trajectories)
    (work.folder / LAYOUTS).write_text(json.dumps([layout.model_dump(mode="json") for layout in flown]), "utf-8")


def _layouts(config: Config) -> list[Layout]:
    """The world that all agents fly in, or the worlds of each (member-major), which all settings share."""
    layout = config.control_layout
    if isinstance(layout, Layout):
        return [layout]
    runs = range(config.control.runs_per_member)
    return [layout.draw(generator(seed, "world", run)) for seed in config.seeds for run in runs]


def _lookup_error(
    config: Config, stack: Stack, lookup: Lookup, layouts: Sequence[Layout], positions: np.ndarray
) -> np.ndarray:
    """Mean error of context codes along paths `[B, T + 1, 2]` (u): `[B]`."""
    if config.lookup.spacing == 0 or stack.context_size == 0:
        return np.zeros(len(positions))
    exact = ExactLookup(stack, [layout.map for layout in layouts])
    visited = torch.from_numpy(positions).to(config.control.device).unflatten(0, (config.members, -1))
    errors = [lookup_error(lookup, exact, now) for now in visited.unbind(2)]  # a step at a time bounds the memory
    return torch.stack(errors).mean(0).flatten().cpu().numpy()


def _stack(config: Config) -> Stack:
    """Untrained; with R trials of R x M members, trial by trial, so that all trials have the same initial weights."""
    return Stack(config.model, len(config.channels), (config.training.num_trials or 1) * tuple(config.seeds))


def _trained(config: Config, train: Path) -> Stack:
    return restore(_stack(config), train / WEIGHTS)
