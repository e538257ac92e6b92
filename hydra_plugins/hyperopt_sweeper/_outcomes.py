"""Outcomes of trials, from the return values of jobs."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from hydra.core.utils import JobReturn, JobStatus


class FinalError(Exception):
    """An application raises it, or a subclass, where no trial can succeed: it ends the search and is no failure."""


class Outcome(NamedTuple):
    """The outcome of a trial."""

    result: float | None
    """Return value of the application, a finite number; None if the trial failed."""
    error: str | None = None
    """The reason of a failure."""
    raised: BaseException | None = None
    """The exception of the application, if that is the reason."""

    @property
    def crashed(self) -> bool:
        """Whether the reason need not lie in the trial's values: any exception but a ValueError or ArithmeticError."""
        return self.raised is not None and not isinstance(self.raised, (ValueError, ArithmeticError))


def outcomes(jobs: Sequence[JobReturn], num: int, stacked: bool) -> list[Outcome]:
    """The outcomes of a batch.

    Args:
        jobs: one for each trial, or one for all of them.
        num: trials of the batch.
        stacked: whether one job returns a list of all results.
    """
    if not stacked:
        return [_failed(job) or _outcome(job._return_value) for job in jobs]
    (job,) = jobs
    if failed := _failed(job):
        return [failed] * num
    value = job._return_value
    try:
        results = list(value)
    except TypeError:
        results = []
    if len(results) != num:
        error = f"returned {value!r}, which is not a list of results, one for each of {num} trials"
        return [Outcome(None, error)] * num
    return [_outcome(result) for result in results]


def _failed(job: JobReturn) -> Outcome | None:
    if job.status != JobStatus.FAILED:
        return None
    return failure(job._return_value)  # the public property writes to stderr


def failure(error: BaseException) -> Outcome:
    """The outcome of a trial that ended with an exception."""
    return Outcome(None, f"{type(error).__name__}: {error}", error)


def _outcome(value: Any) -> Outcome:
    try:
        if isinstance(value, bool | str | bytes):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, RuntimeError):  # RuntimeError: a tensor of several numbers
        return Outcome(None, f"returned {value!r}, which is no number")
    return Outcome(result) if math.isfinite(result) else Outcome(None, f"returned {result}, which is not finite")
