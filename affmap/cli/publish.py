"""The command `affmap-publish`: reports, and the models of experiments, are kept in `runs/reference`."""

from pathlib import Path

from affmap.cli.app import command, flags
from affmap.cli.report import read, report_of
from affmap.config.root import Config
from affmap.config.search import Search
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.pipeline.completed import completed
from affmap.results import manifest
from affmap.results.files import STEPS, VALIDATION
from affmap.settings.messages import ConfigError
from affmap.store.stage import copy_stage

WITHOUT = ("*.pdf", "*.svg", "*.html", "tensorboard")
"""Not kept: vector figures are in the report's own PDF, which is; all figures in the page; all losses in the tables."""

REPORT_ONLY = "--report-only"
"""Flag: keep no models, nor the tables of their trainings, which are larger than all others."""


def main() -> None:
    """`affmap-publish`: keep report and models of an experiment in `runs/reference`; `--report-only`: no trainings."""
    command(_publish, known=[REPORT_ONLY], about=main.__doc__)


def check_publishable(config: Config) -> None:
    """Make sure that results are worth keeping.

    Raises:
        ConfigError: they are those of a smoke run, or the like.
    """
    if config.notice:
        raise ConfigError(f"this is not a result to keep: {config.notice}.")


def _publish(arguments: list[str]) -> None:
    from affmap.report import build  # reports take seconds to import

    asked = read(arguments)
    report = report_of(asked)
    config = asked.config if isinstance(asked, Search) else asked.first
    check_publishable(config)
    build.check(report)
    place = config.published
    report_only = REPORT_ONLY in flags()
    manifest.copy(config.output, place, (*WITHOUT, *((VALIDATION, STEPS) if report_only else ())))
    if isinstance(asked, Search) or config.report.compare or report_only:
        print(f"Kept in {place}")
        return
    part = completed(asked)
    for setting in [*part.settings, *([part.growth] if part.growth else [])]:
        for train in setting.train:
            _keep(train, config, [SNAPSHOT.format(epoch="*")] if setting is part.growth else [])
    print(f"Kept in {place} and {config.reference}")


def _keep(train: Path, config: Config, also: list[str]) -> None:
    """Copy what is needed of a training into the reference run's store."""
    target = config.reference / "train" / train.name
    if train != target:  # else the models were taken from there
        copy_stage(train, target, (WEIGHTS, VALIDATION, *also))
