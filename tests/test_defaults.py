"""Defaults of PyTorch that a user has changed, and numbers of other types: all results are as without, bit by bit.

The device "meta" stands for any other one: whatever is created there by mistake has no values.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from torch import Tensor

import affmap
from affmap.control.agent import Agent
from affmap.control.oracle import Oracle
from affmap.control.settings import ControlSettings
from affmap.data.batches import DataModule
from affmap.data.collect import Exploration, collect
from affmap.env import Layout, Vehicle, VehicleEnv
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.registry import GRUSettings, MLPSettings
from affmap.model.stack import ModelSettings, Stack
from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner
from affmap.training.boards.tensorboard import TensorBoard
from affmap.training.fit import fit
from affmap.training.settings import TrainingSettings
from affmap.view import view

pytestmark = pytest.mark.usefixtures("loops")

LAYOUT = Layout.load("layout", "two_obstacles")
OBSERVATION, _ = VehicleEnv(LAYOUT).reset(seed=3)
POSITIONS = np.random.default_rng(0).uniform(0, 2, (1, 7, 2)).astype(np.float32)
PLANNERS: dict[str, Any] = {
    "cem": CEMPlanner.load("planner", "cem", num_iterations=2, num_candidates=20, horizon=5),
    "gradient": GradientPlanner.load("planner", "gradient", num_iterations=3, horizon=5),
}


def stack(transition: MLPSettings | GRUSettings) -> Stack:
    return Stack(ModelSettings.load("model", "default", context_size=3, transition=transition), 1, (7,))


def flown(agent: Agent | Oracle) -> list[np.ndarray]:
    """Two actions of a pilot, and the plan behind the last one."""
    pilot = affmap.Pilot(agent, LAYOUT)
    return [*(pilot(OBSERVATION) for _ in range(2)), *pilot.thought]


def trained(planner: str) -> list[np.ndarray]:
    return flown(affmap.load("exp1", context_size=3, planner=PLANNERS[planner]))


def recurrent() -> list[np.ndarray]:
    model, settings = stack(GRUSettings(kind="gru")), ControlSettings.load("control", "default")
    return flown(Agent(model, AffordanceMap.paint(model, [LAYOUT.map], 0.1), PLANNERS["cem"], settings))


def oracle() -> list[np.ndarray]:
    settings = ControlSettings.load("control", "default")
    return flown(Oracle([LAYOUT], Vehicle.load("vehicle", "default"), PLANNERS["cem"], settings))


def looked_up() -> list[np.ndarray]:
    """Codes by both look-ups, a view and a picture of the map."""
    model, positions = stack(MLPSettings(kind="mlp")), torch.from_numpy(POSITIONS)
    painted = AffordanceMap.paint(model, [LAYOUT.map], 0.1)
    codes = [lookup(positions).detach().numpy() for lookup in (ExactLookup(model, [LAYOUT.map]), painted)]
    return [*codes, view(LAYOUT.map, positions).numpy(), painted.picture()]


def planned(planner: str) -> list[np.ndarray]:
    """Two plans for an objective of the test's own."""
    method, plans = PLANNERS[planner], []
    state = method.initial(2)
    for _ in range(2):
        plan, state = method.plan(lambda actions: (actions - 0.3).square().sum((-1, -2)), state, generators())
        plans.append(plan.actions.numpy())
    return plans


def generators() -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(2)]


RESULTS: dict[str, Callable[[], list[np.ndarray]]] = {
    "an agent with the cross-entropy method": lambda: trained("cem"),
    "an agent with gradient descent": lambda: trained("gradient"),
    "a recurrent agent": recurrent,
    "an oracle": oracle,
    "look-ups and views": looked_up,
    "the cross-entropy method": lambda: planned("cem"),
    "gradient descent": lambda: planned("gradient"),
}


@contextmanager
def defaults(dtype: torch.dtype, device: str) -> Iterator[None]:
    """PyTorch with other defaults."""
    torch.set_default_dtype(dtype)
    torch.set_default_device(device)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)
        torch.set_default_device(None)


def assert_same(actual: list[np.ndarray], expected: list[np.ndarray]) -> None:
    for one, other in zip(actual, expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("result", RESULTS.values(), ids=RESULTS)
def test_a_default_dtype_or_device_changes_no_result(result: Callable[[], list[np.ndarray]]) -> None:
    expected = result()
    assert all(part.dtype in (np.float32, np.float64, bool) for part in expected)
    for dtype, device in ((torch.float64, "cpu"), (torch.float16, "cpu"), (torch.float32, "meta")):
        with defaults(dtype, device):
            assert_same(result(), expected)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "dataset.npz"
    np.savez(path, allow_pickle=False, **collect([LAYOUT], Vehicle.load("vehicle", "default"), EXPLORATION))
    return path


EXPLORATION = Exploration.load("data", "default", num_sequences=3, num_validation=1, num_steps=12)


@pytest.mark.parametrize("transition", [MLPSettings(kind="mlp"), GRUSettings(kind="gru")], ids=["MLP", "GRU"])
def test_a_default_dtype_changes_no_training(
    transition: MLPSettings | GRUSettings, dataset: Path, tmp_path: Path
) -> None:
    """Losses and weights, with a learning rate for each of two trials."""
    settings = TrainingSettings.load("training", "default", num_epochs=2, batch_size=2, transition_lr=[0.01, 0.001])

    def training(name: str) -> list[np.ndarray]:
        folder = tmp_path / name
        (folder / "checkpoints").mkdir(parents=True)
        model = Stack(ModelSettings.load("model", "default", context_size=3, transition=transition), 1, (7, 7))
        data, board = DataModule(dataset, EXPLORATION, 2, 5), TensorBoard(folder)
        fit(model, data, settings, folder, folder / "checkpoints", board=board)
        return [
            pd.read_csv(folder / "validation.csv").to_numpy(),
            *(each.numpy() for each in model.state_dict().values()),
        ]

    expected = training("before")
    with defaults(torch.float64, "cpu"):
        assert_same(training("after"), expected)


KINDS: dict[str, Callable[[np.ndarray], object]] = {
    "float64": lambda part: part.astype(float),
    "lists": lambda part: part.tolist(),
    "strided": lambda part: np.repeat(part, 2, axis=-1)[..., ::2],
    "Fortran order": np.asfortranarray,
    "big-endian": lambda part: part.astype(part.dtype.newbyteorder(">")),
    "read-only": lambda part: np.frombuffer(part.tobytes(), part.dtype).reshape(part.shape),
    "tensors": torch.from_numpy,
}


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_pilot_takes_observations_of_any_kind(planner: str) -> None:
    """Whole numbers, too."""
    pilot = affmap.Pilot(affmap.load("exp1", context_size=3, planner=PLANNERS[planner]), LAYOUT)

    def flight(observation: Any) -> list[np.ndarray]:
        pilot.reset()
        return [*(pilot(observation) for _ in range(2)), *pilot.thought]

    expected = flight(OBSERVATION)
    for kind in KINDS.values():
        assert_same(flight({key: kind(part) for key, part in OBSERVATION.items()}), expected)
    expected = flight({**OBSERVATION, "goal": np.array([2.0, 1.0], np.float32)})
    for dtype in (int, np.uint8):
        assert_same(flight({**OBSERVATION, "goal": np.array([2, 1], dtype)}), expected)


def test_look_ups_take_positions_of_any_type() -> None:
    """Codes at the same positions in single precision."""
    model, positions = stack(MLPSettings(kind="mlp")), torch.tensor([[[1, 1], [2, 0], [0, 2]]])
    painted = AffordanceMap.paint(model, [LAYOUT.map], 0.1)
    for lookup, dtype in (
        (painted, torch.float64),
        (painted, torch.int64),
        (ExactLookup(model, [LAYOUT.map]), torch.int64),
    ):
        assert torch.equal(lookup(positions.to(dtype)), lookup(positions.float()))


@pytest.mark.parametrize("planner", PLANNERS)
def test_planners_take_costs_in_double_precision(planner: str) -> None:
    """Plans for the same objective in single precision, whose costs are the same numbers."""
    method = PLANNERS[planner]

    def cost(actions: Tensor) -> Tensor:
        return (8 * actions).square().mean((-1, -2))

    plans = []
    for objective in (cost, lambda actions: cost(actions).double()):
        plan, _ = method.plan(objective, method.initial(2), generators())
        plans.append([plan.actions.numpy(), plan.cost.numpy()])
    assert_same(*plans)
