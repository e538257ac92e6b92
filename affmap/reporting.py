"""The commands around reports; all take the overrides of the sweep that they are about.

`affmap-report` draws the report of a sweep, `affmap-paper` puts those of all experiments together, `affmap-publish`
keeps one in `runs/reference`.
"""

import shutil
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from affmap import sweep
from affmap.command import command
from affmap.config import Config
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.provenance import PROVENANCE, without_places
from affmap.report import provenance
from affmap.report.records import Job
from affmap.report.tables import Results, join
from affmap.search import RESULTS, Search
from affmap.settings import ConfigError
from affmap.stages import find, stages
from affmap.store import copy_stage
from affmap.sweep import Sweep
from affmap.training.settings import VALIDATION

PAPER = ("exp1", "exp2", "exp3", "exp4", "exp5")
"""The experiments of the paper."""


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
        StoreError: a file is damaged.
    """
    growth = asked.growth()
    jobs = [find(config) for config in asked.configs]
    grown = find(growth.first) if growth else None
    missing = [label for label, job in zip(asked.labels, jobs, strict=True) if job is None]
    if growth and grown is None:
        missing.append(growth.first.name)
    count = len(jobs) + (growth is not None)
    said = f"{len(missing)} of {count} settings are not complete ({'; '.join(missing)})" if missing else ""
    complete = [job for job in jobs if job]
    if missing and not (asked.first.report.partial and complete):
        told = " ".join(asked.overrides)
        raise ConfigError(f"{said}; run `affmap {told}` first.")
    return Found(join(complete), grown, said)


def digests(asked: Sweep) -> set[str]:
    """Of all stages of a sweep."""
    growth = asked.growth()
    return {stage.digest for each in (asked, growth) if each for config in each.configs for stage in stages(config)}


def check_output(output: Path, stages: Collection[str]) -> None:
    """A report is never replaced by one of other results.

    Args:
        output: the report's folder.
        stages: digests of those that the report is to be made of.

    Raises:
        ConfigError: the folder holds a report of others.
    """
    path = output / PROVENANCE
    if path.is_file() and not provenance.digests(path) <= set(stages):
        raise ConfigError(f"{output} holds the report of other results; say output=runs/<name>, or remove that folder.")


def report() -> None:
    """`affmap-report`: draw the report of a complete sweep, or of what there is of it (`report.partial=true`)."""
    command(_report_any)


def _report_any(arguments: list[str]) -> None:
    if search := Search.read(arguments):
        _report_search(search)
    else:
        _report(Sweep.read(arguments))


def _report_search(search: Search) -> None:
    from affmap.report import searches

    config = search.config
    check_output(config.output, ())
    path = searches.write(
        config.output,
        search.folder / RESULTS,
        config.objective or "",
        in_use=provenance.leaves(config.model_dump(mode="json")),
        log_keys=search.log_keys,
        title=config.title,
        command=" ".join(["affmap", *without_places(search.overrides)]),
        notice=config.notice,
    )
    print(f"{path.read_text('utf-8')}\nThe table is {path}")


def _report(asked: Sweep) -> None:
    from affmap.report import comparison, document

    first = asked.first
    found = _found(asked)
    notice = "; ".join(filter(None, [first.notice, found.missing and f"PARTIAL: {found.missing.partition(' (')[0]}"]))
    if first.report.compare:
        path = comparison.write(first.output, found.jobs, first.report.compare, notice or None)
        print(f"{path.read_text('utf-8')}\nThe table is {path}")
        return
    check_output(first.output, digests(asked))
    command = " ".join(["affmap", *without_places(asked.overrides)])
    path = document.write(
        first.output, found.results, first.report, title=first.title, command=command, notice=notice or None
    )
    print(f"The report is {path}")


def paper() -> None:
    """`affmap-paper`: one report of all five experiments, from their own reports."""
    command(lambda arguments: _paper(Sweep.read(arguments)))


def _paper(asked: Sweep) -> None:
    from affmap.report import paper

    parts = []
    for experiment in PAPER:
        part = Sweep.read(sweep.instead(asked.overrides, experiment, ("output",)))
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
    """`affmap-publish`: keep the report and the models of a sweep, or the report of a search, in `runs/reference`."""
    command(_publish_any)


def _publish_any(arguments: list[str]) -> None:
    if search := Search.read(arguments):
        _publish_search(search)
    else:
        _publish(Sweep.read(arguments))


def _publish_search(search: Search) -> None:
    from affmap.report import searches

    config = search.config
    _check_publishable(config)
    if not searches.is_written(config.output, search.folder / RESULTS):
        raise ConfigError(f"{config.output} holds no report of these trials; run affmap-report for them first.")
    print(f"Kept in {_keep_report(config, config.reference.parent / 'tune' / config.output.name)}")


def _check_publishable(config: Config) -> None:
    if config.notice:
        raise ConfigError(f"this is not a result to keep: {config.notice}.")


def _keep_report(config: Config, kept: Path) -> Path:
    """Copy the report of a sweep or a search to a place, in the stead of what is there."""
    new = kept.with_suffix(".new")
    shutil.rmtree(new, ignore_errors=True)
    # Vector figures are in the PDF, too, and all figures in the page.
    shutil.copytree(config.output, new, ignore=shutil.ignore_patterns("jobs", "*.pdf", "*.html"))
    for path in config.output.glob("*.pdf"):
        shutil.copy(path, new)
    shutil.rmtree(kept, ignore_errors=True)
    new.replace(kept)
    return kept


def _publish(asked: Sweep) -> None:
    from affmap.report import comparison, document

    first = asked.first
    found = _found(asked)
    _check_publishable(first)
    if first.report.compare:
        comparison.check(first.output, found.jobs, first.report.compare)
    else:
        document.check(first.output, found.results)
    kept = _keep_report(first, first.reference.parent / first.output.name)
    for job in [*found.jobs, *([found.growth] if found.growth else [])]:
        for train in job.train:
            _keep(train, first, [SNAPSHOT.format(epoch="*")] if job is found.growth else [])
    print(f"Kept in {kept} and {first.reference}")


def _keep(train: Path, config: Config, also: list[str]) -> None:
    """Copy what is needed of a training into the reference run's store."""
    target = config.reference / "train" / train.name
    if train != target:  # else the models were taken from there
        copy_stage(train, target, (WEIGHTS, VALIDATION, *also))
