"""Completed stages on disk -> tidy tables and records. Knows file formats, and neither tests nor figures.

Lengths are in units (u), times in steps, likelihoods in nats (both coordinates summed, constants included).
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from affmap.results.files import PLANNERS, STAGES, Exploration, Job, Maps, Sight, Trajectories, World
from affmap.settings import ConfigError
from affmap.store.files import guarded_read, read_arrays
from affmap.store.provenance import PROVENANCE, canonical

LAYOUTS = "layouts.json"
"""File of a control stage: the layout of each run."""

RUN_COLUMNS = [
    "layout",
    "planner",
    "lookup_spacing",
    "context_size",
    "member",
    "run",
    "start_x",
    "start_y",
    "goal_x",
    "goal_y",
    "prediction_error",
    "mean_distance",
    "reached",
    "steps_to_reach",
    "success",
    "steps_touching",
    "steps_in_fog",
    "final_spread",
    "crossable",
    "lookup_error",
]
VALIDATION_COLUMNS = ["member", "epoch", "training_nll", "validation_nll"]

Record = TypeVar("Record", Maps, Exploration, Trajectories)


@dataclass(frozen=True)
class Results:
    """Everything the report is made of; each stage folder is read once, when it is first asked for."""

    jobs: tuple[Job, ...]
    growth: Job | None = None
    """A longer training whose maps were kept after several epochs, where the experiment has one."""

    def __post_init__(self) -> None:
        settings = [(job.context_size, job.planner, job.layout) for job in self.jobs]
        if not settings:
            raise ConfigError("a report needs at least one completed setting.")
        if len(set(settings)) < len(settings):
            raise ConfigError(
                "a report tells settings apart by context size, planner and layout, and here others differ, too; "
                "report.compare=<key> makes a table of the values of any other key."
            )

    @property
    def context_sizes(self) -> list[int]:
        """All context sizes, ascending."""
        return sorted({job.context_size for job in self.jobs})

    @property
    def planners(self) -> list[str]:
        """The planners that were run, in the order of `PLANNERS`, others after them in that of their names."""
        return sorted({job.planner for job in self.jobs}, key=lambda kind: ([*PLANNERS, kind].index(kind), kind))

    @property
    def layouts(self) -> list[str]:
        """The layouts that were flown in, in the order of the jobs."""
        return list(dict.fromkeys(job.layout for job in self.jobs))

    def job(self, context_size: int, planner: str | None = None, layout: str | None = None) -> Job | None:
        """The first job of a setting (of any planner or layout where none is given), or None where it was not run."""
        return next(
            (
                job
                for job in self.jobs
                if job.context_size == context_size and planner in (None, job.planner) and layout in (None, job.layout)
            ),
            None,
        )

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per run of control, columns `RUN_COLUMNS`."""
        table = pd.concat([read_runs(job) for job in self.jobs])
        return table.sort_values(["context_size", "planner", "layout", "member", "run"], ignore_index=True)

    @cached_property
    def validation(self) -> pd.DataFrame:
        """One row per training, member and epoch: `layout`, `context_size`, then `VALIDATION_COLUMNS`.

        `layout` is the first one flown in with the models of that training.
        """
        folders: dict[Path, Job] = {}
        for job in self.jobs:
            for folder in job.train:
                folders.setdefault(folder, job)
        tables = []
        for folder, job in folders.items():
            table = _read_table(folder / "validation.csv", VALIDATION_COLUMNS)
            tables.append(table.assign(layout=job.layout, context_size=job.context_size))
        columns = ["layout", "context_size", *VALIDATION_COLUMNS]
        return pd.concat(tables)[columns].sort_values(["layout", "context_size", "member", "epoch"], ignore_index=True)

    @cached_property
    def last_epoch(self) -> pd.DataFrame:
        """`validation` at the last epoch of each training, whose weights control uses."""
        last = self.validation.groupby(["layout", "context_size"])["epoch"].transform("max")
        return self.validation[self.validation["epoch"] == last].reset_index(drop=True)

    def maps(self, layout: str | None = None) -> dict[int, Maps]:
        """Context size (above 0: there is no map without a code) -> affordance maps of the jobs of a layout.

        Without a layout: of all jobs' first one.
        """
        jobs = {size: self.job(size, layout=layout) for size in self.context_sizes if size > 0}
        return {size: self._read_maps(job.map) for size, job in jobs.items() if job}

    @property
    def growth_maps(self) -> Maps | None:
        """The maps of the longer training, with their snapshots."""
        return self._read_maps(self.growth.map) if self.growth else None

    @cached_property
    def _read_maps(self) -> Callable[[tuple[Path, ...]], Maps]:
        return cache(read_maps)

    @cached_property
    def exploration(self) -> Exploration:
        """Where the data set of the first job has been."""
        return _read_arrays(Exploration, self.jobs[0].data[0] / "coverage.npz")

    def map_world(self, job: Job) -> World:
        """The world whose maps a job has painted."""
        config = self.provenance[job.map[0]]["config"]
        return World.of(config["map_layout"], config["vehicle"])

    def training_worlds(self, job: Job) -> list[World]:
        """The worlds that a job's data come from."""
        config = self.provenance[job.data[0]]["config"]
        return [World.of(layout, config["vehicle"]) for layout in config["training_layouts"]]

    def worlds(self, job: Job) -> list[World]:
        """The world of each of a job's B runs."""
        vehicle = self.provenance[job.control[0]]["config"]["vehicle"]
        with guarded_read(job.control[0] / LAYOUTS):
            return [World.of(layout, vehicle) for layout in _read_layouts(job)]

    def sights(self, job: Job) -> list[Sight]:
        """What each of a job's B runs could see."""
        with guarded_read(job.control[0] / LAYOUTS):
            return [Sight.of(layout) for layout in _read_layouts(job)]

    def trajectories(self, job: Job) -> Trajectories:
        """What control recorded in one setting."""
        parts = [_read_arrays(Trajectories, folder / "trajectories.npz") for folder in job.control]
        return Trajectories(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    @cached_property
    def provenance(self) -> dict[Path, dict[str, Any]]:
        """Stage folder -> what it says about its origin; in the order of the stages."""
        return read_provenance([*self.jobs, *([self.growth] if self.growth else [])])


def join(jobs: Sequence[Job]) -> tuple[Job, ...]:
    """Put those jobs together that are one setting, whose members were divided among them; none is in two of them."""
    settings: dict[str, list[tuple[int, Job]]] = {}
    for job in jobs:
        configs = [_read_provenance(folder / PROVENANCE)["config"] for folder in (*job.map, *job.control)]
        rest = [{key: value for key, value in config.items() if key not in ("seed", "members")} for config in configs]
        settings.setdefault(canonical(rest), []).append((configs[-1]["seed"], job))
    return tuple(_joined(parts) for parts in settings.values())


def _joined(parts: Sequence[tuple[int, Job]]) -> Job:
    ordered = [job for _, job in sorted(parts, key=itemgetter(0))]
    first = ordered[0]
    # Parts share the data.
    folders = [tuple(dict.fromkeys(folder for job in ordered for folder in getattr(job, stage))) for stage in STAGES]
    return Job(first.context_size, first.planner, first.layout, *folders)


def read_provenance(jobs: Sequence[Job]) -> dict[Path, dict[str, Any]]:
    """Stage folder -> what it says about its origin; in the order of the stages."""
    folders = dict.fromkeys(folder for stage in STAGES for job in jobs for folder in getattr(job, stage))
    return {folder: _read_provenance(folder / PROVENANCE) for folder in folders}


def read_runs(job: Job) -> pd.DataFrame:
    """The runs of a job, one a row, columns `RUN_COLUMNS`."""
    table = pd.concat([_read_table(folder / "runs.csv", RUN_COLUMNS) for folder in job.control], ignore_index=True)
    return table.astype({"steps_to_reach": "Int64"})


def read_maps(folders: Sequence[Path]) -> Maps:
    """The affordance maps of all members."""
    parts = [_read_arrays(Maps, folder / "maps.npz") for folder in folders]
    return parts[0]._replace(
        codes=np.concatenate([part.codes for part in parts]),
        initial_codes=np.concatenate([part.initial_codes for part in parts]),
        snapshot_codes=np.concatenate([part.snapshot_codes for part in parts], axis=1 if len(parts[0].epochs) else 0),
        member=np.concatenate([part.member for part in parts]),
    )


def score_matrix(table: pd.DataFrame, metric: str, columns: Sequence[str] = ("context_size",)) -> pd.DataFrame:
    """Average a metric over the runs of each member: one row per member, one column per setting, ascending.

    A member that lacks a setting, or a number in one of its runs, has NaN there: no run is left out silently.
    """
    means = table.groupby(["member", *columns])[metric].agg(lambda scores: scores.astype(float).mean(skipna=False))
    return means.unstack(list(columns)).sort_index(axis=1)


def write_runs(folder: Path, experiment: str, runs: pd.DataFrame) -> None:
    """Write `runs.csv` into `folder`, with the name of the experiment as its first column."""
    runs = runs.copy()
    runs.insert(0, "experiment", experiment)
    write_csv(folder / "runs.csv", runs)


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table with the same bytes on every machine; its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, lineterminator="\n", encoding="utf-8")


def _read_layouts(job: Job) -> list[dict[str, Any]]:
    """The layout of each of a job's B runs."""
    return [layout for folder in job.control for layout in _read_json(folder / LAYOUTS)]


def _read_json(path: Path) -> Any:
    with guarded_read(path):
        return json.loads(path.read_text("utf-8"))


def _read_provenance(path: Path) -> dict[str, Any]:
    with guarded_read(path):
        record: dict[str, Any] = json.loads(path.read_text("utf-8"))
        for key in ("stage", "digest", "config"):
            record[key]
        return record


def _read_table(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    with guarded_read(path):
        table = pd.read_csv(path)
    missing = [column for column in columns if column not in table]
    if missing:
        raise ConfigError(
            f"{path} lacks the columns {missing}: another version wrote it; remove its folder and run again."
        )
    return table[list(columns)]


def _read_arrays(record: type[Record], path: Path) -> Record:
    found = read_arrays(path)
    with guarded_read(path):
        return record(**{field: found[field][()] for field in record._fields})
