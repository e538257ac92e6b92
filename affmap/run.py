"""The Hydra entry: collect, train, paint maps, control; each stage is skipped when it is complete.

Commands (console scripts): `affmap` runs a setting or a sweep, `affmap-report` draws what a sweep has produced,
`affmap-publish` keeps it in `runs/reference`. All take Hydra overrides, and the same ones.
"""

import logging
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import hydra
import numpy as np
import torch
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from affmap import sweep
from affmap.config import Config, label, plain
from affmap.control.agent import Agent
from affmap.control.episodes import control
from affmap.data.collect import collect, coverage
from affmap.model.lookup import AffordanceMap, make_lookup
from affmap.model.stack import Stack
from affmap.progress import track
from affmap.report.tables import Job
from affmap.settings import ConfigError, folder
from affmap.store import PROVENANCE, Stage, Store

log = logging.getLogger("affmap")

DATASET = "dataset.npz"


def run(config: Config) -> Job:
    """Bring all stages of a job to completion; returns where they are."""
    _check_models(config)
    torch.set_num_threads(config.threads)
    store = config.open_store()
    data = store.ensure(config.data_stage, lambda folder: _collect(config, folder))
    train = store.ensure(config.train_stage, lambda folder: _train(config, data, folder))
    painted = store.ensure(config.map_stage, lambda folder: _paint(config, train, folder))
    controlled = store.ensure(config.control_stage, lambda folder: _control(config, train, folder))
    log.info("%s: complete", label(config))
    return Job(config.model.context_size, config.planner.kind, data, train, painted, controlled)


def _check_models(config: Config) -> None:
    if config.models == "reference" and config.open_store().find(config.train_stage) is None:
        raise ConfigError(
            f"{config.reference} holds no models of this configuration (stage train, {config.train_stage.digest}); "
            "train them with models=train, or undo the changes to them and to their data."
        )


def _collect(config: Config, folder: Path) -> None:
    with track(f"exploration of {config.layout.name}", config.data.num_sequences, "sequences") as update:
        arrays = collect(config.layout, config.vehicle, config.data, lambda sequence: update(sequence + 1))
    np.savez_compressed(folder / DATASET, allow_pickle=False, **arrays)
    covered = coverage(config.layout, config.vehicle, arrays["true_position"])
    np.savez_compressed(folder / "coverage.npz", allow_pickle=False, **covered)
    log.info("exploration of %s: %.1f %% of the free squares visited", config.layout.name, 100 * covered["coverage"])


def _train(config: Config, data: Path, folder: Path) -> None:
    from affmap.data.module import DataModule  # Lightning takes seconds to import
    from affmap.training.fit import fit

    batches = DataModule(data / DATASET, config.data, config.training.batch_size, config.training.chunk_length)
    description = f"training of {config.members} members, context size {config.model.context_size}"
    with track(description, config.training.num_epochs, "epochs") as update:
        fit(_stack(config), batches, config.training, folder, update)


def _paint(config: Config, train: Path, folder: Path) -> None:
    painted = AffordanceMap.paint(_trained(config, train), config.layout.map, config.report.map_spacing)
    rows, columns = painted.codes.shape[1:3]
    np.savez_compressed(
        folder / "maps.npz",
        allow_pickle=False,
        codes=painted.codes.numpy(),
        x=np.linspace(0, config.layout.size[0], columns),
        y=np.linspace(0, config.layout.size[1], rows),
        member=np.array(config.seeds),
    )


def _control(config: Config, train: Path, folder: Path) -> None:
    stack = _trained(config, train).to(config.control.device)
    agent = Agent(stack, make_lookup(config.lookup, stack, config.layout.map), config.planner, config.control)
    num_runs = config.members * config.control.runs_per_member
    with track(f"control, {label(config)}: {num_runs} runs", config.control.num_steps, "steps") as update:
        runs = control(agent, config.layout, config.vehicle, config.control, update)
    setting: dict[str, str | int] = {
        "layout": config.layout.name,
        "planner": config.planner.kind,
        "lookup": config.lookup.kind,
        "context_size": config.model.context_size,
    }
    for place, (key, value) in enumerate(setting.items()):
        runs.table.insert(place, key, value)
    runs.table.to_csv(folder / "runs.csv", index=False, float_format="%.6f")
    np.savez_compressed(folder / "trajectories.npz", allow_pickle=False, **runs.trajectories)


def _stack(config: Config) -> Stack:
    return Stack(config.model, len(config.layout.channels), config.seeds)


def _trained(config: Config, train: Path) -> Stack:
    from affmap.training.fit import WEIGHTS, restore

    return restore(_stack(config), train / WEIGHTS)


# What follows turns command lines into the above.


def _stages(config: Config) -> tuple[Stage, ...]:
    return config.data_stage, config.train_stage, config.map_stage, config.control_stage


def _find(config: Config) -> Job | None:
    """Where the stages of a job are, or None if one is not complete."""
    store: Store = config.open_store()
    folders = [found for stage in _stages(config) if (found := store.find(stage))]
    return Job(config.model.context_size, config.planner.kind, *folders) if len(folders) == 4 else None


@hydra.main(version_base="1.3", config_path=str(folder()), config_name="config")
def _job(composed: DictConfig) -> None:
    try:
        run(Config.checked(plain(composed), "the configuration"))
    except Exception:
        log.exception("This job failed; the same command goes on where it stopped.")
        raise


def _command(body: Callable[[list[str], list[Config]], None]) -> None:
    """Read the command line, check every job of it, and run `body`; a mistake in it is told in a sentence."""
    try:
        overrides = sweep.complete([argument for argument in sys.argv[1:] if not argument.startswith("-")])
        body(overrides, sweep.jobs(overrides))
    except (ConfigError, HydraException, OmegaConfBaseException) as error:
        print(error, file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """`affmap`: run what is not complete yet."""
    if any(argument.startswith("-") and argument not in ("-m", "--multirun") for argument in sys.argv[1:]):
        _job()  # Hydra's own flags, such as --help and --cfg
        return
    _command(_run_sweep)


def _run_sweep(overrides: list[str], configs: list[Config]) -> None:
    if all(_find(config) for config in configs):
        print(f"{configs[0].name}: all {len(configs)} settings are complete.")
        return
    for config in configs:
        _check_models(config)
    sys.argv[1:] = [*(["-m"] if sweep.is_sweep(overrides) else []), *overrides]
    _job()


def report() -> None:
    """`affmap-report`: draw the report of a complete sweep."""
    _command(_report)


def _report(overrides: list[str], configs: list[Config]) -> None:
    from affmap.report import comparison, document

    first = configs[0]
    jobs = _found(configs)
    if first.report.compare:
        path = comparison.write(first.output, jobs, first.report.compare)
        print(f"{path.read_text('utf-8')}\nThe table is {path}")
        return
    command = " ".join(["affmap", *overrides])
    path = document.write(first.output, jobs, title=first.title, command=command, notice=first.notice)
    print(f"The report is {path}")


def _found(configs: list[Config]) -> list[Job]:
    """Where the stages of all jobs are.

    Raises:
        ConfigError: some are not complete.
    """
    found = [_find(config) for config in configs]
    if missing := [label(config) for config, job in zip(configs, found, strict=True) if job is None]:
        raise ConfigError(
            f"{len(missing)} of {len(configs)} settings are not complete ({'; '.join(missing)}); "
            "run `affmap` with the same arguments first."
        )
    return [job for job in found if job]


def publish() -> None:
    """`affmap-publish`: keep the report and the models of a complete sweep in `runs/reference`."""
    _command(_publish)


def _publish(_: list[str], configs: list[Config]) -> None:
    first = configs[0]
    jobs = _found(configs)
    if not (first.output / "tables").is_dir():
        raise ConfigError(f"{first.output} holds no report; run `affmap-report` with the same arguments first.")
    kept = first.reference.parent / first.output.name
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(first.output, kept, ignore=shutil.ignore_patterns("jobs", "figures"))
    for figure in (first.output / "figures").glob("*.png"):
        (kept / "figures").mkdir(exist_ok=True)
        shutil.copy(figure, kept / "figures")
    for trained in {job.train for job in jobs}:
        target = first.reference / "train" / trained.name
        target.mkdir(parents=True, exist_ok=True)
        for name in ("weights.safetensors", "validation.csv", PROVENANCE):
            if trained != target:
                shutil.copy(trained / name, target)
    print(f"Kept in {kept} and {first.reference}")
