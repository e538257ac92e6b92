"""The Hydra entry, and the commands around it.

`affmap` runs a setting or a sweep, `affmap-report` draws what it has produced, `affmap-paper` puts the reports of all
experiments together, `affmap-publish` keeps a report in `runs/reference`. All take Hydra overrides, and the same ones.
"""

import logging
import shutil
import sys
from collections.abc import Callable
from typing import NamedTuple

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from affmap import sweep
from affmap.config import Config, label, plain
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.report import provenance
from affmap.report.records import Job
from affmap.report.tables import Results
from affmap.settings import ConfigError, folder
from affmap.stages import check_models, find, run, stages
from affmap.store import PROVENANCE, without_places

log = logging.getLogger("affmap")

PAPER = ("exp1", "exp2", "exp3", "exp4", "exp5")
"""The experiments of the paper."""

_MULTIRUN = ("-m", "--multirun")

_HYDRA = {"--help", "-h", "--hydra-help", "--version", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc"}
"""Hydra's own flags that print something and run nothing."""


class Sweep(NamedTuple):
    """A command line whose sweep is written out, and the jobs that it stands for."""

    overrides: list[str]
    configs: list[Config]

    @property
    def first(self) -> Config:
        """What all jobs agree on, as far as reports are concerned."""
        return self.configs[0]

    def growth(self) -> "Sweep | None":
        """The experiment whose growing maps belong to this one, if there is one."""
        first = self.first
        if not first.growth:
            return None
        # A folder given for the output is for this experiment's report.
        growth = _sweep(sweep.instead(self.overrides, first.growth, {*first.sweep, "output", "growth"}))
        if growth.first.growth:
            raise ConfigError(
                f"growth = {first.growth!r} names an experiment that has a growth of its own; it must not."
            )
        return growth


def _sweep(arguments: list[str]) -> Sweep:
    overrides = sweep.complete(arguments)
    return Sweep(overrides, sweep.jobs(overrides))


class Found(NamedTuple):
    """What is complete of a sweep."""

    jobs: tuple[Job, ...]
    growth: Job | None
    missing: str
    """A sentence about what is not complete; empty if all is."""

    @property
    def results(self) -> Results:
        """All of it, for a report.

        Raises:
            ConfigError: settings differ in more than a report tells apart.
        """
        return Results(self.jobs, self.growth)


def _found(asked: Sweep) -> Found:
    """What is complete of a sweep.

    Raises:
        ConfigError: some settings are not complete, and no partial report is wanted; or none is complete.
    """
    growth = asked.growth()
    configs = [*asked.configs, *(growth.configs if growth else [])]
    found = [find(config) for config in configs]
    missing = [label(config) for config, job in zip(configs, found, strict=True) if job is None]
    said = f"{len(missing)} of {len(configs)} settings are not complete ({'; '.join(missing)})" if missing else ""
    jobs = tuple(job for job in found[: len(asked.configs)] if job)
    if missing and not (asked.first.report.partial and jobs):
        told = " ".join(asked.overrides)
        raise ConfigError(f"{said}; run `affmap {told}` first.")
    return Found(jobs, found[-1] if growth else None, said)


def _check_output(asked: Sweep) -> None:
    """A report is never replaced by one of other results.

    Raises:
        ConfigError: the output folder holds a report of other stages.
    """
    output, growth = asked.first.output, asked.growth()
    configs = [*asked.configs, *(growth.configs if growth else [])]
    path = output / PROVENANCE
    digests = {stage.digest for config in configs for stage in stages(config)}
    if path.is_file() and not provenance.digests(path) <= digests:
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


def _command(body: Callable[[Sweep], None]) -> None:
    """Read the command line, check every job of it, and run `body`; a mistake in it is told in a sentence."""
    try:
        if flags := _flags():
            raise ConfigError(f"{flags[0]} is not known here; give Hydra overrides, such as experiment=exp1.")
        body(_sweep([argument for argument in sys.argv[1:] if argument not in _MULTIRUN]))
    except (ConfigError, HydraException, OmegaConfBaseException) as error:
        print(error, file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """`affmap`: run what is not complete yet."""
    if _HYDRA & {flag.partition("=")[0] for flag in _flags()}:
        _job()
        return
    _command(_run_sweep)


def _run_sweep(asked: Sweep) -> None:
    if growth := asked.growth():
        _run_sweep(growth)
    overrides, configs = asked
    first = asked.first
    _check_output(asked)
    complete = sum(find(config) is not None for config in configs)
    print(f"{first.name}: {complete} of {len(configs)} settings are complete.", flush=True)
    if complete == len(configs):
        return
    for config in configs:
        check_models(config)
    given, sys.argv[1:] = sys.argv[1:], [*(["-m"] if sweep.is_sweep(overrides) else []), *overrides]
    _job()
    sys.argv[1:] = given
    print(f"{first.name}: all {len(configs)} settings are complete; affmap-report {' '.join(given)} draws them.")


def report() -> None:
    """`affmap-report`: draw the report of a complete sweep, or of what there is of it (`report.partial=true`)."""
    _command(_report)


def _report(asked: Sweep) -> None:
    from affmap.report import comparison, document

    first = asked.first
    found = _found(asked)
    notice = "; ".join(filter(None, [first.notice, found.missing and f"PARTIAL: {found.missing.partition(' (')[0]}"]))
    if first.report.compare:
        path = comparison.write(first.output, found.jobs, first.report.compare, notice or None)
        print(f"{path.read_text('utf-8')}\nThe table is {path}")
        return
    _check_output(asked)
    command = " ".join(["affmap", *without_places(asked.overrides)])
    path = document.write(
        first.output, found.results, first.report, title=first.title, command=command, notice=notice or None
    )
    print(f"The report is {path}")


def paper() -> None:
    """`affmap-paper`: one report of all five experiments, from their own reports."""
    _command(_paper)


def _paper(asked: Sweep) -> None:
    from affmap.report import paper

    parts = []
    for experiment in PAPER:
        part = _sweep(sweep.instead(asked.overrides, experiment, ("output",)))
        first = part.first
        try:
            found = _found(part)
        except ConfigError as error:
            raise ConfigError(f"{experiment}: {error}") from None
        parts.append(paper.Part(first.title, found.results, first.report, first.output, found.missing))
    first = asked.first
    output = first.output.with_name(first.output.name.replace(first.name, "paper"))
    command = " ".join(["affmap-paper", *without_places(asked.overrides)])
    print(f"The report is {paper.write(output, parts, command=command, notice=first.notice)}")


def publish() -> None:
    """`affmap-publish`: keep the report and the models of a sweep in `runs/reference`."""
    _command(_publish)


def _publish(asked: Sweep) -> None:
    from affmap.report import comparison, document

    first = asked.first
    found = _found(asked)
    if first.notice:
        raise ConfigError(f"this is not a result to keep: {first.notice}.")
    if first.report.compare:
        comparison.check(first.output, found.jobs, first.report.compare)
    else:
        document.check(first.output, found.results)
    kept = first.reference.parent / first.output.name
    new = kept.with_suffix(".new")
    shutil.rmtree(new, ignore_errors=True)
    # Vector figures are in the PDF, too, and all figures in the page.
    shutil.copytree(first.output, new, ignore=shutil.ignore_patterns("jobs", "*.pdf", "*.html"))
    for path in first.output.glob("*.pdf"):
        shutil.copy(path, new)
    shutil.rmtree(kept, ignore_errors=True)
    new.replace(kept)
    for job in found.jobs:
        _keep(job, first, [])
    if found.growth:
        _keep(found.growth, first, [SNAPSHOT.format(epoch="*")])
    print(f"Kept in {kept} and {first.reference}")


def _keep(job: Job, config: Config, also: list[str]) -> None:
    """Copy what is needed of a training into the reference run's store."""
    target = config.reference / "train" / job.train.name
    if job.train == target:  # the models were taken from there
        return
    target.mkdir(parents=True, exist_ok=True)
    for pattern in (WEIGHTS, "validation.csv", PROVENANCE, *also):
        for path in job.train.glob(pattern):
            shutil.copy(path, target)
