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
from affmap.control.oracle import HalfOracle, Oracle
from affmap.control.registry import AgentSettings, OracleSettings
from affmap.env.geometry import crossable
from affmap.env.layout import Layout
from affmap.model.lookup import ExactLookup, Lookup, lookup_error, make_lookup
from affmap.model.stack import Stack
from affmap.pipeline.progress import track
from affmap.pipeline.train import trained
from affmap.random import generator
from affmap.results.files import write_layouts, write_runs, write_trajectories
from affmap.results.setting import CONTEXT_SIZE, FACTORS, LAYOUT, PLANNER, SPACING, Factor, Value
from affmap.store.attempt import Attempt


def make_runs(config: Config, train: Path, attempt: Attempt) -> None:
    """Fly all runs, and write their table, trajectories and layouts."""
    stack = trained(config, train).to(config.control.device)
    layouts = _layouts(config)
    lookup = make_lookup(config.lookup, stack, [layout.map for layout in layouts])
    controller = _controller(config, stack, lookup, layouts)
    num_runs = config.members * config.control.runs_per_member
    with track(
        f"control, {label(config)}: {num_runs} runs", config.control.num_steps, "steps", attempt.progress
    ) as update:
        runs = control(controller, layouts, config.vehicle, config.control, config.seeds, update)
    values: dict[Factor, Value] = {
        LAYOUT: config.control_layout.name,
        PLANNER: config.controller,
        SPACING: config.lookup.spacing,
        CONTEXT_SIZE: config.model.context_size,
    }
    setting = {factor.column: values[factor] for factor in FACTORS.values()}
    flown = layouts * num_runs if len(layouts) == 1 else layouts
    starts, goals = runs.trajectories["position"][:, 0], runs.trajectories["goal"]
    ways = [crossable(*run) for run in zip(flown, repeat(config.vehicle), starts, goals)]
    errors = _lookup_error(config, stack, lookup, layouts, runs.trajectories["position"])
    write_runs(attempt.folder, setting, runs.table, [ways, errors])
    write_trajectories(attempt.folder, runs.trajectories)
    write_layouts(attempt.folder, flown)


def _controller(config: Config, stack: Stack, lookup: Lookup, layouts: Sequence[Layout]) -> Controller:
    """What steers: an agent made of stack, look-up and planner, one that knows the world, or one that needs nothing."""
    agent = config.agent
    if not isinstance(agent, AgentSettings | OracleSettings):
        return agent
    if agent.kind == "oracle":
        return Oracle(layouts, config.vehicle, config.planner, config.control, agent.std)
    learned = Agent(stack, lookup, config.planner, config.control)
    if agent.kind == "planner":
        return learned
    return HalfOracle(learned, layouts, config.vehicle, agent.kind == "true_mean", agent.std)


def _layouts(config: Config) -> list[Layout]:
    """The layout that all agents fly in, or those of each (member-major), which all settings share."""
    layout = config.control_layout
    if isinstance(layout, Layout):
        return [layout]
    runs = range(config.control.runs_per_member)
    return [layout.draw(generator(seed, "world", run)) for seed in config.seeds for run in runs]


def _lookup_error(
    config: Config, stack: Stack, lookup: Lookup, layouts: Sequence[Layout], positions: np.ndarray
) -> np.ndarray:
    """Mean error of context codes along paths `[B, T + 1, 2]` (u): `[B]`."""
    if config.lookup.spacing == 0 or stack.context_size == 0:
        return np.zeros(len(positions))
    exact = ExactLookup(stack, [layout.map for layout in layouts])
    visited = torch.from_numpy(positions).to(config.control.device).unflatten(0, (config.members, -1))
    errors = [lookup_error(lookup, exact, now) for now in visited.unbind(2)]  # a step at a time bounds the memory
    return torch.stack(errors).mean(0).flatten().cpu().numpy()
