"""Arguments of flights that are started from Python: checked, and their defaults by the agent."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from affmap.control.agent import Agent
from affmap.control.controller import Controller
from affmap.control.mpc import PlanningAgent
from affmap.control.oracle import Oracle
from affmap.control.settings import ControlSettings
from affmap.env.body import AnyVehicle, Vehicle
from affmap.env.body import load as load_vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import AnyLayout
from affmap.env.procedural import load as load_layout
from affmap.env.rules import Rules
from affmap.settings import ConfigError, check_folder
from affmap.settings.messages import format_value


def layouts(given: AnyLayout | Sequence[AnyLayout]) -> list[Layout | Rules]:
    """One or several layouts, or rules for them.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.
    """
    every = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return [load_layout(layout) for layout in every]


def agent(given: Any) -> Controller:
    """An agent: any object with the methods of a controller.

    Raises:
        ConfigError: it is none.
    """
    if not is_agent(given):
        raise ConfigError(f"agent = {format_value(given)} is not allowed; give an agent, such as affmap.load('exp1').")
    controller: Controller = given
    return controller


def is_agent(given: Any) -> bool:
    """Whether something has the methods of a controller, and is no class of them."""
    return not isinstance(given, type) and all(callable(getattr(given, name, None)) for name in ("initial", "act"))


def named(given: Controller | Mapping[str, Controller]) -> dict[str, Controller]:
    """Several agents by their names; a single one has that of its planner.

    Raises:
        ConfigError: they have no names, or one of them is no agent.
    """
    if isinstance(given, Sequence):
        raise ConfigError(
            f"agents = {format_value(given)} is not allowed; give an agent, such as affmap.load('exp1'), or several "
            "by their names, such as {'mine': affmap.load('exp1')}."
        )
    every = dict(given) if isinstance(given, Mapping) else {_kind(given): given}
    for each in every.values():
        agent(each)
    return every


def _kind(agent: Controller) -> str:
    """The kind of an agent as in tables of reports: that of its planner, or its own."""
    part = agent.planner if isinstance(agent, PlanningAgent) else agent
    return str(getattr(part, "kind", type(part).__name__))


def settings(controller: Controller, runs: int | None, steps: int | None) -> ControlSettings:
    """The settings of control of a controller, perhaps with other numbers of runs and steps.

    Raises:
        ConfigError: a number is not allowed.
    """
    own = controller.settings if isinstance(controller, PlanningAgent) else ControlSettings.load("control", "default")
    given = {"runs_per_member": ("runs", runs), "num_steps": ("steps", steps)}
    changes = {key: whole(*pair, least=1) for key, pair in given.items() if pair[1] is not None}
    values = {key: getattr(own, key) for key in ControlSettings.model_fields}  # all of them, the device, too
    return ControlSettings.checked(values | changes, "flight")


def vehicle(controller: Controller, given: AnyVehicle | None = None) -> Vehicle:
    """The vehicle that a controller flies: the given one, else that which it has learned or knows, else the default.

    Raises:
        ConfigError: there is no such file, or a value is not allowed.

    Warns:
        UserWarning: the given one is another than it has learned or knows.
    """
    own = controller.vehicle if isinstance(controller, Agent | Oracle) else None
    if given is None:
        return own or load_vehicle("default")
    flown = load_vehicle(given)
    if own and flown != own:
        differences = [
            f"{key} = {value} instead of {getattr(own, key)}" for key, value in flown if value != getattr(own, key)
        ]
        warnings.warn(
            f"the agent was trained with another vehicle, so its predictions may be wrong: {', '.join(differences)}.",
            stacklevel=3,
        )
    return flown


def whole(name: str, given: Any, least: int = 0) -> int:
    """A whole number that is an argument of a call.

    Raises:
        ConfigError: it is none, or less than `least`.
    """
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or given < least:
        raise ConfigError(f"{name} = {format_value(given)} is not allowed; give a whole number, {least} or more.")
    return int(given)


def folder(given: Any) -> Path:
    """The path of a folder that a call writes.

    Raises:
        ConfigError: it is no path, or cannot be used.
    """
    if not isinstance(given, str | Path):
        raise ConfigError(f"folder = {format_value(given)} is not allowed; give a path, such as 'runs/mine'.")
    try:
        return check_folder(Path(given))
    except ValueError as error:
        raise ConfigError(f"folder = {format_value(str(given))} is not allowed: it {error}.") from None


def streams(seeds: Sequence[int], runs: int, seed: int) -> list[tuple[int, ...]]:
    """The seed and the keys of the random streams of B runs (member-major); with seed 0, of those of reports."""
    return [(member, run, *([seed] if seed else [])) for member in seeds for run in range(runs)]


def num_runs(runs: int | None, *places: ArrayLike | None) -> int | None:
    """R, runs of each member: as given, else as many as there are starts or goals; None if neither says it."""
    rows = [len(array) for each in places if each is not None and (array := np.asarray(each, object)).ndim > 1]
    return rows[0] if runs is None and rows else runs


def places(
    name: str, given: ArrayLike | None, shape: tuple[int, int], layouts: Sequence[Layout], radius: float = 0.0
) -> np.ndarray | None:
    """Starts or goals of B runs, `[B, 2]` in u (member-major); None for None.

    Args:
        name: for errors.
        given: `[R, 2]`, the same for each member; or `[B, 2]`; or `[2]`, the same for all.
        shape: M and R, numbers of members and of runs of each.
        layouts: the world of all runs, or of each of the B.
        radius: of the disc that must fit there, u.

    Raises:
        ConfigError: the shape is another; or there is no room for the disc.
    """
    if given is None:
        return None
    members, runs = shape
    try:
        points = np.asarray(given, float)
    except (TypeError, ValueError):  # rows of several lengths, or no numbers
        raise ConfigError(
            f"{name} = {format_value(given)} is not allowed; give points, such as [[0.2, 0.2]]."
        ) from None
    if points.shape not in ((2,), (runs, 2), (members * runs, 2)):
        raise ConfigError(
            f"{name} has the shape {list(points.shape)}; give one point for each of the {runs} runs of a member, "
            f"[{runs}, 2], or one for all, [2]."
        )
    whole = len(points.reshape(-1, 2)) == members * runs
    points = points.reshape(-1, 2) if whole else np.broadcast_to(points, (members, runs, 2)).reshape(-1, 2)
    worlds = [*layouts] * (len(points) if len(layouts) == 1 else 1)
    for point, layout in zip(points, worlds, strict=True):
        if not layout.is_free(point, radius).all():
            room = f"with room for a vehicle of radius {radius} u" if radius else "outside of obstacles"
            raise ConfigError(
                f"{name}: {point.tolist()} is not allowed; give a point of the arena {list(layout.size)} (u) of "
                f"{layout.name!r}, {room}."
            )
    return points
