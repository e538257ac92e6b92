"""The Hydra entry, and the commands around it.

`affmap` runs a setting or a sweep, `affmap-report` draws what it has produced, `affmap-publish` keeps that in
`runs/reference`. All take Hydra overrides, and the same ones.
"""

import json
import logging
import shutil
import sys
from collections.abc import Callable

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from affmap import sweep
from affmap.config import Config, label, plain
from affmap.report.tables import Job
from affmap.settings import ConfigError, folder
from affmap.stages import check_models, find, run, stages
from affmap.store import PROVENANCE

log = logging.getLogger("affmap")

_MULTIRUN = ("-m", "--multirun")


def _found(configs: list[Config]) -> list[Job]:
    """Where the stages of all jobs are.

    Raises:
        ConfigError: some are not complete.
    """
    found = [find(config) for config in configs]
    if missing := [label(config) for config, job in zip(configs, found, strict=True) if job is None]:
        raise ConfigError(
            f"{len(missing)} of {len(configs)} settings are not complete ({'; '.join(missing)}); "
            "run `affmap` with the same arguments first."
        )
    return [job for job in found if job]


def _check_output(configs: list[Config]) -> None:
    """A report is never replaced by one of other results.

    Raises:
        ConfigError: the output folder holds a report of other stages.
    """
    output = configs[0].output
    path = output / PROVENANCE
    digests = {stage.digest for config in configs for stage in stages(config)}
    if path.is_file() and {stage["digest"] for stage in json.loads(path.read_text("utf-8"))["stages"]} != digests:
        raise ConfigError(f"{output} holds the report of other results; say output=runs/<name>, or remove that folder.")


@hydra.main(version_base="1.3", config_path=str(folder()), config_name="config")
def _job(composed: DictConfig) -> None:
    try:
        run(Config.checked(plain(composed), "the configuration"))
    except Exception:
        log.exception("This job failed; the same command goes on where it stopped.")
        raise


def _flags() -> list[str]:
    """The flags of the command line, except the one for sweeps, which is set where it is needed."""
    return [argument for argument in sys.argv[1:] if argument.startswith("-") and argument not in _MULTIRUN]


def _command(body: Callable[[list[str], list[Config]], None]) -> None:
    """Read the command line, check every job of it, and run `body`; a mistake in it is told in a sentence."""
    try:
        if flags := _flags():
            raise ConfigError(f"{flags[0]} is not known here; give Hydra overrides, such as experiment=exp1.")
        overrides = sweep.complete([argument for argument in sys.argv[1:] if argument not in _MULTIRUN])
        body(overrides, sweep.jobs(overrides))
    except (ConfigError, HydraException, OmegaConfBaseException) as error:
        print(error, file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """`affmap`: run what is not complete yet."""
    if _flags():
        _job()  # Hydra's own flags, such as --help and --cfg
        return
    _command(_run_sweep)


def _run_sweep(overrides: list[str], configs: list[Config]) -> None:
    first = configs[0]
    _check_output(configs)
    complete = sum(find(config) is not None for config in configs)
    print(f"{first.name}: {complete} of {len(configs)} settings are complete.", flush=True)
    if complete == len(configs):
        return
    for config in configs:
        check_models(config)
    arguments = sys.argv[1:]
    sys.argv[1:] = [*(["-m"] if sweep.is_sweep(overrides) else []), *overrides]
    _job()
    print(f"{first.name}: all {len(configs)} settings are complete; affmap-report {' '.join(arguments)} draws them.")


def report() -> None:
    """`affmap-report`: draw the report of a complete sweep."""
    _command(_report)


def _report(overrides: list[str], configs: list[Config]) -> None:
    from affmap.report import comparison, document

    first = configs[0]
    jobs = _found(configs)
    if first.report.compare:
        path = comparison.write(first.output, jobs, first.report.compare, first.notice)
        print(f"{path.read_text('utf-8')}\nThe table is {path}")
        return
    if len({(job.context_size, job.planner) for job in jobs}) < len(jobs):
        raise ConfigError("a report tells settings apart by context size and planner; here others differ, too.")
    _check_output(configs)
    command = " ".join(["affmap", *overrides])
    path = document.write(first.output, jobs, title=first.title, command=command, notice=first.notice)
    print(f"The report is {path}")


def publish() -> None:
    """`affmap-publish`: keep the report and the models of a complete sweep in `runs/reference`."""
    _command(_publish)


def _publish(_: list[str], configs: list[Config]) -> None:
    first = configs[0]
    jobs = _found(configs)
    if first.notice:
        raise ConfigError(f"this is not a result to keep: {first.notice}.")
    if not (first.output / "tables").is_dir():
        raise ConfigError(f"{first.output} holds no report; run `affmap-report` with the same arguments first.")
    kept = first.reference.parent / first.output.name
    new = kept.with_suffix(".new")
    shutil.rmtree(new, ignore_errors=True)
    # Vector figures are in the report, too.
    shutil.copytree(first.output, new, ignore=shutil.ignore_patterns("jobs", "*.pdf"))
    for document in first.output.glob("*.pdf"):
        shutil.copy(document, new)
    shutil.rmtree(kept, ignore_errors=True)
    new.replace(kept)
    for trained in {job.train for job in jobs}:
        target = first.reference / "train" / trained.name
        if trained == target:  # the models were taken from there
            continue
        target.mkdir(parents=True, exist_ok=True)
        for name in ("weights.safetensors", "validation.csv", PROVENANCE):
            shutil.copy(trained / name, target)
    print(f"Kept in {kept} and {first.reference}")
