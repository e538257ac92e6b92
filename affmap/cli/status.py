"""The command `affmap-status`: the progress of sweeps and searches, with time spent and left. Runs nothing."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from hydra.errors import HydraException
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from affmap.cli.app import command, read_jobs
from affmap.cli.tables import console
from affmap.config import notes
from affmap.config.search import Search
from affmap.pipeline import status
from affmap.pipeline.progress import duration
from affmap.pipeline.status import JobStatus, StageStatus
from affmap.settings.messages import ConfigError, printable

ABOUT = """\
affmap-status: show the progress of sweeps and searches, with the time spent and the time left.

usage: affmap-status                         all that were run into folders of runs
       affmap-status FOLDER ... [OVERRIDE ...]
       affmap-status OVERRIDE ...

examples:
  affmap-status
  affmap-status runs/exp1 runs/exp2   the sweeps that were run into these folders
  affmap-status experiment=exp1 scale=smoke
"""

COLORS = {"complete": "green", "running": "cyan", "failed": "red", "corrupted": "red", "stopped": "yellow"}


def main() -> None:
    """Run the command `affmap-status`."""
    command(_status, about=ABOUT)


def _status(arguments: list[str]) -> None:
    folders = [Path(argument) for argument in arguments if notes.is_folder(argument)]
    overrides = [argument for argument in arguments if not notes.is_folder(argument)]
    if not arguments:
        folders = notes.folders_with_notes()
    out = console()
    if not arguments and not folders:
        print("There is no sweep in runs; `affmap experiment=exp1` begins one.")
    elif not folders:
        _show(overrides, out, set())
    problems: list[str] = []
    outputs: set[Path] = set()
    for path in folders:
        try:
            _show([*notes.read_note(path), *overrides], out, outputs)
        except (ConfigError, HydraException) as error:  # go on with the others
            problems.append(f"{path}: {error}")
    if problems:
        raise ConfigError("\n".join(problems))


def _show(line: list[str], out: Console, outputs: set[Path]) -> None:
    """Print the status of a search, or of a sweep and its companions, and add them to `outputs`, which are skipped."""
    asked = read_jobs(line)
    if isinstance(asked, Search):
        progress = f"{asked.num_complete} of {asked.num_trials} trials complete"
        out.print(f"{asked.config.title} ({asked.config.output}): {progress}")
        return
    counted: set[str] = set()
    is_shared = False
    for part in (asked, *asked.companions()):
        if part.first.output in outputs:
            continue
        outputs.add(part.first.output)
        jobs = status.jobs(part)
        own = own_stages(jobs, counted)
        is_shared |= any(len(parts) < len(job.parts) for job, parts in zip(jobs, own, strict=True))
        out.print(f"{part.first.title} ({part.first.output}): {summary(jobs, own)}")
        out.print(table(jobs, own))
        problems = [job for job in jobs if job.state in ("failed", "corrupted", "unknown")]
        for failure in status.failures(problems, part.first.output):
            out.print(printable(failure))
    if is_shared:
        out.print(SHARED)


MAX_ROWS = 50
"""Most rows of a table of all settings; longer ones omit those that are complete or missing."""


SHARED = "A stage that settings share counts as spent in the first of them, and as left in each that waits for it."


def own_stages(jobs: Sequence[JobStatus], counted: set[str]) -> list[list[StageStatus]]:
    """For each setting, its stages that no setting before it has, nor `counted`; digests are added to it."""
    own = []
    for job in jobs:
        own.append([part for part in job.parts if part.digest not in counted])
        counted |= {part.digest for part in job.parts}
    return own


def table(jobs: Sequence[JobStatus], own: Sequence[Sequence[StageStatus]]) -> Table:
    """A row for each setting: state, current stage, time spent on its `own_stages`, and time left.

    Of many settings, only those that are running, have stopped or failed.
    """
    expected = status.typical(jobs)
    rows = Table("setting", "state", "stage", box=SIMPLE_HEAD, pad_edge=False)
    rows.add_column("spent", justify="right")
    rows.add_column("left", justify="right")
    for job, parts in zip(jobs, own, strict=True):
        if len(jobs) > MAX_ROWS and job.state in ("complete", "missing"):
            continue
        current = job.current
        rows.add_row(
            printable(job.label),
            Text(job.state, COLORS.get(job.state, "")),
            _stage(current) if current else "",
            duration(sum(part.state.seconds for part in parts)),
            duration(status.seconds_left(job.parts, expected)) if current else "",
        )
    return rows


def _stage(part: StageStatus) -> str:
    return f"{part.name} {part.state.finished}/{part.state.total}" if part.state.total else part.name


def summary(jobs: Sequence[JobStatus], own: Sequence[Sequence[StageStatus]]) -> str:
    """Numbers of settings by state, and total time spent and left, of each setting's `own_stages`."""
    counts = Counter(job.state for job in jobs)
    rest = [f"{count} {name}" for name, count in counts.items() if name != "complete"]
    parts = [part for parts in own for part in parts]
    time = f"{duration(sum(part.state.seconds for part in parts))} spent"
    if rest:
        time += f", {duration(status.seconds_left(parts, status.typical(jobs)))} left, one job at a time"
    return ", ".join([f"{counts['complete']} of {len(jobs)} settings complete", *rest]) + f"; {time}"
