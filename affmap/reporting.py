"""The commands around reports; all take the overrides of the sweep that they are about.

`affmap-report` draws the report of a sweep or a search, `affmap-paper` puts those of all experiments together.
"""

import shlex
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from affmap import status, sweep
from affmap.command import SweepError, command, flags
from affmap.config import Config
from affmap.files import locked
from affmap.provenance import circumstances, without_places
from affmap.report import provenance
from affmap.report.records import Job
from affmap.report.tables import Results, join
from affmap.search import Search
from affmap.settings import ConfigError
from affmap.stages import find, stages
from affmap.sweep import Sweep
from hydra_plugins.hyperopt_sweeper._trials import RESULTS

PAPER = ("exp1", "exp2", "exp3", "exp4", "exp5")
"""The experiments of the paper."""

CHECK, PUBLISH = "--check", "--publish"
"""Flags of `affmap-report` and `affmap-paper`."""


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


def find_all(asked: Sweep) -> Found:
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
        told = shlex.join(asked.overrides)
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
    if not provenance.digests(output) <= set(stages):
        raise ConfigError(f"{output} holds the report of other results; say output=runs/<name>, or remove that folder.")


def report() -> None:
    """`affmap-report`: draw the report of a sweep or of a search; `--check`: look at every file that it comes from."""
    command(_check if CHECK in flags() else _report_any, known=[CHECK], about=report.__doc__)


def _check(arguments: list[str]) -> None:
    """Compute the digests of all stages and of the report anew.

    Raises:
        SweepError: something is not as it was written.
    """
    from affmap.report import sealed, searches

    if search := Search.read(arguments):
        output, found = search.config.output, f"{search.num_complete} trials"
        problems = sealed.problems(output)
        if not problems and not searches.is_written(output, search.folder / RESULTS):
            problems = [f"{output} is the report of other trials; affmap-report makes it anew."]
    else:
        output, found, problems = _check_sweep(Sweep.read(arguments))
    if problems:
        raise SweepError("\n".join(problems))
    print(f"{found} and the report in {output}: every file is as it was written.")


def _check_sweep(asked: Sweep) -> tuple[Path, str, list[str]]:
    """The folder of a sweep's report, what was found of it, and what is wrong with its files."""
    from affmap.report import sealed

    output, states = asked.first.output, status.settings(asked, check=True)
    if growth := asked.growth():
        states += status.settings(growth, check=True)
    parts = {part.digest: part for setting in states for part in setting.parts}
    problems = [
        part.state.error or f"Stage {part.name}/{digest} is {part.state.name}."
        for digest, part in parts.items()
        if part.state.name != "complete"
    ]
    check_output(output, parts)
    return output, f"{len(parts)} stages", [*problems, *sealed.problems(output)]


def _report_any(arguments: list[str]) -> None:
    search = Search.read(arguments)
    asked = search or Sweep.read(arguments)
    output = asked.config.output if isinstance(asked, Search) else asked.first.output
    lock = output.with_name(f".{output.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    with locked(lock, f"another command that writes {output}"):
        try:
            _report_search(asked) if isinstance(asked, Search) else _report(asked)
        finally:
            lock.unlink(missing_ok=True)


def _report_search(search: Search) -> None:
    from affmap.report import searches

    config = search.config
    check_output(config.output, ())
    made = search.num_complete
    part = f"PARTIAL: {made} of {search.num_trials} trials are complete" if made < search.num_trials else ""
    path = searches.write(
        config.output,
        search.folder / RESULTS,
        config.objective or "",
        in_use=provenance.leaves(config.model_dump(mode="json")),
        log_keys=search.log_keys,
        origin={"overrides": search.overrides, "config": config.model_dump(mode="json"), **circumstances()},
        title=config.title,
        command=shlex.join(["affmap", *without_places(search.overrides)]),
        notice="; ".join(filter(None, [config.notice, part])) or None,
    )
    print(f"{path.read_text('utf-8')}\nThe table is {path}")


def _report(asked: Sweep) -> None:
    from affmap.report import comparison, document

    first = asked.first
    found = find_all(asked)
    notice = "; ".join(filter(None, [first.notice, found.missing and f"PARTIAL: {found.missing.partition(' (')[0]}"]))
    check_output(first.output, digests(asked))
    command = shlex.join(["affmap", *without_places(asked.overrides)])
    told = {"name": first.name, "title": first.title, "command": command}
    if first.report.compare:
        path = comparison.write(first.output, found.jobs, first.report.compare, **told, notice=notice or None)
        print(f"{path.read_text('utf-8')}\nThe table is {path}")
    else:
        path = document.write(first.output, found.results, first.report, **told, notice=notice or None)
        print(f"The report is {path}, to be clicked through {path.with_suffix('.html')}")


def paper() -> None:
    """`affmap-paper`: one report of all five experiments, from their own; `--publish`: keep it in `runs/reference`."""
    keep = PUBLISH in flags()
    command(lambda arguments: _paper(Sweep.read(arguments), keep), known=[PUBLISH], about=paper.__doc__)


def _paper(asked: Sweep, keep: bool) -> None:
    from affmap.report import paper, sealed

    parts = []
    for experiment in PAPER:
        part = Sweep.read(sweep.instead(asked.overrides, experiment, ("output",)))
        first = part.first
        try:
            found = find_all(part)
        except ConfigError as error:
            raise ConfigError(f"{experiment}: {error}") from None
        parts.append(paper.Part(first.title, found.results, first.report, first.output, found.missing))
    first = asked.first
    output = first.output.with_name(first.output.name.replace(first.name, "paper"))
    command = shlex.join(["affmap-paper", *without_places(asked.overrides)])
    print(f"The report is {paper.write(output, parts, command=command, notice=first.notice)}")
    if keep:
        check_publishable(first)
        sealed.copy(output, first.reference.parent / output.name, without=["figures", "*.html"])


def check_publishable(config: Config) -> None:
    """Make sure that results are worth keeping.

    Raises:
        ConfigError: they are those of a smoke run, or the like.
    """
    if config.notice:
        raise ConfigError(f"this is not a result to keep: {config.notice}.")
