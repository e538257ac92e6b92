"""Completed stages on disk -> tidy tables and arrays. Knows file formats, and neither tests, figures nor other modules.

Axes: M members, T recorded steps, B = M x 4 runs, H planning horizon, C context code, Y and X rows and columns of a
grid (row 0 has the smallest y). Lengths are in units (u), times in steps, likelihoods in nats (both coordinates summed,
constants included).
"""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from affmap.settings import ConfigError

PLANNERS = {"cem": "EB", "gradient": "GB"}
"""The paper's short names: evolutionary-based and gradient-based active inference."""

LAYOUTS = "layouts.json"
"""File of a control stage: the layout of each run."""

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
    "success",
    "steps_touching",
    "steps_in_fog",
    "final_spread",
    "crossable",
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
    layout: str
    """Name of the layout that was flown in."""
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
    """A layout; lengths in u, the lower left corner is the origin."""

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
    """Affordance maps of all members of one training."""

    codes: Floats
    """`[M, Y, X, C]` context codes at the nodes."""
    initial_codes: Floats
    """`[M, Y, X, C]`, the same before training."""
    snapshot_codes: Floats
    """`[E, M, Y, X, C]`, the same after E epochs of the training, the last one included; E is 0 where none was kept."""
    epochs: NDArray[np.integer]
    """`[E]`, numbers of those epochs."""
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
    def snapshots(self) -> "dict[int, Maps]":
        """Epoch -> the maps of the same members after it."""
        return {int(e): self._replace(codes=codes) for e, codes in zip(self.epochs, self.snapshot_codes, strict=True)}

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


class Exploration(NamedTuple):
    """Where the data set has been, in each of W training worlds."""

    counts: NDArray[np.integer]
    """`[W, Y, X]` recorded steps in each cell of 0.1 u."""
    free: NDArray[np.bool_]
    """`[W, Y, X]`: can the vehicle's centre be at the cell's centre?"""
    coverage: Floats
    """`[W]`, share of the free cells that were visited."""


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
    in_fog: NDArray[np.bool_]
    """`[B, T]`: did the vehicle overlap fog at the end of the step?"""
    reached: NDArray[np.bool_]
    """`[B, T]`: was it at the goal then?"""
    member: NDArray[np.integer]
    """`[B]`."""
    run: NDArray[np.integer]
    """`[B]`."""


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
        """The planners that were run, in the order of `PLANNERS`."""
        return [planner for planner in PLANNERS if any(job.planner == planner for job in self.jobs)]

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
            folders.setdefault(job.train, job)
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
        folders = {
            size: job.map
            for size in self.context_sizes
            if size > 0 and (job := self.job(size, layout=layout)) is not None
        }
        return {size: self._read_maps(folder) for size, folder in folders.items()}

    @property
    def growth_maps(self) -> Maps | None:
        """The maps of the longer training, with their snapshots."""
        return self._read_maps(self.growth.map) if self.growth else None

    @cached_property
    def _read_maps(self) -> Callable[[Path], Maps]:
        return cache(lambda folder: _read_arrays(Maps, folder / "maps.npz"))

    @cached_property
    def exploration(self) -> Exploration:
        """Where the data set of the first job has been."""
        return _read_arrays(Exploration, self.jobs[0].data / "coverage.npz")

    def map_world(self, job: Job) -> World:
        """The world whose maps a job has painted."""
        config = self.provenance[job.map]["config"]
        return _world(config["map_layout"], config["vehicle"])

    def training_worlds(self, job: Job) -> list[World]:
        """The worlds that a job's data come from."""
        config = self.provenance[job.data]["config"]
        return [_world(layout, config["vehicle"]) for layout in config["training_layouts"]]

    def worlds(self, job: Job) -> list[World]:
        """The world of each of a job's B runs."""
        config = self.provenance[job.control]["config"]
        layouts = json.loads((job.control / LAYOUTS).read_text("utf-8"))
        return [_world(layout, config["vehicle"]) for layout in layouts]

    def trajectories(self, job: Job) -> Trajectories:
        """What control recorded in one setting."""
        return _read_arrays(Trajectories, job.control / "trajectories.npz")

    @cached_property
    def provenance(self) -> dict[Path, dict[str, Any]]:
        """Stage folder -> what it says about its origin; in the order of the stages."""
        jobs = [*self.jobs, *([self.growth] if self.growth else [])]
        folders = dict.fromkeys(getattr(job, stage) for stage in STAGES for job in jobs)
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
