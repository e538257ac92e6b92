"""The completed settings of a sweep, for reports."""

import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from hydra.errors import HydraException

from affmap.config.notes import folders_with_notes, read_note
from affmap.config.root import Config
from affmap.config.sweep import Sweep
from affmap.pipeline.job import all_values, find, is_complete
from affmap.results.design import Design
from affmap.results.provenance import leaves
from affmap.results.setting import ALWAYS, PLANNER, Setting, Value
from affmap.results.tables import Results, join
from affmap.settings.messages import ConfigError, few


class IncompleteError(ConfigError):
    """Some settings of a sweep are not complete."""


class Completed(NamedTuple):
    """The completed settings of a sweep."""

    settings: tuple[Setting, ...]
    growth: Setting | None
    baselines: tuple[Setting, ...]
    """Settings of agents without a learned model."""
    missing: str
    """A sentence about incomplete settings; empty if there are none."""
    factors: tuple[str | None, str | None]
    """The keys on the x axis and by colour; None for one that follows from the settings."""

    def results(self, names: Mapping[str, str]) -> Results:
        """The results of these settings, grouped as the settings of the report say; `names` are its, for readers."""
        return Results(self.settings, self.growth, *self.factors, self.baselines, names)


def completed(sweep: Sweep) -> Completed:
    """The completed settings of a sweep; members that were divided among jobs are joined.

    Raises:
        IncompleteError: some settings are, and the report may not be partial; or none is complete.
        StoreError: a file is corrupted.
    """
    growth, baselines = sweep.growth(), sweep.baselines()
    settings, baseline_settings = _settings(sweep), _settings(baselines) if baselines else []
    growth_setting = find(growth.first) if growth else None
    every = list(zip(sweep.labels, settings, strict=True))
    if baselines:
        every += zip(baselines.labels, baseline_settings, strict=True)
    if growth:
        every.append((growth.first.name, growth_setting))
    labels = [label for label, setting in every if setting is None]
    sentence = f"{len(labels)} of {len(every)} settings are not complete ({few(labels, '; ')})" if labels else ""
    complete = [setting for setting in settings if setting]
    if labels and not (sweep.first.report.partial and complete):
        line = sweep.overrides or [f"name={sweep.first.name}"]  # without overrides nothing runs
        raise IncompleteError(f"{sentence}; run `affmap {shlex.join(line)}` first.")
    baseline_complete = [setting for setting in baseline_settings if setting]
    return Completed(_distinct(join(complete)), growth_setting, join(baseline_complete), sentence, _factors(sweep))


def report_problem(sweep: Sweep) -> str:
    """The reason why no report can be drawn of a sweep once it is complete; empty if there is none."""
    if sweep.first.report.compare:
        return ""
    planned = [all_values(config, values) for config, values in zip(sweep.configs, _values(sweep), strict=True)]
    distinct = {tuple(values.items()): Setting(values, {}) for values in planned}  # members may be divided among jobs
    try:
        Design(_distinct(list(distinct.values())), None, *_factors(sweep)).check_factors()
    except ConfigError as error:
        return str(error)
    return ""


def complete_elsewhere(sweep: Sweep) -> Path | None:
    """Another folder in `runs` with a sweep of the same experiment, perhaps of another scale, that is complete."""
    experiment = [line for line in sweep.overrides if line.startswith("experiment=")]
    for folder in folders_with_notes():
        with suppress(ConfigError, HydraException):  # of a note that cannot be read any more
            note = read_note(folder)
            if not experiment or experiment[0] not in note or folder.resolve() == sweep.first.output.resolve():
                continue
            other = Sweep.read(note)
            parts = (other, *other.companions())
            if other.first.output == folder and all(is_complete(config) for part in parts for config in part.configs):
                return folder
    return None


def _factors(sweep: Sweep) -> tuple[str | None, str | None]:
    """The keys of a report's x axis and colour; None for one of the experiment's sweep that is not swept over here."""
    left = {_dotted(key) for key in sweep.first.sweep.keys() - sweep.values[0]} - {factor.key for factor in ALWAYS}
    x, color = (None if key in left else key for key in (sweep.first.report.x, sweep.first.report.color))
    return x, color


def _settings(sweep: Sweep) -> list[Setting | None]:
    """The setting of each job, None where it is not complete."""
    return [find(config, values) for config, values in zip(sweep.configs, _values(sweep), strict=True)]


def _values(sweep: Sweep) -> list[dict[str, Value]]:
    """For each job the values of the swept keys: those of the configuration, else those of the command line.

    A group has its name or kind as its value, if that identifies its file, else the file's name.
    """
    keys = [key for key in sweep.values[0] if key not in ("seed", "members")]  # parts of a setting
    every: list[dict[str, Value]] = [{} for _ in sweep.configs]
    for key in keys:
        texts: list[Value] = [values[key] for values in sweep.values]
        typed = [_value(config, key) for config in sweep.configs]
        values: Sequence[Value | None] = typed if None not in typed and len(set(typed)) == len(set(texts)) else texts
        if key == PLANNER.key and any(config.controller != config.planner.kind for config in sweep.configs):
            values = [config.controller for config in sweep.configs]  # some agents do without a planner
        whole = all(isinstance(value, float) and value.is_integer() for value in values)  # 10 rather than 10.0
        for each, value in zip(every, values, strict=True):
            assert value is not None
            each[_dotted(key)] = int(value) if whole else value
    return every


def _dotted(key: str) -> str:
    """A key of the command line as a key of the configuration: Hydra names the group of a part `model/transition`."""
    return key.replace("/", ".")


def _distinct(settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """The settings, those of agents without a planner once only: they fly the same with any planner."""
    distinct: list[Setting] = []
    for setting in settings:
        planless = setting.values.get("agent") == setting.planner
        if not planless or all(setting.values != other.values for other in distinct):
            distinct.append(setting)
    return tuple(distinct)


def _value(config: Config, key: str) -> Value | None:
    """The value of a key; the name or kind of a group that has one, None for other groups."""
    values, key = leaves(config.complete()), _dotted(key)
    value = next((values[name] for name in (key, f"{key}.name", f"{key}.kind") if name in values), None)
    if isinstance(value, list):
        return " + ".join(str(each.get("name", each)) if isinstance(each, dict) else str(each) for each in value)
    return value
