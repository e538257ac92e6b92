"""The stage of agents that learn online."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from affmap.config.compose import compose, values
from affmap.config.root import Config
from affmap.data.batches import read
from affmap.data.collect import DATASET, coverage
from affmap.gaussian import nll
from affmap.learning.learners import Learners
from affmap.learning.settings import GoalLearning, SeekingLearning
from affmap.pipeline.execution import models
from affmap.pipeline.train import trained, untrained
from affmap.results.files import read_experience, read_validation

TINY = ["members=4", "learning.committee=2", "learning.round_steps=50", "learning.updates=2", "learning.spacing=0.2"]
TINY += ["model.context_size=3", "data.num_sequences=4", "data.num_steps=30", "data.num_validation=2"]
TINY += ["training.num_epochs=3", "training.snapshot_epochs=[1,2]"]


def config(folder: Path, *line: str, learning: str = "disagreement") -> Config:
    whole = values(compose([f"learning={learning}", *TINY, *line]))
    return Config.checked({**whole, "store": folder / "store", "output": folder / "output"}, "test")


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "provenance.json"}


def test_the_losses_are_those_of_the_held_out_sequences(tmp_path: Path) -> None:
    """Density of the validation sequences under the last weights, step by step; all others are not used."""
    own = config(tmp_path)
    data, train = models(own, ())
    stack, whole = trained(own, train), read(data / DATASET)
    with torch.no_grad():
        codes = stack.encode(whole.views.select((slice(None), slice(2, 4))))
        _, prediction = stack.transition.unroll((), codes, whole.delta[:, 2:], whole.action[:, 2:])
        expected = nll(prediction, whole.target[:, 2:]).mean((1, 2))
    table = read_validation(train)
    assert table.groupby("member")["epoch"].agg(list).tolist() == [[1, 2, 3]] * 4
    np.testing.assert_allclose(table.query("epoch == 3")["validation_nll"], expected, atol=2e-5)
    assert {name for name in files(train) if name.startswith("weights")} == {
        "weights.safetensors", "weights-epoch-001.safetensors", "weights-epoch-002.safetensors",
    }  # fmt: skip


def test_an_interrupted_stage_goes_on_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An undisturbed one; the second round fails once."""
    undisturbed = files(models(config(tmp_path / "whole"), ())[1])
    rounds, whole = [], Learners.round

    def failing(self: Learners) -> Any:
        rounds.append(self.num_rounds)
        if rounds == [0, 1]:
            raise RuntimeError("power cut")
        return whole(self)

    monkeypatch.setattr(Learners, "round", failing)
    own = config(tmp_path / "cut")
    with pytest.raises(RuntimeError, match="power cut"):
        models(own, ())
    assert files(models(own, ())[1]) == undisturbed
    assert rounds == [0, 1, 1, 2]


@pytest.mark.parametrize("layouts", [["original"], ["original", "two_obstacles"]])
def test_places_are_counted_by_agent_round_and_layout(tmp_path: Path, layouts: list[str]) -> None:
    """`coverage` of the true positions of agents that are let learn here, with the same seeds."""
    own = config(tmp_path, f"training_layouts=[{','.join(layouts)}]")
    experience = read_experience([models(own, ())[1]])
    assert isinstance(own.learning, SeekingLearning)
    learners = Learners(untrained(own), own.training_layouts, own.vehicle, own.data, own.learning, own.training)
    for _ in range(3):
        learners.round()
    assert experience.counts.shape == (2, 3, 20, 30) and experience.steps.tolist() == [50, 100, 150]
    assert experience.agent.tolist() == [0, 2]
    for agent, rounds in enumerate(learners.rounds):
        np.testing.assert_allclose(experience.touching[agent], [each.touching.mean() for each in rounds], atol=1e-6)
        parts = [
            coverage(
                layout, own.vehicle, np.concatenate([each.true_position[1:] for each in rounds[number :: len(layouts)]])
            )
            for number, layout in enumerate(own.training_layouts)
        ]
        covered = sum((part["counts"][part["free"]] > 0).sum() for part in parts) / sum(
            part["free"].sum() for part in parts
        )
        assert experience.coverage[agent, -1] == covered
        np.testing.assert_array_equal(experience.counts[agent, :: len(layouts)].sum(0), parts[0]["counts"])


def test_goals_are_counted_by_agent_and_round(tmp_path: Path) -> None:
    """By hand, from true positions and goals of agents that are let learn here; those that have none count none."""
    own = config(tmp_path, "learning.goal_radius=1.2", learning="goals")
    experience = read_experience([models(own, ())[1]])
    assert isinstance(own.learning, GoalLearning)
    learners = Learners(untrained(own), own.training_layouts, own.vehicle, own.data, own.learning, own.training)
    for _ in range(3):
        learners.round()
    counts = np.zeros((2, 3), int)
    for agent, rounds in enumerate(learners.rounds):
        for number, each in enumerate(rounds):
            assert each.goal is not None
            changes = (np.diff(each.goal, axis=0) != 0).any(1)
            near = np.hypot(*(each.true_position[1:] - each.goal).T) < 1.2
            np.testing.assert_array_equal(changes, near[:-1])
            counts[agent, number] = near.sum()
    assert counts.sum() > 0 and experience.goals is not None
    np.testing.assert_array_equal(experience.reached, counts)
    np.testing.assert_allclose(experience.goals, counts / 50)
    assert read_experience([models(config(tmp_path / "none"), ())[1]]).goals is None
