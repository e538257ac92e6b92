"""Completed stages on disk -> tidy tables and arrays. Knows file formats, and neither tests, figures nor other modules.

Axes: M members, T recorded steps, B = M x 4 runs, H planning horizon, C context code, Y and X rows and columns of a
grid (row 0 has the smallest y). Lengths are in units (u), times in steps, likelihoods in nats (both coordinates summed,
constants included).
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

PLANNERS = {"cem": "EB", "gradient": "GB"}
"""The paper's short names: evolutionary-based and gradient-based active inference."""

STAGES = ("data", "train", "map", "control")

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
    "steps_touching",
    "steps_in_fog",
    "lookup_error",
]
VALIDATION_COLUMNS = ["member", "epoch", "training_nll", "validation_nll"]

Floats = NDArray[np.floating]
Record = TypeVar("Record", bound="Maps | Exploration | Trajectories")


@dataclass(frozen=True)
class Job:
    """One setting of the sweep, and the folders of its completed stages."""

    context_size: int
    planner: str
    """`cem` (evolutionary, EB) or `gradient` (GB)."""
    data: Path
    train: Path
    map: Path
    control: Path

    def __post_init__(self) -> None:
        if self.planner not in PLANNERS:
            raise ValueError(f"planner is {self.planner!r}; the report knows {', '.join(PLANNERS)}")


class Circle(NamedTuple):
    """A circle of a world; lengths in u."""

    x: float
    y: float
    radius: float
    effect: str
    """`obstacle`, `fog`, `force_up`, `force_down` or `none`."""


@dataclass(frozen=True)
class World:
    """The layout that the vehicle flies in; lengths in u, the lower left corner is the origin."""

    name: str
    size: tuple[float, float]
    circles: tuple[Circle, ...]
    start_margin: float
    """Distance of the four start squares to the borders."""
    start_side: float
    """Side of a start square."""
    vehicle_radius: float

    @property
    def obstacles(self) -> tuple[Circle, ...]:
        """The circles that block the way."""
        return tuple(circle for circle in self.circles if circle.effect == "obstacle")


class Maps(NamedTuple):
    """Affordance maps of all members of one context size."""

    codes: Floats
    """`[M, Y, X, C]` context codes at the nodes."""
    initial_codes: Floats
    """`[M, Y, X, C]`, the same before training."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""
    member: NDArray[np.integer]
    """`[M]`."""

    @property
    def untrained(self) -> "Maps":
        """The maps of the same members before training."""
        return self._replace(codes=self.initial_codes)

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


class Exploration(NamedTuple):
    """Where the data set has been."""

    counts: NDArray[np.integer]
    """`[Y, X]` recorded steps in each cell of 0.1 u."""
    free: NDArray[np.bool_]
    """`[Y, X]`: can the vehicle's centre be at the cell's centre?"""
    coverage: float
    """Share of the free cells that were visited."""


class Trajectories(NamedTuple):
    """What control recorded; absolute positions in u."""

    position: Floats
    """`[B, T + 1, 2]`."""
    goal: Floats
    """`[B, 2]`."""
    planned_position: Floats
    """`[B, T, H, 2]` mean of the predicted positions at each step."""
    planned_std: Floats
    """`[B, T, H, 2]` standard deviation of the predicted positions (accumulated over the horizon)."""
    member: NDArray[np.integer]
    """`[B]`."""
    run: NDArray[np.integer]
    """`[B]`."""


@dataclass(frozen=True)
class Results:
    """Everything the report is made of; each stage folder is read once, when it is first asked for."""

    jobs: tuple[Job, ...]

    def __post_init__(self) -> None:
        settings = [(job.context_size, job.planner) for job in self.jobs]
        if not settings:
            raise ValueError("a report needs at least one job; no completed control stage was given")
        if len(set(settings)) < len(settings):
            raise ValueError(f"each (context_size, planner) may occur once in a report, got {settings}")

    @property
    def context_sizes(self) -> list[int]:
        """All context sizes, ascending."""
        return sorted({job.context_size for job in self.jobs})

    @property
    def planners(self) -> list[str]:
        """The planners that were run, in the order of `PLANNERS`."""
        return [planner for planner in PLANNERS if any(job.planner == planner for job in self.jobs)]

    def job(self, context_size: int, planner: str | None = None) -> Job | None:
        """The job of a setting (of any planner where none is given), or None where it was not run."""
        matches = (job for job in self.jobs if job.context_size == context_size and planner in (None, job.planner))
        return next(matches, None)

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per run of control, columns `RUN_COLUMNS`."""
        table = pd.concat([read_runs(job) for job in self.jobs])
        return table.sort_values(["context_size", "planner", "member", "run"], ignore_index=True)

    @cached_property
    def validation(self) -> pd.DataFrame:
        """One row per context size, member and epoch: `context_size`, then `VALIDATION_COLUMNS`."""
        folders = {job.train: job.context_size for job in self.jobs}
        tables = []
        for folder, context_size in folders.items():
            table = _read_table(folder / "validation.csv", VALIDATION_COLUMNS)
            table.insert(0, "context_size", context_size)
            tables.append(table)
        return pd.concat(tables).sort_values(["context_size", "member", "epoch"], ignore_index=True)

    @cached_property
    def last_epoch(self) -> pd.DataFrame:
        """`validation` at the last epoch of each context size, whose weights control uses."""
        last = self.validation.groupby("context_size")["epoch"].transform("max")
        return self.validation[self.validation["epoch"] == last].reset_index(drop=True)

    @cached_property
    def maps(self) -> dict[int, Maps]:
        """Context size (above 0: there is no map without a code) -> affordance maps."""
        folders = {job.context_size: job.map for job in self.jobs if job.context_size > 0}
        return {size: _read_arrays(Maps, folders[size] / "maps.npz") for size in sorted(folders)}

    @cached_property
    def exploration(self) -> Exploration:
        """Where the data set of the first job has been; the sweep shares one data set."""
        return _read_arrays(Exploration, self.jobs[0].data / "coverage.npz")

    @cached_property
    def world(self) -> World:
        """The world that all jobs were controlled in."""
        configs = [self.provenance[job.map]["config"] for job in self.jobs]
        layout = configs[0]["layout"]
        for config in configs[1:]:
            if config["layout"] != layout:
                raise ValueError(
                    f"a report is about one layout, got {layout['name']!r} and {config['layout']['name']!r}"
                )
        return _world(layout, configs[0]["vehicle"])

    def trajectories(self, context_size: int, planner: str) -> Trajectories | None:
        """What control recorded in one setting, or None where it was not run."""
        job = self.job(context_size, planner)
        return None if job is None else _read_arrays(Trajectories, job.control / "trajectories.npz")

    @cached_property
    def provenance(self) -> dict[Path, dict[str, Any]]:
        """Stage folder -> what it says about its origin; in the order of the stages."""
        folders = dict.fromkeys(getattr(job, stage) for stage in STAGES for job in self.jobs)
        return {folder: json.loads((folder / "provenance.json").read_text("utf-8")) for folder in folders}


def read_runs(job: Job) -> pd.DataFrame:
    """The runs of a job, one a row, columns `RUN_COLUMNS`."""
    return _read_table(job.control / "runs.csv", RUN_COLUMNS).astype({"steps_to_reach": "Int64"})


def score_matrix(table: pd.DataFrame, metric: str, columns: Sequence[str] = ("context_size",)) -> pd.DataFrame:
    """Average a metric over the runs of each member: one row per member, one column per setting, ascending.

    A member that lacks a setting, or a number in one of its runs, has NaN there: no run is left out silently.
    """
    means = table.groupby(["member", *columns])[metric].agg(lambda scores: scores.astype(float).mean(skipna=False))
    return means.unstack(list(columns)).sort_index(axis=1)


def write_runs(folder: Path, runs: pd.DataFrame) -> None:
    """Write `runs.csv` into `folder`, with the name of the experiment's folder as its first column."""
    runs = runs.copy()
    runs.insert(0, "experiment", folder.parent.name)
    write_csv(folder / "runs.csv", runs)


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table with the same bytes on every machine."""
    table.to_csv(path, index=False, lineterminator="\n", encoding="utf-8")


def _read_table(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    table = pd.read_csv(path)
    missing = [column for column in columns if column not in table]
    if missing:
        raise ValueError(
            f"{path} lacks the columns {missing}; it has {list(table)}. Was it written by another version?"
        )
    return table[list(columns)]


def _read_arrays(record: type[Record], path: Path) -> Record:
    with np.load(path, allow_pickle=False) as arrays:
        return record(**{field: arrays[field][()] for field in record._fields})


def _world(layout: dict[str, Any], vehicle: dict[str, Any]) -> World:
    circles: Iterable[dict[str, Any]] = layout["circles"]
    return World(
        name=layout["name"],
        size=(float(layout["size"][0]), float(layout["size"][1])),
        circles=tuple(Circle(c["center"][0], c["center"][1], c["radius"], c["effect"]) for c in circles),
        start_margin=float(layout["start_margin"]),
        start_side=float(layout["start_side"]),
        vehicle_radius=float(vehicle["radius"]),
    )
