"""The status of the jobs of a sweep, one of `affmap.store.store.State` each. Runs nothing."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import mean
from typing import NamedTuple

from affmap.config.notes import NOTE
from affmap.config.root import Config
from affmap.config.sweep import Sweep
from affmap.pipeline.job import open_store, stages
from affmap.pipeline.progress import Overview
from affmap.store.stage import Stage
from affmap.store.store import State

REASONS = {
    "running": "another job works on it",
    "stopped": "its process ended in the middle; was it killed, perhaps for lack of memory?",
    "missing": "it was not begun",
    "unknown": "it is not complete; whether a job works on it cannot be told, because its disk has no locks",
}
"""State of an incomplete stage without an error -> the reason."""


class StageStatus(NamedTuple):
    """The state of a stage of a job."""

    name: str
    digest: str
    state: State


class JobStatus(NamedTuple):
    """One job of a sweep."""

    label: str
    parts: tuple[StageStatus, ...]

    @property
    def current(self) -> StageStatus | None:
        """The first stage that is not complete; None where all are."""
        return next((part for part in self.parts if part.state.name != "complete"), None)

    @property
    def state(self) -> str:
        """The state of the job: that of its current stage."""
        return self.current.state.name if self.current else "complete"


def jobs(sweep: Sweep, check: bool = False) -> list[JobStatus]:
    """The status of each job of a sweep; `check` verifies every file of complete stages, once for all jobs."""
    cache: dict[str, StageStatus] = {}
    return [
        JobStatus(label, tuple(_part(stage, config, check, cache) for stage in stages(config)))
        for config, label in zip(sweep.configs, sweep.labels, strict=True)
    ]


def _part(stage: Stage, config: Config, check: bool, cache: dict[str, StageStatus]) -> StageStatus:
    if stage.digest not in cache:
        cache[stage.digest] = StageStatus(stage.name, stage.digest, open_store(config).state(stage, check))
    return cache[stage.digest]


def distinct(jobs: Iterable[JobStatus]) -> list[StageStatus]:
    """All stages, once each, since settings share some."""
    return list({(part.name, part.digest): part for job in jobs for part in job.parts}.values())


def typical(jobs: Iterable[JobStatus]) -> dict[str, float]:
    """Stage name -> mean seconds of those that are complete."""
    seconds = defaultdict(list)
    for part in distinct(jobs):
        if part.state.name == "complete":
            seconds[part.name].append(part.state.seconds)
    return {name: mean(values) for name, values in seconds.items()}


def seconds_left(parts: Iterable[StageStatus], expected: dict[str, float]) -> float | None:
    """Estimate of the remaining seconds, from a stage's own pace or others of its kind; None if unknown."""
    total = 0.0
    for part in parts:
        if part.state.name == "complete":
            continue
        left = part.state.seconds_left
        if left is None:
            if part.name not in expected:
                return None
            left = max(expected[part.name] - part.state.seconds, 0.0)
        total += left
    return total


def overview(jobs: Sequence[JobStatus], workers: int) -> Overview:
    """The progress of a sweep that so many jobs at a time work on."""
    stages = distinct(jobs)
    left = seconds_left(stages, typical(jobs))
    parts = [part.state.finished / part.state.total for part in stages if part.state.total]
    complete = sum(part.state.name == "complete" for part in stages)
    return Overview(
        settings=sum(job.state == "complete" for job in jobs),
        num_settings=len(jobs),
        stages=complete,
        num_stages=len(stages),
        work=complete + sum(parts),
        seconds_left=None if left is None else left / workers,
    )


def failures(jobs: Iterable[JobStatus], output: Path) -> list[str]:
    """The reason for each incomplete job of the sweep into `output`, and its log, in a line or two.

    Where the job of another sweep, which shares the stage, was the last to try it, the log's line says so.
    """
    return [_failure(job.label, job.current.state, output) for job in jobs if job.current]


def _failure(label: str, state: State, output: Path) -> str:
    log = f"\n    log: {_relative(Path(state.log))}" if state.log else ""
    other = _sweep_of(Path(state.log)) if state.log else None
    whose = f" (the last attempt was that of {_relative(other)})" if other and other != output.resolve() else ""
    return f"{label}: {state.error or REASONS[state.name]}{log}{whose}"


def _sweep_of(log: Path) -> Path | None:
    """The folder of the sweep of which a log is; None if it is not there any more."""
    with suppress(OSError):  # of a name that is too long, in a note that somebody else wrote
        return next((folder.resolve() for folder in log.parents if (folder / NOTE).is_file()), None)
    return None


def _relative(path: Path) -> Path:
    """A path relative to the current folder, if it is inside."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
