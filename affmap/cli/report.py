"""The command `affmap-report`: draw the report of a sweep or of a search, or verify all of its files and stages."""

import shlex
from pathlib import Path
from typing import Any

from affmap.cli import tables
from affmap.cli.app import SweepError, command, flags, read_jobs, written_alone
from affmap.config.root import Config
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline import status
from affmap.pipeline.completed import IncompleteError, complete_elsewhere, completed
from affmap.pipeline.job import all_stages
from affmap.report.build import Report
from affmap.results import manifest
from affmap.results.provenance import leaves
from affmap.settings.messages import ConfigError, counted, first_lines, printable
from affmap.store.provenance import circumstances, extensions_of, has_path, without_paths

ABOUT = """\
affmap-report: draw the report of a sweep or of a search, and print its results.

usage: affmap-report [--check] [OVERRIDE ...]
       affmap-report [--check] FOLDER [OVERRIDE ...]

  --check   draw nothing; verify every file of the report and of all stages behind it

examples:
  affmap-report experiment=exp1
  affmap-report runs/exp1                       the report of the sweep that was run into runs/exp1
  affmap-report runs/exp1 report.partial=true   of its completed settings only
  affmap-report runs/exp1 --check
"""

CHECK = "--check"
"""Flag: verify every file, draw nothing."""

ANEW = "affmap-report makes a report anew."
"""The remedy for a damaged report."""


def main() -> None:
    """Run the command `affmap-report`."""
    command(_check if CHECK in flags() else _report, known=[CHECK], about=ABOUT)


def make_report(jobs: Search | Sweep) -> Report:
    """The report of a search, or of the completed part of a sweep: an experiment or a comparison.

    Raises:
        ConfigError: some settings are incomplete, and the report may not be partial; or they differ in more keys than
            a report can show.
    """
    if isinstance(jobs, Search):
        return _make_search_report(jobs)
    from affmap.experiments import open_room  # reports take seconds to import
    from affmap.experiments.comparison.report import ComparisonReport
    from affmap.report.experiment import ExperimentReport

    first, part = jobs.first, completed(jobs)
    partial = f"PARTIAL: {part.missing.partition(' (')[0]}" if part.missing else None
    head = {
        "name": first.name,
        "title": first.title,
        "command": shlex.join(["affmap", *without_paths(jobs.overrides)]),
    }
    notice = "; ".join(filter(None, [first.notice, partial])) or None
    if first.report.compare:
        return ComparisonReport(first.output, part.settings, first.report.compare, **head, notice=notice)
    room = open_room(first.name, first.report.claims)
    return ExperimentReport(first.output, part.results(first.report.names), first.report, room, **head, notice=notice)


def _make_search_report(search: Search) -> Report:
    from affmap.experiments.search.report import SearchReport

    config, count = search.config, search.num_complete
    partial = f"PARTIAL: {count} of {search.num_trials} trials are complete" if count < search.num_trials else None
    return SearchReport(
        config.output,
        search.trials,
        config.objective or "",
        in_use=leaves(config.complete()),
        log_keys=search.log_keys,
        origin={
            "overrides": without_paths(search.overrides),
            "config": _origin(config),
            **circumstances(),
            **extensions_of(config.complete()),
        },
        title=config.title,
        command=shlex.join(["affmap", *without_paths(search.overrides)]),
        notice="; ".join(filter(None, [config.notice, partial])) or None,
    )


def _origin(config: Config) -> dict[str, Any]:
    """The configuration of a search, without folders that are absolute paths."""
    values = config.model_dump(mode="json")
    folders = {key for key, value in config if isinstance(value, Path) and has_path(f"{key}={value}")}
    return {key: value for key, value in values.items() if key not in folders}


def _report(arguments: list[str]) -> None:
    from affmap.report import build

    jobs = read_jobs(arguments)
    output = jobs.config.output if isinstance(jobs, Search) else jobs.first.output
    with written_alone(output):
        try:
            report = make_report(jobs)
        except IncompleteError as error:
            other = complete_elsewhere(jobs) if isinstance(jobs, Sweep) else None
            hint = f" Another sweep is complete: `affmap-report {shlex.quote(str(other))}` reports it." if other else ""
            raise IncompleteError(f"{error}{hint}") from None
        manifest.check_output(output, () if isinstance(jobs, Search) else all_stages(jobs))
        page = build.write(report)
    notice = f"{printable(report.notice)}\n" if report.notice else ""
    if page.suffix == ".md":  # the notice is its heading
        print(f"{printable(page.read_text('utf-8'))}\n{notice}The table is {page}")
    else:
        print(notice, end="")
        tables.show(output / "tables")
        print(notice, end="")
        print(f"The report is {page}; open {page.with_suffix('.html')} for the interactive version.")


def _check(arguments: list[str]) -> None:
    """Verify the digests of all stages and of the report.

    Raises:
        SweepError: a file is not as it was written; the message says which command makes it again.
    """
    jobs = read_jobs(arguments)
    output = jobs.config.output if isinstance(jobs, Search) else jobs.first.output
    parts, problems = _check_search(jobs) if isinstance(jobs, Search) else _check_sweep(jobs)
    if problems:
        raise SweepError("\n".join(problems))
    print(f"{parts} and the report in {output}: every file is as it was written.")


def _check_search(search: Search) -> tuple[str, list[str]]:
    """The trials of a search in words, and errors in the files of its report, with the remedy."""
    output = search.config.output
    problems = manifest.problems(output)
    if not problems and not manifest.same_results(manifest.read(output), _make_search_report(search).record):
        problems = [f"{output} is the report of other trials."]
    return counted(search.num_complete, "trial"), [*problems, ANEW] if problems else []


def _check_sweep(sweep: Sweep) -> tuple[str, list[str]]:
    """The stages of a sweep in words, and errors in their files and in those of its report, with the remedies.

    Raises:
        ConfigError: the folder holds the report of other results.
    """
    output, jobs = sweep.first.output, status.jobs(sweep, check=True)
    for companion in sweep.companions():
        jobs += status.jobs(companion, check=True)
    stages = {stage.digest: stage for job in jobs for stage in job.parts}
    of_stages = [
        stage.state.error or f"Stage {stage.name}/{digest} is {stage.state.name}."
        for digest, stage in stages.items()
        if stage.state.name != "complete"
    ]
    if of_stages:
        of_stages = [*first_lines(of_stages, len(of_stages)), "affmap with the same arguments makes missing stages."]
    if manifest.holds_others(output, all_stages(sweep)):
        raise ConfigError(f"{output} holds the report of other results; say output= with the folder of this one.")
    of_report = manifest.problems(output)
    if not of_stages and not of_report and not manifest.stage_digests(output) <= stages.keys():
        of_report = [f"{output} was made by other versions of the stages' rules."]
    return counted(len(stages), "stage"), [*of_stages, *of_report, *([ANEW] if of_report else [])]
