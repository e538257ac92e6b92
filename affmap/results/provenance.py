"""Provenance and cost of results: the provenance of their stages, without repetitions."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from affmap.env.effects import EFFECTS
from affmap.env.procedural import kind
from affmap.results.metrics import extra_metrics
from affmap.results.numbers import NOTHING, points
from affmap.results.setting import STAGES, Factor, Setting, make_factor
from affmap.results.tables import Results
from affmap.settings import extensions
from affmap.store.stage import Stage

_SHARED = ("versions", "git", "machine", "command")
"""Entries on which most stages of a sweep agree: their distinct values are listed once."""

_PLACEHOLDER = re.compile(r"\$\{([a-z_.]+)\}")


class Cost(NamedTuple):
    """Number and duration of the stages of one kind."""

    stage: str
    folders: int
    seconds: float


def summarize(settings: Sequence[Setting], records: Mapping[Path, dict[str, Any]]) -> dict[str, Any]:
    """The entries about stages in a report's `provenance.json`.

    Args:
        settings: completed ones.
        records: stage folder -> its own provenance, for the settings, growth and baselines.

    Returns:
        `seconds` (all stages together) and `peak_memory_mib` (of the largest process); the distinct values of
        `versions`, `git`, `machine` and `command`; `extensions`, where there are any, the origins of everything that is
        not of this package, metrics included (`affmap.settings.extensions.origins`); `configs`, the configuration of
        the first stage of each kind; `stages`, one entry per folder with the leaves in which its configuration
        `differs` from that one; `jobs`, the values of each setting and the digests of its stages.
    """
    configs: dict[str, dict[str, Any]] = {}
    stages: list[dict[str, Any]] = []
    for record in records.values():
        config = record.get("config", {})
        base = configs.setdefault(record["stage"], config)
        entry = {key: record.get(key) for key in ("stage", "digest", "started", "seconds", "peak_memory_mib")}
        if rules := record.get("rules"):
            entry |= {"rules": rules, "configuration": Stage(record["stage"], config).digest}
        stages.append({**entry, "differs": differences(config, base)})
    jobs = [
        {make_factor(key).column: value for key, value in setting.values.items()}
        | {stage: [records[folder]["digest"] for folder in folders] for stage, folders in setting.folders.items()}
        for setting in settings
    ]
    outside = distinct([each for record in records.values() for each in record.get("extensions", ())])
    outside += extensions.origins({"metric": extra_metrics()})
    return {
        "seconds": sum(stage["seconds"] or 0.0 for stage in stages),
        "peak_memory_mib": max(stage["peak_memory_mib"] or 0.0 for stage in stages),
        **{key: distinct([record.get(key) for record in records.values()]) for key in _SHARED},
        **({"extensions": outside} if outside else {}),
        "configs": configs,
        "stages": stages,
        "jobs": jobs,
    }


def config_of(record: Mapping[str, Any], digest: str) -> dict[str, Any]:
    """The configuration of a stage, from a summary by `summarize`."""
    stage = next(stage for stage in record["stages"] if stage["digest"] == digest)
    values = leaves(record["configs"][stage["stage"]]) | stage["differs"]
    config: dict[str, Any] = {}
    for key, value in values.items():
        if value is None:  # the first stage of this kind has it, and this one has not
            continue
        *groups, name = key.split(".")
        group = config
        for each in groups:
            group = group.setdefault(each, {})
        group[name] = value
    return config


def fill(template: str, reports: Sequence[Results]) -> list[tuple[str, str]]:
    """Fill values of the configuration into a Markdown list that names them as `${group.key}`.

    Of several reports the first with a value provides it. A point with an unknown value is left out: it is about
    something that was not run.
    """
    values: dict[str, Any] = {}
    for results in reports:
        for job in results.settings:
            config = results.provenance[job.control[0]]["config"]
            planner = {f"{job.planner}.{key}": value for key, value in config["planner"].items()}
            # A point about an effect is left out if no circle has it.
            layouts = [*config["training_layouts"], config["control_layout"]]
            names = [name for layout in layouts for name in kind(layout).model_validate(layout).effects]
            effects = {f"effect.{name}": EFFECTS[name].label for name in names}
            values = leaves(config) | planner | effects | values
    return [
        (title, _PLACEHOLDER.sub(lambda match: _format(values[match[1]]), text))
        for title, text in points(template)
        if all(key in values for key in _PLACEHOLDER.findall(text))
    ]


def _format(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def costs(reports: Sequence[Results]) -> list[list[Cost]]:
    """Per report and kind of stage: number of folders, and seconds in total.

    Folders of several reports are counted with the first.
    """
    earlier: set[Path] = set()
    tables = []
    made = {record["stage"] for results in reports for record in results.provenance.values()}
    for results in reports:
        records = [record for folder, record in results.provenance.items() if folder not in earlier]
        earlier |= results.provenance.keys()
        kinds = [stage for stage in STAGES if stage in made]
        tables.append([_cost(kind, [record for record in records if record["stage"] == kind]) for kind in kinds])
    return tables


def _cost(stage: str, records: Sequence[dict[str, Any]]) -> Cost:
    return Cost(stage, len(records), sum(record.get("seconds") or 0.0 for record in records))


def differences(config: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """The leaves of `config`, by dotted name, that are not those of `base`; None for leaves only `base` has."""
    own, others = leaves(config), leaves(base)
    names = sorted(own.keys() | others.keys())
    return {name: own.get(name) for name in names if own.get(name) != others.get(name)}


def leaves(config: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted name -> value, of all leaves of a configuration."""
    values: dict[str, Any] = {}
    for key, value in config.items():
        values |= leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return values


def distinct(values: Sequence[Any]) -> list[Any]:
    """The distinct values that are not None, in order of appearance; they need not be hashable."""
    return [value for index, value in enumerate(values) if value is not None and value not in values[:index]]


def setting_of(differs: dict[str, Any], factors: Sequence[Factor] = ()) -> str:
    """A short description of a stage by its main differences from the first of its kind."""
    names = {factor.key: factor.label for factor in factors} | {
        "model.context_size": "context size",
        "model.transition.kind": "transition",
        "agent.kind": "agent",
        "planner.kind": "planner",
        "lookup.spacing": "look-up",
        "control_layout.name": "flown in",
        "map_layout.name": "map of",
        "training.num_epochs": "epochs",
    }
    parts = [f"{name} {differs[key]}" for key, name in names.items() if differs.get(key) is not None]
    if "training_layouts" in differs:
        parts.insert(0, f"trained in {', '.join(layout['name'] for layout in differs['training_layouts'])}")
    return ", ".join(parts) or NOTHING
