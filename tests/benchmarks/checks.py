"""Checks that a card computes what the CPU computes, but for rounding: weights in training, plans, flights."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from graphs import WARM_UP, Epoch, Training, captured
from torch import Tensor, nn
from workloads import Scale, first_observation, fly, generators, make_agent, synchronize

from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.data.batches import Batch
from affmap.pipeline.train import untrained
from affmap.training.module import TrainingModule

UPDATES = 10
"""In which weights move by up to 0.008, and float32 differs from float64 by 2e-7 on a CPU."""

ALLOWED_WEIGHTS = 1e-5
"""Much more than rounding, which Adam enlarges where gradients are as small as its epsilon; much less than the way."""

ALLOWED_COSTS = 1e-4
"""Relative. Weights that differ in their last bit change costs by 1e-6 on a CPU."""

ALLOWED_POSITIONS = 1e-3
"""u, after the first few steps; a vehicle's radius is 0.06 u."""

MOST = 0.95
"""Share of the agents that must agree: rounding decides between candidates that cost nearly the same."""


class Check(NamedTuple):
    """What was compared."""

    check: str
    difference: float
    allowed: float


def training(config: Config, batches: Sequence[Batch], device: str) -> list[Check]:
    """Largest difference of weights after a few updates: on the CPU with the batches as they are, and on a device."""
    reference = TrainingModule(untrained(config), config.training)
    optimizer = reference.configure_optimizers()
    for batch in batches[:UPDATES]:
        reference.update(batch, optimizer)
    epoch = Epoch.of(batches, device)
    plain, graphed = Training(config, epoch), Training(config, epoch)
    for _ in range(UPDATES):
        plain.update()
    replay = captured(graphed)
    for _ in range(UPDATES - WARM_UP):
        replay()
    synchronize(device)
    return [
        Check(f"weights after {UPDATES} updates, {name}", _distance(each.module, reference), ALLOWED_WEIGHTS)
        for name, each in (("plain", plain), ("CUDA graph", graphed))
    ]


def _distance(module: nn.Module, other: nn.Module) -> float:
    pairs = zip(module.parameters(), other.parameters(), strict=True)
    largest = [(one.detach().cpu() - another.detach()).abs().max() for one, another in pairs]
    return torch.stack(largest).max().item()  # NaN, where there is one


def control(scale: Scale, device: str) -> list[Check]:
    """Costs of the first plans (relative), and positions after a few steps (u), of most agents."""
    agent, reference = (make_agent(scale, scale.runs[0], "cem", each) for each in (device, "cpu"))
    costs, expected = _costs(agent), _costs(reference)
    positions, right = (torch.from_numpy(fly(each).trajectories["position"][:, -1]) for each in (agent, reference))
    return [
        Check("costs of first plans", _most((costs - expected) / expected), ALLOWED_COSTS),
        Check(f"positions after {scale.num_steps} steps", _most((positions - right).norm(dim=1)), ALLOWED_POSITIONS),
    ]


def _costs(agent: Agent) -> Tensor:
    """The costs of first plans, `[B]` in nats."""
    objective, start = agent.objective(first_observation(agent)), agent.initial(len(generators(agent))).planner
    return agent.planner.plan(objective, start, generators(agent))[0].cost.cpu()


def _most(differences: Tensor) -> float:
    return differences.abs().quantile(MOST).item()
