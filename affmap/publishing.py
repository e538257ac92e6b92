"""The command `affmap-publish`: the report of a sweep or a search, and the models, are kept in `runs/reference`."""

from pathlib import Path

from affmap.command import command
from affmap.config import Config
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.reporting import check_publishable, find_all
from affmap.search import Search
from affmap.settings import ConfigError
from affmap.stage import copy_stage
from affmap.sweep import Sweep
from affmap.training.settings import VALIDATION
from hydra_plugins.hyperopt_sweeper._trials import RESULTS

WITHOUT = ("*.pdf", "*.svg", "*.html", "tensorboard")
"""Not kept: vector figures are in the report's own PDF, which is; all figures in the page; all losses in the tables."""


def publish() -> None:
    """`affmap-publish`: keep the report and the models of a sweep, or the report of a search, in `runs/reference`."""
    command(_publish_any, about=publish.__doc__)


def _publish_any(arguments: list[str]) -> None:
    if search := Search.read(arguments):
        _publish_search(search)
    else:
        _publish(Sweep.read(arguments))


def _publish_search(search: Search) -> None:
    from affmap.report import sealed, searches

    config = search.config
    check_publishable(config)
    if not searches.is_written(config.output, search.folder / RESULTS):
        raise ConfigError(f"{config.output} holds no report of these trials; run affmap-report for them first.")
    kept = config.reference.parent / "tune" / config.output.name
    sealed.copy(config.output, kept, WITHOUT)
    print(f"Kept in {kept}")


def _publish(asked: Sweep) -> None:
    from affmap.report import comparison, document, sealed

    first = asked.first
    found = find_all(asked)
    check_publishable(first)
    if first.report.compare:
        comparison.check(first.output, found.jobs, first.report.compare)
    else:
        document.check(first.output, found.results)
    kept = first.reference.parent / first.output.name
    sealed.copy(first.output, kept, WITHOUT)
    for job in [*found.jobs, *([found.growth] if found.growth else [])]:
        for train in job.train:
            _keep(train, first, [SNAPSHOT.format(epoch="*")] if job is found.growth else [])
    print(f"Kept in {kept} and {first.reference}")


def _keep(train: Path, config: Config, also: list[str]) -> None:
    """Copy what is needed of a training into the reference run's store."""
    target = config.reference / "train" / train.name
    if train != target:  # else the models were taken from there
        copy_stage(train, target, (WEIGHTS, VALIDATION, *also))
