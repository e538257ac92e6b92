"""The command `affmap-publish`: copy reports, and the models of experiments, to `runs/reference`, or verify all of it.

Only intact files that a manifest lists are copied.
"""

from collections.abc import Collection, Sequence
from pathlib import Path

from affmap.cli.app import SweepError, command, flags, read_jobs, read_sweep, written_alone
from affmap.cli.report import CHECK, make_report
from affmap.config.root import Config
from affmap.config.search import Search
from affmap.model.weights import SNAPSHOT, WEIGHTS
from affmap.pipeline.completed import completed
from affmap.results import manifest
from affmap.results.files import EXPERIENCE, STEPS, VALIDATION
from affmap.settings import ConfigError
from affmap.store.provenance import PROVENANCE
from affmap.store.stage import StoreError, copy_stage
from affmap.store.stage import check as check_stage

ABOUT = """\
affmap-publish: keep the report and the models of a sweep in runs/reference.

usage: affmap-publish [--report-only] [OVERRIDE ...]
       affmap-publish [--report-only] FOLDER [OVERRIDE ...]
       affmap-publish --check [OVERRIDE ...]

  --report-only   keep neither models nor the tables of their trainings
  --check         keep nothing; verify all that runs/reference holds

examples:
  affmap-publish experiment=exp1
  affmap-publish runs/exp1   the sweep that was run into runs/exp1
  affmap-publish --check
"""

WITHOUT = ("*.pdf", "*.svg", "*.html")
"""Files that are not kept: vector figures are in the report's PDF, figures in the page."""

REPORT_ONLY = "--report-only"
"""Flag: keep neither models nor the tables of their trainings, which are the largest."""


def main() -> None:
    """Run the command `affmap-publish`."""
    command(_check if CHECK in flags() else _publish, known=[REPORT_ONLY, CHECK], about=ABOUT)


def keep_report(output: Path, config: Config, target: Path, without: Sequence[str]) -> None:
    """Copy a report, see `manifest.copy`, while no other command writes to the reference run."""
    with written_alone(config.reference):
        manifest.copy(output, target, without)


def check_publishable(notice: str | None) -> None:
    """Make sure that results are worth keeping, by the notice of their report.

    Raises:
        ConfigError: they are those of a smoke run, of a part of the trials or settings, or the like.
    """
    if notice:
        raise ConfigError(f"this result is not to be published: {notice}.")


def _publish(arguments: list[str]) -> None:
    from affmap.report import build  # reports take seconds to import

    jobs = read_jobs(arguments)
    report = make_report(jobs)
    config = jobs.config if isinstance(jobs, Search) else jobs.first
    check_publishable(report.notice)
    build.check(report)
    target = config.published
    report_only = REPORT_ONLY in flags()
    keep_report(config.output, config, target, (*WITHOUT, *((VALIDATION, STEPS) if report_only else ())))
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
        with written_alone(config.reference):
            copy_stage(train, target, (WEIGHTS, VALIDATION, EXPERIENCE, *also))


def _check(arguments: list[str]) -> None:
    """Verify the digests of everything in the folder of the reference run, and that nothing that it names is missing.

    A report that nothing else names, such as that of a factor, is not missed when its whole folder is gone; git tells.

    Raises:
        SweepError: a file is not as it was published, or does not belong there; models or an experiment are missing; or
            there is nothing.
    """
    store = read_sweep(arguments).first.reference
    root, problems = store.parent, []
    files = manifest.visible_files(root)
    folders = [path.parent for path in files if path.name == PROVENANCE]
    for folder in folders:
        if folder.is_relative_to(store):
            try:
                check_stage(folder)
            except StoreError as error:
                problems.append(str(error))
        else:
            problems += manifest.problems(folder, others=False) + _missing(folder, store, folders)
    problems += [f"{path} is in no manifest." for path in files if not {*path.parents} & {*folders}]
    if not folders:
        problems.append(f"{root} holds nothing that was published.")
    if problems:
        raise SweepError("\n".join([*problems, "Restore what is published in its last version, or publish it anew."]))
    print(f"{len(folders)} reports and stages in {root}: every file is as it was published.")


def _missing(folder: Path, store: Path, there: Collection[Path]) -> list[str]:
    """A sentence for each folder that the report in `folder` names and that is not there.

    The report of the paper names its experiments, beside it. An experiment's report names its models, which are kept
    unless it is published alone: with `REPORT_ONLY` it is without tables of its trainings, too. A comparison comes
    without models, though the store may have some of them from elsewhere.
    """
    record = manifest.read_intact(folder)
    named = [folder.parent / name for name in record.get("experiments", ())]
    if "compare" not in record and f"tables/{VALIDATION}" in record.get("files", ()):
        named += [
            store / "train" / stage["digest"] for stage in record.get("stages", ()) if stage.get("stage") == "train"
        ]
    return [f"{path} is missing, which {folder / PROVENANCE} names." for path in named if path not in there]
