"""Agents as folders: weights as safetensors, losses as CSV, everything else as JSON, so that reading executes nothing.

`agent.json` has a checksum of its own and the digests of the other files. A folder is written beside its place and
renamed.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from affmap.control import arguments
from affmap.control.agent import Agent, ControlSettings
from affmap.env.body import Vehicle
from affmap.model.lookup import AffordanceMap, ExactLookup, LookupSettings, make_lookup
from affmap.model.stack import ModelSettings, Stack
from affmap.model.weights import WEIGHTS, copy, restore
from affmap.model.weights import save as save_weights
from affmap.planning.registry import AnyPlanner
from affmap.results.files import VALIDATION, read_validation, write_validation
from affmap.settings import ConfigError, Count, Line, Seed, Settings
from affmap.store.files import guarded_read, read_json, replace_folder, sha256, write_json
from affmap.store.provenance import has_valid_checksum, versions, with_checksum
from affmap.store.stage import StoreError
from affmap.view import VisibleLayout

AGENT = "agent.json"
"""File of a saved agent that holds all but its weights and the losses of its training."""

FILES = (AGENT, WEIGHTS, VALIDATION)
"""All files that a saved agent may have; without known losses, the last one is not there."""


class _Record(Settings):
    """All of an agent but its weights and losses."""

    seeds: tuple[Seed, ...]
    num_channels: Count
    channels: tuple[Line, ...] | None
    model: ModelSettings
    lookup: LookupSettings
    world: VisibleLayout
    planner: AnyPlanner
    control: ControlSettings
    vehicle: Vehicle | None


def save(agent: Agent, folder: str | Path) -> None:
    """Write an agent into a folder; see `Agent.save`."""
    place = arguments.folder(folder).resolve()  # of a link
    _check_replaceable(place)
    record = _record(agent)
    new = place.with_name(f".{place.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    try:
        new.mkdir(parents=True)
    except OSError as error:
        raise ConfigError(f"{place} cannot be made ({error.strerror}); save the agent in another folder.") from None
    try:
        save_weights(copy(agent.stack), new / WEIGHTS)
        if agent.losses is not None:
            write_validation(new, agent.losses)
        files = {path.name: sha256(path) for path in new.iterdir()}
        write_json(new / AGENT, with_checksum({"agent": record.plain, "versions": versions(), "files": files}))
        _check_transition(agent.stack, _read(new)[1])
        replace_folder(new, place)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def is_saved(folder: Path) -> bool:
    """Whether a folder holds a saved agent."""
    return (folder / AGENT).is_file()


def load(folder: Path, members: Sequence[int] | None = None) -> Agent:
    """Read the agent of a folder, with the members of some seeds, or with all.

    Raises:
        StoreError: a file of it is corrupted.
        ConfigError: it has no such member; or this version of affmap, or this machine, cannot read it: it may have a
            planner of another package.
    """
    record, stack = _read(folder)
    if members is not None:
        if not {*members} <= {*stack.seeds}:
            raise ConfigError(f"members = {[*members]} is not allowed: {folder} has {[*stack.seeds]}.")
        stack = stack.select([stack.seeds.index(member) for member in members])
    losses = read_validation(folder, members) if (folder / VALIDATION).is_file() else None
    lookup = make_lookup(record.lookup, stack, [record.world])
    return Agent(stack, lookup, record.planner, record.control, record.channels, record.vehicle, losses)


def _read(folder: Path) -> tuple[_Record, Stack]:
    """All of an agent but its losses, once every file of its folder is verified; see `load`."""
    path = folder / AGENT
    content = _verified(folder)
    with guarded_read(path):
        values = content["agent"]
        record = _Record.checked({**values, "control": {"device": "cpu", **values["control"]}}, str(path))
        return record, restore(Stack(record.model, record.num_channels, record.seeds), folder / WEIGHTS)


def _verified(folder: Path) -> dict[str, Any]:
    """The content of `agent.json`.

    Raises:
        StoreError: a file is missing, cannot be read, or is not as it was saved; the message names it.
    """
    try:
        content = _content(folder / AGENT)
        actual = {name: sha256(folder / name) for name in FILES[1:] if (folder / name).exists()}
    except OSError as error:
        raise StoreError(f"{error.filename} cannot be read ({error.strerror}); restore it.") from None
    for name in FILES[1:]:
        if actual.get(name) != content["files"].get(name):
            fault = "is not as it was saved" if name in actual else "is missing"
            raise StoreError(f"{folder / name} {fault}; restore it.")
    return content


def _content(path: Path) -> dict[str, Any]:
    """The content of `agent.json`.

    Raises:
        OSError: it cannot be read.
        StoreError: it is not as it was saved.
    """
    try:
        content = read_json(path)
    except ValueError:
        content = None
    if not isinstance(content, dict) or not has_valid_checksum(content) or not isinstance(content.get("files"), dict):
        raise StoreError(f"{path} is not as it was saved; restore it.")
    return content


def _record(agent: Agent) -> _Record:
    """All of an agent but its weights.

    Raises:
        ConfigError: its planner or its look-up has no settings, or it is in several worlds.
    """
    lookup, planner = agent.lookup, agent.planner
    if isinstance(lookup, AffordanceMap):
        settings = {"spacing": lookup.spacing, "differentiable": lookup.differentiable}
    elif isinstance(lookup, ExactLookup):
        settings = {"spacing": 0.0, "differentiable": False}
    else:
        raise ConfigError(f"a look-up of the class {type(lookup).__name__} cannot be saved; give the agent another.")
    if len(lookup.worlds) > 1:
        raise ConfigError(
            f"the agent is in {len(lookup.worlds)} worlds; save it in one, such as agent.elsewhere([layout.map])."
        )
    if not isinstance(planner, Settings):
        raise ConfigError(
            f"a planner of the class {type(planner).__name__} cannot be saved, because it has no settings; derive it "
            "from affmap.settings.Settings, and register it."
        )
    values = {
        "seeds": agent.seeds,
        "num_channels": agent.stack.num_channels,
        "channels": agent.channels,
        "model": agent.stack.settings,
        "lookup": settings,
        "world": lookup.worlds[0],
        "planner": planner,
        "control": agent.settings,
        "vehicle": agent.vehicle,
    }
    return _Record.checked(values, "the agent")


def _check_transition(stack: Stack, read: Stack) -> None:
    """Make sure that a transition model was read as what it is.

    Raises:
        ConfigError: it was made by a function or a class of one's own, which a file cannot name.
    """
    kinds = type(stack.transition), type(read.transition)
    if kinds[0] is not kinds[1]:
        raise ConfigError(
            f"a transition model of the class {kinds[0].__name__} cannot be saved, because its settings say "
            f"{kinds[1].__name__}; register settings of its own, and name them in those of the model."
        )


def _check_replaceable(place: Path) -> None:
    """Make sure that nothing but an earlier saved agent is replaced.

    Raises:
        ConfigError: something else is there.
    """
    if place.is_dir():
        strangers = sorted(path.name for path in place.iterdir() if path.name not in FILES or not is_saved(place))
        if not strangers:
            return
        reason = f"has {strangers[0]}, which is no saved agent"
    elif place.exists():
        reason = "is a file"
    else:
        return
    raise ConfigError(f"{place} {reason}, and stays as it is; save the agent in another folder.")
