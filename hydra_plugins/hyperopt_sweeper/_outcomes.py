"""Outcomes of trials, from the return values of jobs."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from hydra.core.utils import JobReturn, JobStatus


class Outcome(NamedTuple):
    """The outcome of a trial."""

    result: float | None
    """Return value of the application, a finite number; None if the trial failed."""
    error: str | None = None
    """The reason of a failure."""
    raised: BaseException | None = None
    """The exception of the application, if that is the reason."""


def outcomes(jobs: Sequence[JobReturn], num: int, stacked: bool) -> list[Outcome]:
    """The outcomes of a batch.

    Args:
        jobs: one for each trial, or one for all of them.
        num: trials of the batch.
        stacked: whether one job returns a list of all results.
    """
    if not stacked:
        return [_failure(job) or _outcome(job._return_value) for job in jobs]
    (job,) = jobs
    if failure := _failure(job):
        return [failure] * num
    value = job._return_value
    try:
        results = list(value)
    except TypeError:
        results = []
    if len(results) != num:
        error = f"returned {value!r}, which is not a list of results, one for each of {num} trials"
        return [Outcome(None, error)] * num
    return [_outcome(result) for result in results]


def _failure(job: JobReturn) -> Outcome | None:
    if job.status != JobStatus.FAILED:
        return None
    error = job._return_value  # the public property writes to stderr
    return Outcome(None, f"{type(error).__name__}: {error}", error)


def _outcome(value: Any) -> Outcome:
    try:
        if isinstance(value, bool | str | bytes):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, RuntimeError):  # RuntimeError: a tensor of several numbers
        return Outcome(None, f"returned {value!r}, which is no number")
    return Outcome(result) if math.isfinite(result) else Outcome(None, f"returned {result}, which is not finite")
