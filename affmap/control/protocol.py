"""Evaluation protocols: the worlds, starts, goals and noise that every agent is scored on, as a file with a digest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import BeforeValidator, PlainSerializer, PlainValidator, ValidationInfo, field_validator

from affmap.control import arguments
from affmap.control.agent import Agent, seeds_of
from affmap.control.controller import Controller
from affmap.control.episodes import bring, control
from affmap.control.oracle import HalfOracle, Oracle
from affmap.control.random import RandomAgent
from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.body import load as load_vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import load as load_layout
from affmap.env.rules import Rules
from affmap.planning.registry import AnyPlanner
from affmap.progress import silent
from affmap.random import generator
from affmap.settings import ConfigError, Line, Name, Seed, Settings, preset, read
from affmap.settings.changes import changed
from affmap.store.stage import Stage

World = Annotated[Layout | Rules, PlainValidator(load_layout), PlainSerializer(lambda world: world.plain)]
"""A layout, or rules that give each run a layout of its own; a file names it."""


def _planner(given: Any) -> Any:
    return changed("planner", read("planner", "cem"), given)


def _control(given: Any) -> Any:
    return changed("control", read("control", "default"), given)


class Protocol(Settings, defaults="protocol/eight_worlds"):
    """An evaluation protocol (`conf/protocol`): run i has the same world, start, goal and noise for every agent."""

    name: Name = preset()
    """That of its file."""
    channels: tuple[Line, ...] = preset(min_length=1)
    """Channels of the view in every world, in order; those of an agent, if it has learned to see others."""
    worlds: tuple[World, ...] = preset(min_length=1)
    """Files of `conf/layout`, in the order of tables."""
    seed: Seed = preset()
    """Seed of worlds, starts, goals and noise."""
    vehicle: Annotated[Vehicle, BeforeValidator(load_vehicle)] = preset()
    """A file of `conf/vehicle`, or changes of `default`; all agents fly it."""
    planner: Annotated[AnyPlanner, BeforeValidator(_planner)] = preset()
    """A file of `conf/planner`, or changes of `cem`: that of the oracle."""
    control: Annotated[ControlSettings, BeforeValidator(_control)] = preset()
    """Changes of `conf/control/default.yaml`: `num_steps`, `runs_per_member` (in each world, of all members together)
    and `goal_radius` for all agents, the others for the oracle."""

    @field_validator("worlds")
    @classmethod
    def _show(cls, worlds: tuple[Layout | Rules, ...], info: ValidationInfo) -> tuple[Layout | Rules, ...]:
        twice = [name for name, count in Counter(world.name for world in worlds).items() if count > 1]
        if twice:
            raise ValueError(f"names {twice[0]!r} twice; leave one of them out")
        channels = info.data.get("channels")
        return tuple(world.model_copy(update={"channels": channels}) for world in worlds) if channels else worlds

    @property
    def num_runs(self) -> int:
        """Runs of an agent in each world."""
        return self.control.runs_per_member

    @cached_property
    def digest(self) -> str:
        """Digest of the protocol with all files that it names: with another one, numbers cannot be compared."""
        return Stage("protocol", self.plain).digest

    def oracle(self, as_seen: bool = False) -> Oracle:
        """The agent whose score is 1: it knows the true physics and, if guided, the way; `as_seen` see `Oracle`."""
        known = self.layouts(self.worlds[0])[:1]
        return Oracle(known, self.vehicle, self.planner, self.control, as_seen=as_seen)

    @property
    def random(self) -> RandomAgent:
        """The agent whose score is 0."""
        return RandomAgent(kind="random")

    def layouts(self, world: Layout | Rules) -> list[Layout]:
        """The layout of all runs in a world, or one for each run."""
        if isinstance(world, Layout):
            return [world]
        return [world.draw(generator(self.seed, "world", run)) for run in range(self.num_runs)]

    def fly(self, controller: Controller, show: Callable[..., Any] = silent) -> pd.DataFrame:
        """Let a controller fly all runs, in every world that it can see.

        The members of an agent have equal parts of a world's runs, in order. A world that is painted in a channel that
        an agent has not learned to see is left out.

        Args:
            controller: an agent, or any other controller.
            show: `affmap.progress.reported` to show the progress.

        Returns:
            A row for each run: `world`, `member`, `run` (in its world), and all metrics of runs; see
            `affmap.control.episodes.summarise`.

        Raises:
            ConfigError: the runs cannot be divided among its members, or it can see none of the worlds.

        Warns:
            UserWarning: the agent was trained with another vehicle.
        """
        seeds = seeds_of(controller)
        if self.num_runs % len(seeds):
            raise ConfigError(
                f"the agent has {len(seeds)} members, and the {self.num_runs} runs in each world of {self.name!r} "
                "cannot be divided among them in equal parts; load another number of them, as in "
                "affmap.load('exp1', members=range(5))."
            )
        vehicle = arguments.vehicle(controller, self.vehicle)
        settings = arguments.settings(controller, self.num_runs, self.control.num_steps)
        settings = settings.model_copy(update={"goal_radius": self.control.goal_radius})
        channels = _channels(controller) or self.channels
        tables = []
        for world in self.worlds:
            layouts = self.layouts(world)
            if not _painted(layouts) <= {*channels}:
                continue
            layouts = [layout.model_copy(update={"channels": channels}) for layout in layouts]
            with show(f"flight in {world.name}", settings.num_steps, "steps", on_terminal_only=True) as update:
                # One seed for all members: a run's random numbers depend on its number only, whoever flies it.
                flown = control(bring(controller, *layouts), layouts, vehicle, settings, [self.seed], update)
            table = flown.table.assign(member=np.repeat(seeds, self.num_runs // len(seeds)))
            table.insert(0, "world", world.name)
            tables.append(table)
        if not tables:
            raise ConfigError(
                f"the agent has learned to see the channels {list(channels)}, and every world of {self.name!r} is "
                f"painted in others of {list(self.channels)}, too; score an agent that sees those."
            )
        return pd.concat(tables, ignore_index=True)


def _channels(controller: Controller) -> Sequence[str] | None:
    """Channels that an agent has learned to see; None for a controller that has not learned, or if they are unknown."""
    learned = controller.agent if isinstance(controller, HalfOracle) else controller
    return learned.channels if isinstance(learned, Agent) else None


def _painted(layouts: Sequence[Layout]) -> set[str]:
    """Channels of the view in which there is anything to see."""
    return {each.border_channel for each in layouts} | {circle.channel for each in layouts for circle in each.circles}
