"""The command `affmap-report`: draw the report of a sweep or of a search, or check every file that it comes from."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from affmap.cli.app import SweepError, command, flags, read_sweep
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline import status
from affmap.pipeline.completed import completed
from affmap.pipeline.job import all_stages
from affmap.report.build import Report
from affmap.results import manifest
from affmap.results.provenance import leaves
from affmap.store.files import locked
from affmap.store.provenance import circumstances, without_paths
from hydra_plugins.hyperopt_sweeper import RESULTS

CHECK = "--check"
"""Flag: look at every file, draw nothing."""


def main() -> None:
    """`affmap-report`: draw the report of a sweep or of a search; `--check`: look at every file that it comes from."""
    command(_check if CHECK in flags() else _report, known=[CHECK], about=main.__doc__)


def read(arguments: Sequence[str]) -> Search | Sweep:
    """The search of a command line, or its sweep.

    Raises:
        ConfigError: a value that is not allowed; the message says what would be right.
    """
    return Search.read(arguments) or read_sweep(arguments)


def report_of(asked: Search | Sweep) -> Report:
    """The report of a search, or that of the completed part of a sweep: an experiment or a comparison.

    Raises:
        ConfigError: some settings are not complete, and no partial report is wanted; or they differ in more than a
            report tells apart.
    """
    if isinstance(asked, Search):
        return _search_report(asked)
    from affmap.experiments import claims_about  # reports take seconds to import
    from affmap.experiments.comparison.report import ComparisonReport
    from affmap.report.experiment import ExperimentReport
    from affmap.results.tables import Results

    first, part = asked.first, completed(asked)
    partial = f"PARTIAL: {part.missing.partition(' (')[0]}" if part.missing else None
    head = {
        "name": first.name,
        "title": first.title,
        "command": shlex.join(["affmap", *without_paths(asked.overrides)]),
    }
    notice = "; ".join(filter(None, [first.notice, partial])) or None
    if first.report.compare:
        return ComparisonReport(first.output, part.settings, first.report.compare, **head, notice=notice)
    claims = claims_about(first.report.claims)
    results = Results(part.settings, part.growth, first.report.x, first.report.color, part.baselines)
    return ExperimentReport(first.output, results, first.report, claims, **head, notice=notice)


def _search_report(search: Search) -> Report:
    from affmap.experiments.search.report import SearchReport

    config, made = search.config, search.num_complete
    partial = f"PARTIAL: {made} of {search.num_trials} trials are complete" if made < search.num_trials else None
    return SearchReport(
        config.output,
        search.folder / RESULTS,
        config.objective or "",
        in_use=leaves(config.complete()),
        log_keys=search.log_keys,
        origin={"overrides": search.overrides, "config": config.model_dump(mode="json"), **circumstances()},
        title=config.title,
        command=shlex.join(["affmap", *without_paths(search.overrides)]),
        notice="; ".join(filter(None, [config.notice, partial])) or None,
    )


def _report(arguments: list[str]) -> None:
    from affmap.report import build

    asked = read(arguments)
    output = asked.config.output if isinstance(asked, Search) else asked.first.output
    lock = output.with_name(f".{output.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    with locked(lock, f"another command that writes {output}"):
        try:
            report = report_of(asked)
            manifest.check_output(output, () if isinstance(asked, Search) else all_stages(asked))
            page = build.write(report)
        finally:
            lock.unlink(missing_ok=True)
    if page.suffix == ".md":
        print(f"{page.read_text('utf-8')}\nThe table is {page}")
    else:
        print(f"The report is {page}, to be clicked through {page.with_suffix('.html')}")


def _check(arguments: list[str]) -> None:
    """Compute the digests of all stages and of the report anew.

    Raises:
        SweepError: something is not as it was written.
    """
    asked = read(arguments)
    output, made_of, problems = _check_search(asked) if isinstance(asked, Search) else _check_sweep(asked)
    if problems:
        raise SweepError("\n".join(problems))
    print(f"{made_of} and the report in {output}: every file is as it was written.")


def _check_search(search: Search) -> tuple[Path, str, list[str]]:
    """The folder of a search's report, its trials in words, and everything that is wrong with its files."""
    output = search.config.output
    problems = manifest.problems(output)
    if not problems and not manifest.same_results(manifest.read(output), _search_report(search).record):
        problems = [f"{output} is the report of other trials; affmap-report makes it anew."]
    return output, f"{search.num_complete} trials", problems


def _check_sweep(sweep: Sweep) -> tuple[Path, str, list[str]]:
    """The folder of a sweep's report, its stages in words, and everything that is wrong with its files."""
    output, jobs = sweep.first.output, status.jobs(sweep, check=True)
    for companion in sweep.companions():
        jobs += status.jobs(companion, check=True)
    stages = {stage.digest: stage for job in jobs for stage in job.parts}
    problems = [
        stage.state.error or f"Stage {stage.name}/{digest} is {stage.state.name}."
        for digest, stage in stages.items()
        if stage.state.name != "complete"
    ]
    manifest.check_output(output, all_stages(sweep))
    problems += manifest.problems(output)
    if not problems and not manifest.stage_digests(output) <= stages.keys():
        problems = [f"{output} was made by other versions of the stages' rules; affmap-report makes it anew."]
    return output, f"{len(stages)} stages", problems
