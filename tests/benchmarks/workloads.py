"""The work that a card and a CPU are given: batches to train on, agents to plan for; at full and at toy size."""

from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import torch
from planning import starts

from affmap import compiled, load
from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.control.controller import Observation
from affmap.control.episodes import Runs, control
from affmap.data.batches import Batch, DataModule
from affmap.data.collect import DATASET, collect, write_dataset
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.pipeline.train import untrained
from affmap.planning.planner import Generators
from affmap.random import generator
from affmap.training.module import TrainingModule

LAYOUT = Layout.load("layout", "original")
VEHICLE = Vehicle.load("vehicle", "default")


class Scale(NamedTuple):
    """How much is done."""

    overrides: tuple[str, ...]
    """Of the configurations of the paper's experiments."""
    num_sequences: int
    """Of each training world; a sixth of them is not trained on."""
    members: int
    """M of the agents that plan."""
    runs: tuple[int, int]
    """Agents of each member, few and many."""
    num_steps: int
    """Of a flight."""
    seconds: float
    """Of a measurement."""


FULL = Scale((), num_sequences=24, members=25, runs=(4, 40), num_steps=10, seconds=5.0)
TOY = Scale(("scale=smoke",), num_sequences=6, members=2, runs=(1, 2), num_steps=3, seconds=0.01)


def batches(config: Config, scale: Scale) -> list[Batch]:
    """The batches of an epoch in the worlds of a job, of fewer sequences than its own; on the CPU."""
    numbers = {"num_sequences": scale.num_sequences, "num_validation": scale.num_sequences // 6}
    exploration = config.data.model_copy(update=numbers)
    with TemporaryDirectory() as folder:
        write_dataset(Path(folder), collect(config.training_layouts, config.vehicle, exploration))
        path, training = Path(folder) / DATASET, config.training
        loader = DataModule(path, exploration, training.batch_size, training.chunk_length).train_dataloader()
        return [batch for some in loader for batch in some]


def cpu_training(config: Config, own: Sequence[Batch]) -> Callable[[], object]:
    """A call that makes a job's next update on the CPU, in compiled loops; batches take turns."""
    module, turns = TrainingModule(untrained(config), config.training), cycle(own)
    optimizer = module.configure_optimizers()

    @compiled.switched(True)
    def update() -> None:
        module.update(next(turns), optimizer)

    return update


def make_agent(scale: Scale, runs: int, planner: str, device: str) -> Agent:
    """Agents with models of the reference run and 8 context units, `runs` of each member, on a device."""
    loaded = load("exp1", members=range(scale.members), planner=planner)
    numbers = {"runs_per_member": runs, "num_steps": scale.num_steps, "device": device}
    stack = loaded.stack.to(device)
    lookup = loaded.lookup.elsewhere(stack, [LAYOUT.map])
    return Agent(stack, lookup, loaded.planner, loaded.settings.model_copy(update=numbers), loaded.channels)


def first_observation(agent: Agent) -> Observation:
    """Where all agents start."""
    return starts(LAYOUT, VEHICLE, agent.settings, agent.seeds)


def generators(agent: Agent) -> Generators:
    """What is random in the planning of each agent."""
    return [generator(seed, "planner", run) for seed in agent.seeds for run in range(agent.settings.runs_per_member)]


def fly(agent: Agent, on_step: Callable[[int], None] = lambda step: None) -> Runs:
    """Flights of all agents, side by side; `on_step` is called with the number of steps done."""
    return control(agent, [LAYOUT], VEHICLE, agent.settings, agent.seeds, on_step)


def synchronize(device: str) -> None:
    """Wait until a device has done all that it was given."""
    if device == "cuda":
        torch.cuda.synchronize()
