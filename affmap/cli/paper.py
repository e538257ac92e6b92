"""The command `affmap-paper`: one report of all experiments of the paper, or of all that go beyond it."""

import shlex
from contextlib import ExitStack

from affmap.cli.app import command, flags, read_sweep, written_alone
from affmap.cli.publish import check_publishable, keep_report
from affmap.config.overrides import replace_experiment
from affmap.config.sweep import Sweep
from affmap.pipeline.completed import completed
from affmap.settings import ConfigError
from affmap.store.provenance import without_paths

ABOUT = """\
affmap-paper: draw one report of all experiments of the paper, from their completed sweeps.

usage: affmap-paper [--beyond] [--publish] [OVERRIDE ...]

  --beyond    of the experiments that the paper does not have
  --publish   keep the report in runs/reference

examples:
  affmap-paper
  affmap-paper scale=smoke
  affmap-paper report.partial=true   of the completed settings only

It reads the folders of all experiments, and takes none itself.
"""

BEYOND = "--beyond"
"""Flag: experiments that the paper does not have."""

PUBLISH = "--publish"
"""Flag: keep the report in the folder of the reference run."""


def main() -> None:
    """Run the command `affmap-paper`."""
    beyond, publish = BEYOND in flags(), PUBLISH in flags()
    command(lambda arguments: _paper(read_sweep(arguments), beyond, publish), known=[BEYOND, PUBLISH], about=ABOUT)


def _paper(paper: Sweep, beyond: bool, publish: bool) -> None:
    from affmap.experiments import ROOMS, is_of_paper, open_room  # reports take seconds to import
    from affmap.experiments.paper.report import Chapter, PaperReport, Volume
    from affmap.report import build

    chapters = []
    for experiment in ROOMS:
        if beyond == is_of_paper(experiment):
            continue  # before its sweep is read: what was asked for may not fit it
        jobs = read_sweep(replace_experiment(paper.overrides, experiment, ("output",)))
        first = jobs.first
        try:
            part = completed(jobs)
        except ConfigError as error:
            raise ConfigError(f"{experiment}: {error}") from None
        room = open_room(experiment, first.report.claims)
        results = part.results(first.report.names)
        chapters.append(Chapter(first.title, results, first.report, room, first.output, part.missing))
    first = paper.first
    volume = Volume.BEYOND if beyond else Volume.PAPER
    output = first.output.with_name(first.output.name.replace(first.name, volume))
    line = shlex.join(["affmap-paper", *([BEYOND] if beyond else []), *without_paths(paper.overrides)])
    with ExitStack() as stack:
        for folder in [*(chapter.output for chapter in chapters), output]:  # its figures are theirs
            stack.enter_context(written_alone(folder))
        page = build.write(PaperReport(output, chapters, line, first.notice, volume))
    print(f"The report is {page}")
    if publish:
        parts = [f"PARTIAL: {chapter.missing}" for chapter in chapters if chapter.missing]
        check_publishable("; ".join([*filter(None, [first.notice]), *parts]))
        target = first.reference.parent / output.name
        keep_report(output, first, target, without=["figures", "*.html"])
