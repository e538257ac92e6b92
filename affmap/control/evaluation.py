"""Agents compared in layouts: a tidy table with a row for each run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import pandas as pd

from affmap.control import arguments
from affmap.control.agent import Agent, seeds_of
from affmap.control.controller import Controller
from affmap.control.episodes import Runs, bring, control
from affmap.control.oracle import HalfOracle
from affmap.control.variation import AnyVariation, make_tasks
from affmap.control.variation import load as load_variation
from affmap.env.body import AnyVehicle
from affmap.env.layout import Layout
from affmap.env.procedural import AnyLayout
from affmap.env.rules import Rules
from affmap.progress import reported, silent
from affmap.random import generator
from affmap.settings import ConfigError
from affmap.threads import limited


def evaluate(
    agents: Controller | Mapping[str, Controller],
    layouts: AnyLayout | Sequence[AnyLayout],
    *,
    runs: int | None = None,
    steps: int | None = None,
    seed: int = 0,
    vehicle: AnyVehicle | None = None,
    variation: AnyVariation | None = None,
    progress: bool = True,
    threads: int = 1,
) -> pd.DataFrame:
    """Let agents fly in layouts, and return a tidy table.

    Starts, goals and random worlds depend on the member's seed, the number of the run and `seed` only, so that agents
    are compared on the same ones; with seed 0 they are those of reports. `affmap.score` fixes layouts, too.

    Args:
        agents: an agent, or several by their names in the table; any controllers, as for `affmap.fly`.
        layouts: one or several of a layout, its keys and values, or the name of a file in `conf/layout`. Rules for
            worlds give each run of each member a world of its own.
        runs: R, runs of each member in each layout, so many worlds of each rules; by default those of the agent's
            settings.
        steps: T, length of the runs; by default that of the agent's settings.
        seed: of starts, goals, worlds and all other random numbers.
        vehicle: the physics; by default that which each agent was trained in.
        variation: what is other than at home, a factor and its value as in sweeps, such as `mass/0.2`; the factors are
            those of `affmap.control.variation.FACTORS`. Agents are not told, only those that know the physics. By
            default nothing.
        progress: whether a terminal shows the number of steps done.
        threads: of PyTorch, during the flights.

    Returns:
        A row for each run: `agent` (its name; a single one has that of its planner), `context_size` (empty for agents
        without a model), `layout`, `member`, `run`, start and goal (u), and all metrics; see
        `affmap.control.episodes.summarise`.

    Raises:
        ConfigError: there is no such layout, or an agent was trained with other channels; or there are no agents, or
            two layouts of one name; or there are no threads; or an obstacle stands in a corner where runs start; or
            there is no such variation, or a layout cannot have it.

    Warns:
        UserWarning: the vehicle is another than an agent was trained with.
    """
    named = arguments.named(agents)
    places = arguments.layouts(layouts)
    twice = [name for name, count in Counter(place.name for place in places).items() if count > 1]
    if twice:
        raise ConfigError(f"two layouts have the name {twice[0]!r}; give each a name of its own.")
    if not named or not places:
        raise ConfigError("evaluate needs an agent and a layout, as in affmap.evaluate(agent, 'original').")
    varied, seed, tables = load_variation(variation), arguments.whole("seed", seed), []
    with limited(threads):
        for name, agent in named.items():
            at_home = arguments.vehicle(agent, vehicle), arguments.settings(agent, runs, steps)
            streams = arguments.streams(seeds_of(agent), at_home[1].runs_per_member, seed)
            for place in places:
                tasks = make_tasks(varied, _worlds(place, streams), *at_home, streams)
                worlds, (_, physics, settings) = [task.layout for task in tasks], tasks[0]
                show = reported if progress else silent
                with show(f"{name} in {place.name}", settings.num_steps, "steps", on_terminal_only=True) as update:
                    controller = bring(agent, *worlds, vehicle=physics if varied else None)
                    flown = control(controller, worlds, physics, settings, seeds_of(agent), update, seed=seed)
                tables.append(_table(name, agent, place.name, flown))
    return pd.concat(tables, ignore_index=True)


def _worlds(place: Layout | Rules, streams: Sequence[tuple[int, ...]]) -> list[Layout]:
    """The layout; or one for each run, by its random stream (member-major), drawn by rules."""
    if isinstance(place, Layout):
        return [place]
    return [place.draw(generator(member, "world", *keys)) for member, *keys in streams]


def _table(name: str, agent: Controller, layout: str, flown: Runs) -> pd.DataFrame:
    table = flown.table.copy()
    learned = agent.agent if isinstance(agent, HalfOracle) else agent
    size = learned.stack.context_size if isinstance(learned, Agent) else None
    for column, value in (("layout", layout), ("context_size", size), ("agent", name)):
        table.insert(0, column, value)
    return table.astype({"context_size": "Int64"})
