"""The stages of a job: collect, train, paint maps, control; each is skipped when it is complete.

Puts the package's parts together; knows no command lines.
"""

import logging
from pathlib import Path

import numpy as np
import torch

from affmap.config import Config, label
from affmap.control.agent import Agent
from affmap.control.episodes import control
from affmap.data.collect import collect, coverage
from affmap.model.lookup import AffordanceMap, ExactLookup, Lookup, lookup_error, make_lookup
from affmap.model.stack import Stack
from affmap.progress import track
from affmap.report.tables import Job
from affmap.settings import ConfigError
from affmap.store import Stage, Store

log = logging.getLogger("affmap")

DATASET = "dataset.npz"


def stages(config: Config) -> tuple[Stage, ...]:
    """The stages of a job, in their order."""
    return config.data_stage, config.train_stage, config.map_stage, config.control_stage


def find(config: Config) -> Job | None:
    """Where the stages of a job are, or None if one is not complete."""
    store = config.open_store()
    folders = [store.find(stage) for stage in stages(config)]
    complete = [folder for folder in folders if folder]
    return Job(config.model.context_size, config.planner.kind, *complete) if len(complete) == len(folders) else None


def run(config: Config) -> Job:
    """Bring all stages of a job to completion; returns where they are."""
    check_models(config)
    torch.set_num_threads(config.threads)
    store = config.open_store()
    data = store.ensure(config.data_stage, lambda folder: _collect(config, folder))
    train = store.ensure(config.train_stage, lambda folder: _train(config, data, folder))
    painted = store.ensure(config.map_stage, lambda folder: _paint(config, train, folder))
    controlled = store.ensure(config.control_stage, lambda folder: _control(config, train, folder))
    log.info("%s: complete", label(config))
    return Job(config.model.context_size, config.planner.kind, data, train, painted, controlled)


def check_models(config: Config) -> None:
    """Make sure that the reference run has the models that a job wants of it.

    Raises:
        ConfigError: it has not.
    """
    if config.models == "reference" and Store(config.reference).find(config.train_stage) is None:
        raise ConfigError(
            f"{config.reference} holds no models of this configuration (stage train, {config.train_stage.digest}); "
            "train them with models=train, or undo the changes to them and to their data."
        )


def _collect(config: Config, folder: Path) -> None:
    layouts, num_sequences = config.training_layouts, config.data.num_sequences
    names = ", ".join(layout.name for layout in layouts)
    with track(f"exploration of {names}", len(layouts) * num_sequences, "sequences") as update:
        arrays = collect(layouts, config.vehicle, config.data, lambda sequence: update(sequence + 1))
    np.savez_compressed(folder / DATASET, allow_pickle=False, **arrays)
    parts = arrays["true_position"].reshape(len(layouts), num_sequences, -1, 2)
    covered = [coverage(layout, config.vehicle, part) for layout, part in zip(layouts, parts, strict=True)]
    stacked = {key: np.stack([part[key] for part in covered]) for key in covered[0]}
    np.savez_compressed(folder / "coverage.npz", allow_pickle=False, **stacked)
    share = 100 * stacked["coverage"].min()
    log.info("exploration of %s: %.1f %% of the free squares visited, or more", names, share)


def _train(config: Config, data: Path, folder: Path) -> None:
    from affmap.data.module import DataModule  # Lightning takes seconds to import
    from affmap.training.fit import fit

    batches = DataModule(data / DATASET, config.data, config.training.batch_size, config.training.chunk_length)
    description = f"training of {config.members} members, context size {config.model.context_size}"
    with track(description, config.training.num_epochs, "epochs") as update:
        fit(_stack(config), batches, config.training, folder, update)


def _paint(config: Config, train: Path, folder: Path) -> None:
    world, spacing = config.map_layout.map, config.report.map_spacing
    codes = AffordanceMap.paint(_trained(config, train), world, spacing).codes
    rows, columns = codes.shape[1:3]
    np.savez_compressed(
        folder / "maps.npz",
        allow_pickle=False,
        codes=codes.numpy(),
        initial_codes=AffordanceMap.paint(_stack(config), world, spacing).codes.numpy(),
        x=np.linspace(0, world.size[0], columns),
        y=np.linspace(0, world.size[1], rows),
        member=np.array(config.seeds),
    )


def _control(config: Config, train: Path, folder: Path) -> None:
    stack = _trained(config, train).to(config.control.device)
    lookup = make_lookup(config.lookup, stack, config.control_layout.map)
    agent = Agent(stack, lookup, config.planner, config.control)
    num_runs = config.members * config.control.runs_per_member
    with track(f"control, {label(config)}: {num_runs} runs", config.control.num_steps, "steps") as update:
        runs = control(agent, config.control_layout, config.vehicle, config.control, update)
    setting: dict[str, str | int | float] = {
        "layout": config.control_layout.name,
        "planner": config.planner.kind,
        "lookup_spacing": config.lookup.spacing,
        "context_size": config.model.context_size,
    }
    for place, (key, value) in enumerate(setting.items()):
        runs.table.insert(place, key, value)
    runs.table["lookup_error"] = _lookup_error(config, stack, lookup, runs.trajectories["position"])
    runs.table.to_csv(folder / "runs.csv", index=False, float_format="%.6f")
    np.savez_compressed(folder / "trajectories.npz", allow_pickle=False, **runs.trajectories)


def _lookup_error(config: Config, stack: Stack, lookup: Lookup, positions: np.ndarray) -> np.ndarray:
    """Mean error of context codes along paths `[B, T + 1, 2]` (u): `[B]`."""
    if config.lookup.spacing == 0 or stack.context_size == 0:
        return np.zeros(len(positions))
    exact = ExactLookup(stack, config.control_layout.map)
    visited = torch.from_numpy(positions).to(config.control.device).unflatten(0, (config.members, -1))
    errors = [lookup_error(lookup, exact, now) for now in visited.unbind(2)]  # a step at a time bounds the memory
    return torch.stack(errors).mean(0).flatten().cpu().numpy()


def _stack(config: Config) -> Stack:
    return Stack(config.model, len(config.channels), config.seeds)


def _trained(config: Config, train: Path) -> Stack:
    from affmap.training.fit import WEIGHTS, restore

    return restore(_stack(config), train / WEIGHTS)
