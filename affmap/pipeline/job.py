"""The stages of a job, their completeness, and checks before they are made. Makes none of them."""

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

from affmap.config.root import Config
from affmap.config.sweep import Sweep
from affmap.control.registry import is_learned
from affmap.pipeline.stage import CONTROL, MAP, TRAIN, StageDefinition, control_of, stages_of
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Setting, Value
from affmap.settings import ConfigError
from affmap.store.provenance import canonical
from affmap.store.stage import Stage
from affmap.store.store import Store


def stages(config: Config) -> tuple[Stage, ...]:
    """The stages of a job, in order."""
    return tuple(stage.of(config) for stage in stages_of(config))


def all_stages(sweep: Sweep) -> list[Stage]:
    """All stages of a sweep, once each."""
    every = [stage for each in (sweep, *sweep.companions()) for config in each.configs for stage in stages(config)]
    return list({stage.digest: stage for stage in every}.values())


def open_store(config: Config) -> Store:
    """The store of a job's stages."""
    return Store(config.store, [config.reference] if config.models == "reference" else [], config.versions == "any")


def is_complete(config: Config) -> bool:
    """Whether all stages of a job are complete; their files are not verified."""
    store = open_store(config)
    return all(store.has(stage) for stage in stages(config))


def incomplete(config: Config, planned: Collection[StageDefinition]) -> list[StageDefinition]:
    """Those of a job's stages that are not complete."""
    store = open_store(config)
    return [stage for stage in planned if not store.has(stage.of(config))]


def find(config: Config, values: Mapping[str, Value] = MappingProxyType({})) -> Setting | None:
    """The stages of a job as a setting, or None if one is incomplete.

    Args:
        config: of the job.
        values: of the swept keys, besides context size, planner and layout.

    Raises:
        StoreError: a file is corrupted, or a stage was made with other versions of packages.
    """
    store = open_store(config)
    folders = [store.find(stage) for stage in stages(config)]
    complete = [folder for folder in folders if folder]
    return as_setting(config, complete, values) if len(complete) == len(folders) else None


def as_setting(config: Config, folders: Sequence[Path], values: Mapping[str, Value] = MappingProxyType({})) -> Setting:
    """The folders of a job's stages, in order, as a setting; `values` as in `find`."""
    names = [stage.name for stage in stages_of(config)]
    return Setting(all_values(config, values), {name: (folder,) for name, folder in zip(names, folders, strict=True)})


def all_values(config: Config, values: Mapping[str, Value]) -> dict[str, Value]:
    """The values by which a report knows a job's setting; `values` as in `find`."""
    common: dict[str, Value] = {
        CONTEXT_SIZE.key: config.model.context_size,
        PLANNER.key: config.controller,
        LAYOUT.key: config.control_layout.name,
    }
    return {**common, **values}


def agents_without_models(configs: Sequence[Config]) -> list[str]:
    """Kinds of agents that fly without a model, although models are to be trained for nothing but their reports."""
    used = {TRAIN.of(config).digest for config in configs if is_learned(config.agent)}
    idle = [config for config in configs if TRAIN.of(config).digest not in used]
    return sorted({config.agent.kind for config in idle if not open_store(config).has(TRAIN.of(config))})


def check_trials(config: Config) -> None:
    """Make sure that a job that paints maps and flies agents trains a single trial.

    Raises:
        ConfigError: it trains several.
    """
    if config.training.num_trials is not None:
        key, values = next(iter(config.training.per_trial.items()))
        raise ConfigError(
            f"training.{key} = {list(values)} makes a training of {len(values)} trials, which is validated only; "
            "give numbers to paint maps and fly agents."
        )


def check_models(config: Config) -> None:
    """Make sure that the reference run has the models of a job that uses them.

    Raises:
        ConfigError: it lacks them.
    """
    stage = TRAIN.of(config)
    if config.models == "reference" and not config.reference.exists():
        raise ConfigError(
            f"{config.reference} does not exist; a clone of the repository has it. Run the command there, or train the "
            "models with models=train."
        )
    if config.models == "reference" and not Store(config.reference).has(stage):
        raise ConfigError(
            f"{config.reference} holds no models of this configuration (stage train, {stage.digest}); "
            "train them with models=train, or undo the changes to them and to their data."
        )


def check_report(sweep: Sweep) -> None:
    """Make sure that the keys by which a report groups or compares exist; they need not vary in a part of a sweep.

    Those that the experiment sweeps over do, even if a command gives one value: groups such as `lookahead` are no keys
    of results.

    Raises:
        ConfigError: one of them does not.
    """
    swept = {key.replace("/", ".") for key in (*sweep.values[0], *sweep.first.sweep)}
    for name in ("compare", "x", "color"):
        key = getattr(sweep.first.report, name)
        if key is None or key in swept:
            continue
        if not _has(sweep.first.complete(), key):
            raise ConfigError(f"report.{name} = {key!r} is no key that results depend on; correct its spelling.")
        if name == "compare" and key.partition(".")[0] not in CONTROL.all_keys:
            raise ConfigError(
                f"report.compare = {key!r} is no key that runs of control depend on; those are keys of "
                f"{', '.join(CONTROL.all_keys)}."
            )


def _has(values: Any, key: str) -> bool:
    """Whether nested mappings have a dotted key."""
    first, _, rest = key.partition(".")
    return isinstance(values, Mapping) and first in values and (not rest or _has(values[first], rest))


def check_members(sweep: Sweep) -> None:
    """Make sure that each member of a setting is in one job only, since tables count it once.

    Raises:
        ConfigError: a member is in two jobs.
    """
    jobs: dict[str, list[tuple[range, str]]] = {}
    for config, label in zip(sweep.configs, sweep.labels, strict=True):
        rest = {*MAP.all_keys, *control_of(config).all_keys} - {"seed", "members"}
        jobs.setdefault(canonical(config.part(rest)), []).append((config.seeds, label))
    for same in jobs.values():
        for (one, label), (other, other_label) in pairwise(sorted(same, key=lambda job: job[0].start)):
            if one == other:
                remedy = _without(sweep, label, other_label)
                raise ConfigError(f"{label} and {other_label} have the same results; leave one of them out{remedy}.")
            if other.start < one.stop:
                raise ConfigError(
                    f"member {other.start} would be in two jobs (seed={one.start} members={len(one)} and "
                    f"seed={other.start} members={len(other)}); give each member to one, as members=5 seed=0,5,10 does."
                )


def _without(sweep: Sweep, label: str, other: str) -> str:
    """The end of a sentence on two jobs: the sweep without the second, if they differ in the values of one key only."""
    first, second = (sweep.values[sweep.labels.index(each)] for each in (label, other))
    different = [key for key in first if first[key] != second[key]]
    if len(different) != 1:
        return ""
    (key,) = different
    rest = dict.fromkeys(values[key] for values in sweep.values if values[key] != second[key])
    return f": {key}={','.join(rest)}"
