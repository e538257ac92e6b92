"""Trained agents, from a run, from the reference run that comes with the package, or from a folder of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from affmap.control import saved
from affmap.control.agent import Agent, ControlSettings
from affmap.control.episodes import bring
from affmap.env.body import Vehicle
from affmap.env.procedural import first_layout
from affmap.model.lookup import LookupSettings, make_lookup
from affmap.model.stack import ModelSettings, Stack
from affmap.model.weights import WEIGHTS, restore
from affmap.planning.planner import Planner, is_planner
from affmap.planning.registry import AnyPlanner
from affmap.results import manifest, provenance
from affmap.results.files import VALIDATION, read_validation
from affmap.results.setting import make_factor
from affmap.settings import ConfigError, Settings
from affmap.settings.changes import changed
from affmap.settings.messages import format_value
from affmap.store.stage import check_file
from affmap.threads import limited


def load(
    source: str | Path = "exp1",
    *,
    context_size: int | None = None,
    members: Sequence[int] | Literal["all"] | None = None,
    planner: Planner | Mapping[str, Any] | str | None = None,
    layout: str | None = None,
    transition: str | None = None,
    threads: int = 1,
) -> Agent:
    """Load a trained agent in the world that it flew in; `fly` and `Pilot` take it anywhere.

    Args:
        source: the folder of an experiment's report, such as `runs/exp1`, with its store beside it; or the name of an
            experiment of the reference run, such as `exp5` (an installed package has only a part of it); or the
            folder of an agent that was saved (`Agent.save`).
        context_size: C, of those that the experiment has, by default 8; that of a saved agent.
        members: seeds of the members to load, of M, or `all`; by default the first of an experiment, and all of a saved
            agent.
        planner: any planner; or the name of a file of `conf/planner`; or changes of the default, such as
            `{"num_iterations": 5}`, which is that of the first job, or a saved agent's own.
        layout: the name of a layout, of those that the experiment flew in; by default the first. (The two conditions of
            Experiment III have different models.) A saved agent can be brought into any layout.
        transition: the transition model, such as `gru`, of those that the experiment has, or the name of how it learns
            (`conf/learner`, `conf/learning`), or its name in the report; by default the first. (In `exp6_radii` that is
            `mlp_one_radius`, the paper's model trained with circles of one radius, in `exp8` `offline`.) The rivals of
            `exp10` are no agents, and have none; `affmap rival=...` trains and flies them. Agents of `exp9_map` look
            into views here; `affmap memory=...` gives them their maps.
        threads: of PyTorch, for the affordance map.

    Raises:
        ConfigError: there is no such report, context size, layout, transition model, member or planner; the message
            says what there is.
        StoreError: the weights are corrupted.
    """
    if not isinstance(source, str | Path) or source == "":
        raise ConfigError(
            f"source = {format_value(source)} is not allowed; give a folder, or the name of an experiment, such as "
            "'exp1'."
        )
    every = isinstance(members, str) and members == "all"
    members = None if members is None or every else _members(members)
    if saved.is_saved(Path(source)):
        with limited(threads):
            return _load_saved(Path(source), context_size, members, planner, layout, transition)
    context_size = 8 if context_size is None else context_size
    report = _report(source)
    record = manifest.read(report)
    job = _job(record, report, source, context_size, layout, transition)
    config = provenance.config_of(record, job["control"][0])
    if members is None:
        trained = provenance.config_of(record, job["train"][0])
        members = range(trained["seed"], trained["seed"] + (trained["members"] if every else 1))
    stack, losses = read_members(report.parent / "store" / "train", source, job["train"], members)
    first = first_layout(config["control_layout"], members[0])
    with limited(threads):
        lookup = make_lookup(LookupSettings.model_validate(config["lookup"]), stack, [first.map])
    return Agent(
        stack,
        lookup,
        _planner(planner, config["planner"]),
        ControlSettings.model_validate({"device": "cpu", **config["control"]}),
        first.channels,
        Vehicle.model_validate(config["vehicle"]),
        losses,
    )


def _members(given: Any) -> tuple[int, ...]:
    """Seeds of members.

    Raises:
        ConfigError: they are no seeds, or there are none, or one is named twice.
    """
    seeds: list[Any] = [*given] if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) else [None]
    if not all(isinstance(each, int | np.integer) and not isinstance(each, bool) for each in seeds):
        raise ConfigError(
            f"members = {format_value(given)} is not allowed; give the seeds of members, such as (0, 1, 2), or 'all'."
        )
    if not seeds:
        raise ConfigError(f"members = {format_value(given)} is not allowed; give at least one seed, such as (0,).")
    if len({*seeds}) < len(seeds):
        raise ConfigError(f"members = {format_value(given)} names a member twice; give each seed once.")
    return tuple(int(seed) for seed in seeds)


def _load_saved(
    folder: Path,
    context_size: int | None,
    members: Sequence[int] | None,
    planner: Planner | Mapping[str, Any] | str | None,
    layout: str | None,
    transition: str | None,
) -> Agent:
    """Load a saved agent; arguments and errors as of `load`."""
    agent = saved.load(folder, members)
    settings = agent.stack.settings
    if context_size not in (None, settings.context_size):
        raise ConfigError(f"{folder} has models of the context size {settings.context_size}, none of {context_size}.")
    if transition not in (None, settings.transition.kind):
        kind = settings.transition.kind
        raise ConfigError(f"{folder} has transition models of the kind {kind}; none is {transition!r}.")
    if planner is not None:
        agent.planner = _planner(planner, dict(agent.planner) if isinstance(agent.planner, Settings) else {})
    if layout is None:
        return agent
    brought = bring(agent, first_layout(layout, agent.seeds[0]))
    assert isinstance(brought, Agent)
    return brought


def reference() -> Path:
    """Folder of the reference run: inside an installed package, or in `runs` of a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "reference"
    return inside if inside.is_dir() else package.parent / "runs" / "reference"


def experiments() -> list[str]:
    """Names of the reference run's experiments."""
    return sorted(path.parent.name for path in reference().glob("exp*/provenance.json"))


class Origin(NamedTuple):
    """Models and flights of an experiment."""

    context_sizes: list[int]
    """C of the available models, ascending."""
    planner: str
    """Kind of the first planner."""
    layout: str
    """Name of the first layout of control."""
    channels: tuple[str, ...]
    """Names of the K channels that its models see."""
    vehicle: Vehicle
    """The first vehicle."""


def origin(source: str | Path) -> Origin:
    """Models and flights of an experiment, from which `load` makes agents.

    Raises:
        ConfigError: there is no such report.
    """
    report = _report(source)
    record = manifest.read(report)
    jobs = record["jobs"]
    there = {job["context_size"] for job in jobs if all(_weights(report, digest).is_file() for digest in job["train"])}
    channels = record["configs"]["data"]["training_layouts"][0]["channels"]
    config = provenance.config_of(record, jobs[0]["control"][0])
    planner = config["planner"]["kind"]  # even if another agent flew
    vehicle = Vehicle.model_validate(config["vehicle"])
    return Origin(sorted(there), planner, jobs[0]["layout"], tuple(channels), vehicle)


def _weights(report: Path, digest: str) -> Path:
    return report.parent / "store" / "train" / digest / WEIGHTS


def _report(source: str | Path) -> Path:
    for folder in (Path(source), reference() / source):
        if "jobs" in manifest.read(folder):
            return folder
    if source in {path.parent.name for path in Path(__file__).parents[1].glob("experiments/exp*/claims.py")}:
        raise ConfigError(
            f"the models of {source} are not here: an installed package has only some of {', '.join(experiments())}; "
            "a clone of the repository has all."
        )
    folder, names = Path(source), ", ".join(experiments())
    if not folder.exists():
        raise ConfigError(f"{source} does not exist, and is none of the reference run's experiments, {names}.")
    if saved.is_saved(folder):
        raise ConfigError(
            f"{source} is a saved agent, where an experiment is wanted; give the folder of its report, or one of the "
            f"reference run's experiments, {names}."
        )
    if (folder / WEIGHTS).is_file():
        raise ConfigError(
            f"{source} has {WEIGHTS}, but {saved.AGENT} is missing, without which it is no saved agent; restore it."
        )
    raise ConfigError(
        f"{source} is neither the folder of an experiment's report, nor that of a saved agent, nor one of the "
        f"reference run's experiments, {names}."
    )


def _job(
    record: Mapping[str, Any],
    report: Path,
    source: str | Path,
    context_size: int,
    layout: str | None,
    transition: str | None,
) -> dict[str, Any]:
    """First setting with a context size and, unless None, a layout and a transition model.

    `source` is the user's name of the report.
    """
    sizes = origin(report).context_sizes
    if not sizes:
        raise ConfigError(f"{source} has no models: its store, {report.parent / 'store'}, is not there.")
    if context_size not in sizes:
        raise ConfigError(
            f"{source} has models of the context sizes {sizes}, and none of {format_value(context_size)}."
        )
    layouts = list(dict.fromkeys(job["layout"] for job in record["jobs"]))
    if layout not in (None, *layouts):
        raise ConfigError(f"{source} has flights in {', '.join(layouts)}, and none in {layout!r}.")
    jobs = [job for job in record["jobs"] if job["context_size"] == context_size and layout in (None, job["layout"])]
    if transition is None:
        return jobs[0]
    kinds = [_transition(record, job) for job in jobs]
    readable = record.get("settings", {}).get("names", {})
    shown = {kind: readable.get(kind, kind) for kind in kinds}  # as in the report
    for names in (kinds, [shown[kind] for kind in kinds]):
        if transition in names:
            return jobs[names.index(transition)]
    listed = [kind + (f" ({name})" if name.lower() != kind else "") for kind, name in shown.items()]
    rivals = list(dict.fromkeys(job["planner"] for job in jobs if "policy" in job))
    policies = f" Its rivals, {', '.join(rivals)}, are policies without one: affmap rival=... trains and flies them."
    raise ConfigError(
        f"{source} has the transition models {', '.join(listed)}; none is {transition!r}.{policies if rivals else ''}"
    )


def _transition(record: Mapping[str, Any], job: Mapping[str, Any]) -> str:
    """Name by which a sweep chose a setting's transition models, or how they learn; their kind if it had no choice."""
    for key in ("model.transition", "learner", "learning"):
        if name := job.get(make_factor(key).column):
            return str(name)
    values = provenance.config_of(record, job["train"][0])["model"]
    return ModelSettings.checked(values, "the configuration of the models").transition.kind


def read_members(
    store: Path, source: str | Path, digests: Sequence[str], members: Sequence[int]
) -> tuple[Stack, pd.DataFrame | None]:
    """Load members of a training, or of one of the trainings that its members were divided among.

    Their losses are None in an installed package, which has only the weights.

    Args:
        store: the folder of all trainings.
        source: the user's name of these.
        digests: of the trainings.
        members: their seeds.

    Raises:
        ConfigError: no training has all of these members.
        StoreError: the weights are corrupted.
    """
    all_seeds: list[int] = []
    for digest in digests:
        folder = store / digest
        config = check_file(folder, WEIGHTS)["config"]
        seeds = range(config["seed"], config["seed"] + config["members"])
        if all(member in seeds for member in members):
            settings = ModelSettings.checked(config["model"], str(folder))
            whole = Stack(settings, len(config["training_layouts"][0]["channels"]), seeds)
            stack = restore(whole, folder / WEIGHTS).select([seeds.index(member) for member in members])
            if not (folder / VALIDATION).is_file():
                return stack, None
            check_file(folder, VALIDATION)
            return stack, read_validation(folder, members)
        all_seeds += seeds
    raise ConfigError(
        f"members = {[*members]} is not allowed: {source} has {all_seeds}"
        f"{', and those of one job only can fly together' if len(digests) > 1 else ''}."
    )


def _planner(planner: Planner | Mapping[str, Any] | str | None, default: Mapping[str, Any]) -> Planner:
    if is_planner(planner):
        return planner
    origin = f"conf/planner/{planner}.yaml" if isinstance(planner, str) else "load" if planner else "the report"
    return _Planning.checked({"planner": changed("planner", default, planner)}, origin).planner


class _Planning(Settings):
    """The part of a configuration with the planner."""

    planner: AnyPlanner
