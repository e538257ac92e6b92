"""The command `affmap-publish`: copy reports, and the models of experiments, to `runs/reference`."""

from pathlib import Path

from affmap.cli.app import command, flags
from affmap.cli.report import make_report, read
from affmap.config.root import Config
from affmap.config.search import Search
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.pipeline.completed import completed
from affmap.results import manifest
from affmap.results.files import STEPS, VALIDATION
from affmap.settings import ConfigError, lies_in
from affmap.store.stage import copy_stage

ABOUT = "`affmap-publish`: keep report and models of an experiment in `runs/reference`; `--report-only`: no trainings."

WITHOUT = ("*.pdf", "*.svg", "*.html", "tensorboard")
"""Files that are not kept: vector figures are in the report's PDF, figures in the page, losses in the tables."""

REPORT_ONLY = "--report-only"
"""Flag: keep neither models nor the tables of their trainings, which are the largest."""


def main() -> None:
    """Run the command `affmap-publish`."""
    command(_publish, known=[REPORT_ONLY], about=ABOUT)


def check_publishable(config: Config) -> None:
    """Make sure that results are worth keeping.

    Raises:
        ConfigError: they are those of a smoke run, or the like.
    """
    if config.notice:
        raise ConfigError(f"this result is not to be published: {config.notice}.")


def check_target(output: Path, target: Path) -> None:
    """Make sure that a report is published into a folder of its own.

    Raises:
        ConfigError: one of the two folders is the other, or lies in it.
    """
    if lies_in(output, target) or lies_in(target, output):
        raise ConfigError(
            f"{output} would be published as {target}, which would replace it; say reference=<folder>/store with a "
            "folder that is not that of the reports, such as runs/reference."
        )


def _publish(arguments: list[str]) -> None:
    from affmap.report import build  # reports take seconds to import

    jobs = read(arguments)
    report = make_report(jobs)
    config = jobs.config if isinstance(jobs, Search) else jobs.first
    check_publishable(config)
    build.check(report)
    target = config.published
    check_target(config.output, target)
    report_only = REPORT_ONLY in flags()
    manifest.copy(config.output, target, (*WITHOUT, *((VALIDATION, STEPS) if report_only else ())))
    if isinstance(jobs, Search) or config.report.compare or report_only:
        print(f"Kept in {target}")
        return
    part = completed(jobs)
    for setting in [*part.settings, *([part.growth] if part.growth else [])]:
        for train in setting.train:
            _keep(train, config, [SNAPSHOT.format(epoch="*")] if setting is part.growth else [])
    print(f"Kept in {target} and {config.reference}")


def _keep(train: Path, config: Config, also: list[str]) -> None:
    """Copy the weights, losses and other files of a training to the reference run's store."""
    target = config.reference / "train" / train.name
    if train != target:  # else the models come from there
        copy_stage(train, target, (WEIGHTS, VALIDATION, *also))
