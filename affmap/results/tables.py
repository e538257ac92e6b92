"""Tidy tables of completed settings, for reports: runs, losses, maps, trajectories; each stage is read once.

Lengths are in units (u), times in steps, likelihoods in nats (both coordinates summed, constants included).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

import pandas as pd

from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.results import files
from affmap.results.design import Design
from affmap.results.files import (
    LAYOUT_COLUMNS,
    STEP_COLUMNS,
    VALIDATION_COLUMNS,
    Blocks,
    Deviations,
    Experience,
    Exploration,
    Maps,
    Recall,
    Trajectories,
)
from affmap.results.metrics import PLACES, extra_metrics, run_metrics, stored_metrics, summarise
from affmap.results.setting import (
    CONTEXT_SIZE,
    FACTORS,
    LAYOUT,
    SPACING,
    STAGES,
    Factor,
    Setting,
)
from affmap.settings import ConfigError
from affmap.store.files import named_errors
from affmap.store.provenance import canonical


@dataclass(frozen=True)
class Results(Design):
    """The results of a sweep; each stage folder is read once, on first use."""

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per run of control: setting, all factors, place, metrics."""
        table = pd.concat([self._with_factors(read_runs(setting), setting) for setting in self.settings])
        order = ["context_size", "planner", "layout", *self._own_columns, "member", "run"]
        places = {value: place for place, value in enumerate(self.x_values)}
        if all(not isinstance(value, str) for value in places):
            return table.sort_values(order, ignore_index=True)
        x = self.x.column  # its names have no order of their own
        order = [x, *(column for column in order if column != x)]
        return table.sort_values(
            order, key=lambda column: column.map(places) if column.name == x else column, ignore_index=True
        )

    @cached_property
    def baseline_runs(self) -> pd.DataFrame:
        """One row per run of agents without a learned model, as `runs`; the agent is in the column `planner`.

        A factor that they are swept over, too, has its column, as in `runs`.
        """
        if not self.baselines:
            return self.runs.iloc[:0]
        own = [factor for factor in self.factors if factor.key not in FACTORS]
        shared = [factor for factor in own if factor.key in self.baselines[0].values]
        table = pd.concat(
            [
                read_runs(setting).assign(**{factor.column: setting.values[factor.key] for factor in shared})
                for setting in self.baselines
            ],
            ignore_index=True,
        )
        return table.drop(columns=[CONTEXT_SIZE.column, SPACING.column])

    @property
    def _own_columns(self) -> list[str]:
        """Columns of factors that the table of a control stage lacks."""
        return [factor.column for factor in self.factors if factor.key not in FACTORS]

    def _with_factors(self, table: pd.DataFrame, setting: Setting) -> pd.DataFrame:
        """Add the columns of factors that a table of runs lacks."""
        for factor in self.factors:
            if factor.key not in FACTORS:
                table.insert(list(table).index("member"), factor.column, setting.values[factor.key])
            elif factor in (self.x, self.color) and factor.key in setting.values:
                table[factor.column] = setting.values[factor.key]
        return table

    @cached_property
    def validation(self) -> pd.DataFrame:
        """One row per training, member and epoch: `layout`, `context_size`, then `VALIDATION_COLUMNS`.

        `layout` is the first one in which the models of that training fly. Another factor has a column, too, if each
        training has a single value of it.
        """
        trainings: dict[Path, Setting] = {}
        for setting in self.settings:
            for folder in setting.train:
                trainings.setdefault(folder, setting)
        own = [factor for factor in self.factors if factor.key not in FACTORS and self._is_trained(factor)]
        tables = []
        for folder, setting in trainings.items():
            table = files.read_validation(folder).assign(layout=setting.layout, context_size=setting.context_size)
            tables.append(table.assign(**{factor.column: setting.values[factor.key] for factor in own}))
        keys = ["layout", "context_size", *(factor.column for factor in own)]
        table = pd.concat(tables)[[*keys, *VALIDATION_COLUMNS]]
        return table.sort_values([*keys, "member", "epoch"], ignore_index=True)

    @cached_property
    def steps(self) -> pd.DataFrame:
        """Validation losses by kind of step, one row per training, member, epoch, training layout and kind.

        The columns `trainings`, then `STEP_COLUMNS`.
        """
        first: dict[Path, tuple[Path, Setting]] = {}
        for setting in self.settings:
            for train, predict in zip(setting.train, setting.predict, strict=True):
                first.setdefault(train, (predict, setting))
        keys = {LAYOUT.column: LAYOUT.key, CONTEXT_SIZE.column: CONTEXT_SIZE.key}
        keys |= {factor.column: factor.key for factor in self.factors if factor.column in self.trainings}
        tables = [
            files.read_steps(folder).assign(**{column: setting.values[key] for column, key in keys.items()})
            for folder, setting in first.values()
        ]
        table = pd.concat(tables)[[*self.trainings, *STEP_COLUMNS]]
        return table.sort_values([*self.trainings, "member", "epoch"], kind="stable", ignore_index=True)

    def deviations(self, setting: Setting) -> Deviations:
        """The deviations predicted by the models of a setting at the nodes of its map."""
        return files.read_deviations(setting.predict)

    def blocks(self, setting: Setting) -> Blocks:
        """The effects of the blocks of a setting's first member; only of models whose codes have blocks."""
        return files.read_blocks(setting.blocks[0])

    def shares(self, setting: Setting) -> pd.DataFrame:
        """The shares of blocks in what all do, of all members of such a setting, columns `SHARE_COLUMNS`."""
        return pd.concat([files.read_shares(folder) for folder in setting.blocks], ignore_index=True)

    def _is_trained(self, factor: Factor) -> bool:
        """Whether each training has a single value of a factor."""
        pairs = {(folder, setting.values[factor.key]) for setting in self.settings for folder in setting.train}
        return len(pairs) == len({folder for folder, _ in pairs})

    @property
    def trainings(self) -> list[str]:
        """Columns of `validation` that identify a training."""
        return [str(column) for column in self.validation if column not in VALIDATION_COLUMNS]

    @property
    def training_factor(self) -> Factor:
        """The grouping variable of trainings in a picture: that of the x axis, or the context size."""
        return self.x if self.x.column in self.trainings else CONTEXT_SIZE

    @cached_property
    def last_epoch(self) -> pd.DataFrame:
        """`validation` at the last epoch of each training, whose weights control uses."""
        last = self.validation.groupby(self.trainings)["epoch"].transform("max")
        return self.validation[self.validation["epoch"] == last].reset_index(drop=True)

    def maps(self, layout: str | None = None) -> dict[int, Maps]:
        """Context size -> affordance maps of the first setting (in a layout) with it; there is no map of size 0."""
        settings = {size: self.setting(size, layout=layout) for size in self.context_sizes if size > 0}
        return {size: self.read_maps(setting) for size, setting in settings.items() if setting}

    def read_maps(self, setting: Setting) -> Maps:
        """The affordance maps of a setting."""
        return self._read_maps(setting.map)

    @property
    def growth_maps(self) -> Maps | None:
        """The maps of the longer training, with their snapshots."""
        return self.read_maps(self.growth) if self.growth else None

    @cached_property
    def _read_maps(self) -> Callable[[tuple[Path, ...]], Maps]:
        return cache(files.read_maps)

    def exploration(self, setting: Setting) -> Exploration:
        """Places visited by the data set of a setting."""
        return files.read_coverage(setting.data[0])

    def experience(self, setting: Setting) -> Experience | None:
        """Places of the agents of a setting that learn online; None where they learned offline."""
        kept = [(folder / files.EXPERIENCE).is_file() for folder in setting.train]
        return files.read_experience(setting.train) if all(kept) else None

    def recall(self, setting: Setting) -> Recall | None:
        """The memorised maps of a setting; None where codes are looked up in views."""
        kept = [(folder / files.RECALL).is_file() for folder in setting.control]
        return files.read_recall(setting.control) if all(kept) else None

    def map_layout(self, setting: Setting) -> Layout:
        """The layout of a setting's maps."""
        return Layout.model_validate(self.provenance[setting.map[0]]["config"]["map_layout"])

    def training_layouts(self, setting: Setting) -> list[Layout]:
        """The layouts of a setting's data."""
        return [Layout.model_validate(each) for each in self.provenance[setting.data[0]]["config"]["training_layouts"]]

    def run_layouts(self, setting: Setting) -> list[Layout]:
        """The layout of each of a setting's B runs."""
        return [layout for folder in setting.control for layout in self._read_layouts(folder)]

    def has_own_layouts(self, setting: Setting | None = None) -> bool:
        """Whether the runs of a setting (by default of any) have layouts of their own, rather than share one."""
        return any(len(set(self.run_layouts(each))) > 1 for each in ([setting] if setting else self.settings))

    @cached_property
    def _read_layouts(self) -> Callable[[Path], list[Layout]]:
        return cache(files.read_layouts)

    def vehicle(self, setting: Setting) -> Vehicle:
        """The vehicle of a setting."""
        return Vehicle.model_validate(self.provenance[setting.control[0]]["config"]["vehicle"])

    def vehicle_radius(self, setting: Setting) -> float:
        """Radius of the vehicle of a setting, u."""
        return float(self.provenance[setting.control[0]]["config"]["vehicle"]["radius"])

    def trajectories(self, setting: Setting) -> Trajectories:
        """Recorded runs of a setting."""
        return files.read_trajectories(setting.control)

    @cached_property
    def provenance(self) -> dict[Path, dict[str, Any]]:
        """Stage folder -> its provenance, in the order of the stages."""
        return read_provenance([*self.settings, *([self.growth] if self.growth else []), *self.baselines])


def join(settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """Join settings whose members were divided among jobs; no member is in two of them."""
    parts: dict[str, list[tuple[int, Setting]]] = {}
    for setting in settings:
        configs = [files.read_origin(folder)["config"] for folder in (*setting.map, *setting.control)]
        rest = [{key: value for key, value in config.items() if key not in ("seed", "members")} for config in configs]
        parts.setdefault(canonical(rest), []).append((configs[-1]["seed"], setting))
    return tuple(_joined(part) for part in parts.values())


def _joined(parts: Sequence[tuple[int, Setting]]) -> Setting:
    ordered = [setting for _, setting in sorted(parts, key=itemgetter(0))]
    folders = {
        stage: tuple(dict.fromkeys(folder for setting in ordered for folder in setting.folders[stage]))  # data: shared
        for stage in ordered[0].folders
    }
    return Setting(ordered[0].values, folders)


def read_provenance(settings: Sequence[Setting]) -> dict[Path, dict[str, Any]]:
    """Stage folder -> its provenance, in the order of the stages."""
    folders = [folder for stage in STAGES for setting in settings for folder in setting.folders.get(stage, ())]
    return {folder: files.read_origin(folder) for folder in dict.fromkeys(folders)}


def read_runs(setting: Setting) -> pd.DataFrame:
    """The runs of a setting, a row each, a column per metric; those that a stored table lacks are computed."""
    return pd.concat([_read_runs(folder) for folder in setting.control], ignore_index=True)


def _read_runs(folder: Path) -> pd.DataFrame:
    before, after = [*(factor.column for factor in FACTORS.values()), *PLACES], LAYOUT_COLUMNS
    table = files.read_runs(folder, [*before, *after])
    if columns := [column for column in run_metrics() if column not in table]:
        table = table.join(summarise(files.read_trajectories([folder]), columns).round(6))  # as stored ones
    return table[[*before, *stored_metrics(), *after, *extra_metrics()]].astype({"steps_to_reach": "Int64"})


def score_matrix(table: pd.DataFrame, metric: str, columns: Sequence[str] = ("context_size",)) -> pd.DataFrame:
    """Average a metric over the runs of each member: one row per member, one column per setting, ascending.

    A member that lacks a setting, or a number in one of its runs, has NaN there: no run is dropped silently.
    """
    if lacking := [column for column in (metric, *columns) if column not in table]:
        raise ConfigError(f"the runs have no column {lacking[0]!r}; they have {', '.join(map(str, table.columns))}.")
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
    with named_errors(path):
        table.to_csv(path, index=False, lineterminator="\n", encoding="utf-8")
