"""Where the results come from: the stages' own provenance, once each, without what they repeat."""

import re
from typing import Any

from affmap.report.tables import STAGES, Results
from affmap.report.text import NOTHING

_SHARED = ("versions", "git", "machine", "command")
"""What most stages of a sweep agree on: its distinct values are listed once."""


def summarize(results: Results) -> dict[str, Any]:
    """Everything `provenance.json` says about the stages.

    Returns:
        `seconds` (all stages together) and `peak_memory_mib` (of the largest process); the distinct values of
        `versions`, `git`, `machine` and `command`; `configs`, the configuration of the first stage of each kind;
        `stages`, one entry per folder with the leaves in which its configuration `differs` from that one; and `jobs`,
        the digests of each setting's stages.
    """
    records = results.provenance
    configs: dict[str, dict[str, Any]] = {}
    stages: list[dict[str, Any]] = []
    for record in records.values():
        config = record.get("config", {})
        base = configs.setdefault(record["stage"], config)
        entry = {key: record.get(key) for key in ("stage", "digest", "started", "seconds", "peak_memory_mib")}
        stages.append({**entry, "differs": differences(config, base)})
    jobs = [
        {"context_size": job.context_size, "planner": job.planner}
        | {stage: records[getattr(job, stage)]["digest"] for stage in STAGES}
        for job in results.jobs
    ]
    return {
        "seconds": sum(stage["seconds"] or 0.0 for stage in stages),
        "peak_memory_mib": max(stage["peak_memory_mib"] or 0.0 for stage in stages),
        **{key: _distinct([record.get(key) for record in records.values()]) for key in _SHARED},
        "configs": configs,
        "stages": stages,
        "jobs": jobs,
    }


def fill(template: str, results: Results) -> str:
    """Put the values that were used into a text that names them as `${group.key}`; an en dash where one was not."""
    values: dict[str, Any] = {}
    for job in results.jobs:
        config = results.provenance[job.control]["config"]
        values = _leaves(config) | {f"{job.planner}.{key}": value for key, value in config["planner"].items()} | values
    pattern = re.compile(r"\$\{([a-z_.]+)\}")
    return pattern.sub(lambda match: _shown(values.get(match[1])), template)


def _shown(value: Any) -> str:
    return NOTHING if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def costs(results: Results) -> list[tuple[str, int, float]]:
    """Per kind of stage: its name, number of folders, and seconds in total."""
    rows = []
    for stage in STAGES:
        records = [results.provenance[folder] for folder in dict.fromkeys(getattr(job, stage) for job in results.jobs)]
        rows.append((stage, len(records), sum(record.get("seconds") or 0.0 for record in records)))
    return rows


def differences(config: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """The leaves of `config`, by dotted name, that are not those of `base`; None for leaves only `base` has."""
    leaves, base_leaves = _leaves(config), _leaves(base)
    names = sorted(leaves.keys() | base_leaves.keys())
    return {name: leaves.get(name) for name in names if leaves.get(name) != base_leaves.get(name)}


def _leaves(config: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, value in config.items():
        leaves |= _leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return leaves


def _distinct(values: list[Any]) -> list[Any]:
    """The distinct values in order of appearance; they need not be hashable."""
    found: list[Any] = []
    for value in values:
        if value is not None and value not in found:
            found.append(value)
    return found
