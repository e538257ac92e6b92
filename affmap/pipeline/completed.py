"""The completed part of a sweep, as reports need it."""

import shlex
from collections.abc import Sequence
from typing import NamedTuple

from affmap.config.root import Config
from affmap.config.sweep import Sweep
from affmap.pipeline.job import find
from affmap.results.provenance import leaves
from affmap.results.setting import PLANNER, Setting, Value
from affmap.results.tables import join
from affmap.settings.messages import ConfigError


class Completed(NamedTuple):
    """The completed settings of a sweep."""

    settings: tuple[Setting, ...]
    growth: Setting | None
    baselines: tuple[Setting, ...]
    """Of agents without a learned model."""
    missing: str
    """A sentence about what is not complete; empty if all is."""


def completed(sweep: Sweep) -> Completed:
    """The completed settings of a sweep, members that were divided among jobs put together.

    Raises:
        ConfigError: some settings are not complete, and no partial report is wanted; or none is complete.
        StoreError: a file is damaged.
    """
    growth, baselines = sweep.growth(), sweep.baselines()
    settings, flown = _settings(sweep), _settings(baselines) if baselines else []
    grown = find(growth.first) if growth else None
    labels = [*sweep.labels, *(baselines.labels if baselines else [])]
    missing = [label for label, setting in zip(labels, [*settings, *flown], strict=True) if setting is None]
    if growth and grown is None:
        missing.append(growth.first.name)
    count = len(settings) + (growth is not None) + len(flown)
    sentence = f"{len(missing)} of {count} settings are not complete ({'; '.join(missing)})" if missing else ""
    complete = [setting for setting in settings if setting]
    if missing and not (sweep.first.report.partial and complete):
        raise ConfigError(f"{sentence}; run `affmap {shlex.join(sweep.overrides)}` first.")
    return Completed(_distinct(join(complete)), grown, join([each for each in flown if each]), sentence)


def _settings(sweep: Sweep) -> list[Setting | None]:
    """The setting of each job, None where it is not complete."""
    return [find(config, values) for config, values in zip(sweep.configs, _values(sweep), strict=True)]


def _values(sweep: Sweep) -> list[dict[str, Value]]:
    """The values of the keys that each job of a sweep varies: as the configuration has them, else as they were given.

    A group is told by the name or kind inside it, where that tells its files apart, else by the name of its file.
    """
    keys = [key for key in sweep.swept[0] if key not in ("seed", "members")]  # parts of a setting
    every: list[dict[str, Value]] = [{} for _ in sweep.configs]
    for key in keys:
        given: list[Value] = [swept[key] for swept in sweep.swept]
        found = [_value(config, key) for config in sweep.configs]
        values: Sequence[Value | None] = found if None not in found and len(set(found)) == len(set(given)) else given
        if key == PLANNER.key and any(config.controller != config.planner.kind for config in sweep.configs):
            values = [config.controller for config in sweep.configs]  # some agents do without a planner
        whole = all(isinstance(value, float) and value.is_integer() for value in values)  # 10 is said, and not 10.0
        for each, value in zip(every, values, strict=True):
            assert value is not None
            each[_dotted(key)] = int(value) if whole else value
    return every


def _dotted(key: str) -> str:
    """A key of the command line as a key of the configuration: Hydra names the group of a part `model/transition`."""
    return key.replace("/", ".")


def _distinct(settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """The settings, but those of agents without a planner only once: they fly the same whatever planner is named."""
    kept: list[Setting] = []
    for setting in settings:
        planless = setting.values.get("agent") == setting.planner
        if not planless or all(setting.values != other.values for other in kept):
            kept.append(setting)
    return tuple(kept)


def _value(config: Config, key: str) -> Value | None:
    """The value of a key; of a group with a name or a kind, that; None for another group."""
    values, key = leaves(config.complete()), _dotted(key)
    value = next((values[known] for known in (key, f"{key}.name", f"{key}.kind") if known in values), None)
    if isinstance(value, list):
        return " + ".join(str(each.get("name", each)) if isinstance(each, dict) else str(each) for each in value)
    return value
