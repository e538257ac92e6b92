"""The stage `control`: goal-directed runs."""

from collections.abc import Sequence
from itertools import repeat
from pathlib import Path

import numpy as np
import torch

from affmap.config.root import Config, label
from affmap.control.agent import Agent
from affmap.control.controller import Controller
from affmap.control.episodes import control
from affmap.control.filter import Filter
from affmap.control.oracle import HalfOracle, Oracle
from affmap.control.registry import AgentSettings, OracleSettings
from affmap.control.variation import Task, make_tasks
from affmap.env.body import Vehicle
from affmap.env.geometry import crossable
from affmap.env.layout import Layout
from affmap.model.lookup import ExactLookup, Lookup, lookup_error, make_lookup
from affmap.model.settings import MemorySettings
from affmap.model.stack import Stack
from affmap.pipeline.policy import load_policy
from affmap.pipeline.progress import track
from affmap.pipeline.recall import Survey, surveyed
from affmap.pipeline.train import trained
from affmap.random import generator
from affmap.results import metrics
from affmap.results.files import Trajectories, write_layouts, write_recall, write_runs, write_trajectories
from affmap.results.setting import CONTEXT_SIZE, FACTORS, LAYOUT, PLANNER, SPACING, Factor, Value
from affmap.settings.messages import counted
from affmap.store.attempt import Attempt


def make_runs(config: Config, train: Path, policy: Path | None, attempt: Attempt) -> None:
    """Fly all runs; write their table, trajectories and layouts. A rival flies with its `policy`."""
    tasks = _tasks(config)
    layouts, vehicle, settings = [task.layout for task in tasks], tasks[0].vehicle, tasks[0].settings
    controller: Controller
    if policy:
        controller, stack, lookup = load_policy(config, policy), None, None
    else:
        stack = trained(config, train).to(config.control.device)
        lookup = make_lookup(config.lookup, stack, [layout.map for layout in layouts])
        controller = _controller(config, stack, lookup, layouts, vehicle)
        if isinstance(config.memory, MemorySettings):
            controller = surveyed(config, controller, layouts[0], config.memory)
    num_runs = len(config.pilots) * config.control.runs_per_member
    with track(
        f"control, {label(config)}: {counted(num_runs, 'run')}", settings.num_steps, "steps", attempt.progress
    ) as update:
        runs = control(controller, layouts, vehicle, settings, config.pilots, update)
    values: dict[Factor, Value] = {
        LAYOUT: config.control_layout.name,
        PLANNER: config.controller,
        SPACING: config.lookup.spacing,
        CONTEXT_SIZE: config.model.context_size,
    }
    setting = {factor.column: values[factor] for factor in FACTORS.values()}
    run_layouts = layouts * num_runs if len(layouts) == 1 else layouts
    starts, goals = runs.trajectories["position"][:, 0], runs.trajectories["goal"]
    ways = [crossable(*run) for run in zip(run_layouts, repeat(vehicle), starts, goals)]
    if isinstance(controller, Survey):
        lookup = controller.lookup
    errors = _lookup_error(config, stack, lookup, layouts, runs.trajectories["position"])
    table = metrics.table(Trajectories(**runs.trajectories), metrics.stored_metrics())
    write_runs(attempt.folder, setting, table, [ways, errors])
    write_trajectories(attempt.folder, runs.trajectories)
    write_layouts(attempt.folder, run_layouts)
    if isinstance(controller, Survey):
        write_recall(attempt.folder, controller.recall(config.pilots))


def _controller(
    config: Config, stack: Stack, lookup: Lookup, layouts: Sequence[Layout], vehicle: Vehicle
) -> Controller:
    """The controller: an agent of stack, look-up and planner, an oracle, or one that needs none of these.

    Oracles know the vehicle that flies; agents have learned another one, if the task is varied.
    """
    settings = config.agent
    if not isinstance(settings, AgentSettings | OracleSettings):
        return settings
    if settings.kind == "filter":
        return Filter(layouts, vehicle, config.planner, config.control, settings.std)
    if settings.kind in ("oracle", "seen"):
        as_seen = settings.kind == "seen"
        return Oracle(layouts, vehicle, config.planner, config.control, settings.std, as_seen)
    agent = Agent(stack, lookup, config.planner, config.control)
    if settings.kind == "planner":
        return agent
    return HalfOracle(agent, layouts, vehicle, settings.kind == "true_mean", settings.std)


def _tasks(config: Config) -> list[Task]:
    """The one task of all agents, or a task for each (member-major), the same in all settings but for variations."""
    layout = config.control_layout
    keys = [(seed, run) for seed in config.pilots for run in range(config.control.runs_per_member)]
    if isinstance(layout, Layout):
        layouts = [layout]
    else:
        layouts = [layout.draw(generator(seed, "world", run)) for seed, run in keys]
    return make_tasks(config.variation, layouts, config.vehicle, config.control, keys)


def _lookup_error(
    config: Config, stack: Stack | None, lookup: Lookup | None, layouts: Sequence[Layout], positions: np.ndarray
) -> np.ndarray:
    """Mean error of context codes along paths `[B, T + 1, 2]` (u), in the worlds as runs begin: `[B]`; 0 of rivals."""
    if stack is None or lookup is None or config.lookup.spacing == 0 or stack.context_size == 0:
        return np.zeros(len(positions))
    exact = ExactLookup(stack, [layout.map for layout in layouts])
    paths = torch.from_numpy(positions).to(config.control.device).unflatten(0, (config.members, -1))
    errors = [lookup_error(lookup, exact, now) for now in paths.unbind(2)]  # step by step, to bound the memory
    return torch.stack(errors).mean(0).flatten().cpu().numpy()
