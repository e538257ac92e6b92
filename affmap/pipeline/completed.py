"""The completed part of a sweep, as reports need it."""

import shlex
from typing import NamedTuple

from affmap.config.sweep import Sweep
from affmap.pipeline.job import find, stages
from affmap.results.files import Job
from affmap.results.tables import Results, join
from affmap.settings.messages import ConfigError


class Completed(NamedTuple):
    """The completed settings of a sweep."""

    jobs: tuple[Job, ...]
    growth: Job | None
    missing: str
    """A sentence about what is not complete; empty if all is."""

    @property
    def results(self) -> Results:
        """All of it, for a report.

        Raises:
            ConfigError: settings differ in more than a report tells apart.
        """
        return Results(self.jobs, self.growth)


def completed(sweep: Sweep) -> Completed:
    """The completed settings of a sweep, members that were divided among jobs put together.

    Raises:
        ConfigError: some settings are not complete, and no partial report is wanted; or none is complete.
        StoreError: a file is damaged.
    """
    growth = sweep.growth()
    jobs = [find(config) for config in sweep.configs]
    grown = find(growth.first) if growth else None
    missing = [label for label, job in zip(sweep.labels, jobs, strict=True) if job is None]
    if growth and grown is None:
        missing.append(growth.first.name)
    count = len(jobs) + (growth is not None)
    sentence = f"{len(missing)} of {count} settings are not complete ({'; '.join(missing)})" if missing else ""
    complete = [job for job in jobs if job]
    if missing and not (sweep.first.report.partial and complete):
        raise ConfigError(f"{sentence}; run `affmap {shlex.join(sweep.overrides)}` first.")
    return Completed(join(complete), grown, sentence)


def digests(sweep: Sweep) -> set[str]:
    """Digests of all stages of a sweep."""
    growth = sweep.growth()
    return {stage.digest for each in (sweep, growth) if each for config in each.configs for stage in stages(config)}
