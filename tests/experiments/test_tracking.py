"""Reasons that the report of Experiment IX gives: beliefs along exploration step by step, and walls by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from affmap.data.batches import read
from affmap.data.collect import DATASET, collect, read_dataset, write_dataset
from affmap.data.settings import Exploration
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.experiments.exp9 import tracking
from affmap.experiments.exp9.figures.reasons import passed
from affmap.experiments.exp9.tracking import track
from affmap.model.stack import ModelSettings, Stack
from affmap.results.files import Trajectories
from affmap.settings import read as read_settings

EXPLORATION = Exploration.load("data", "default", num_sequences=4, num_steps=40, num_validation=2, start="clear")
LAYOUT, VEHICLE = Layout.load("layout", "fog_belt"), Vehicle.load("vehicle", "default")


@pytest.mark.parametrize("kind", ["mlp", "gru"])
def test_tracks_are_those_of_each_member_flown_alone_step_by_step(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Members 3 and 4 of two jobs, and the last two of four sequences, one step at a time."""
    write_dataset(tmp_path, collect([LAYOUT], VEHICLE, EXPLORATION))
    settings = ModelSettings.load(
        "model", "default", transition=read_settings("model/transition", kind), delta_scale=0.25
    )
    stacks = {seed: Stack(settings, len(LAYOUT.channels), (seed,)) for seed in (3, 4)}
    monkeypatch.setattr(tracking, "read_members", lambda store, source, digests, members: (stacks[members[0]], None))
    data = {"data": EXPLORATION.model_dump(mode="json"), "training_layouts": [LAYOUT.model_dump(mode="json")]}
    configs = {tmp_path: data, **{tmp_path / str(seed): {"seed": seed, "members": 1} for seed in stacks}}
    results: Any = SimpleNamespace(provenance={folder: {"config": config} for folder, config in configs.items()})
    setting: Any = SimpleNamespace(data=(tmp_path,), train=(tmp_path / "3", tmp_path / "4"))
    found = track(results, setting)

    arrays, batch = read_dataset(tmp_path / DATASET), read(tmp_path / DATASET)
    errors: list[list[np.ndarray]] = [[], []]
    noise, untouched = [], []
    for sequence in (2, 3):
        reported, true = arrays["position"][sequence], arrays["true_position"][sequence]
        in_fog, since = (reported != true).any(-1), True
        carries = [stack.transition.initial() for stack in stacks.values()]
        for step in range(EXPLORATION.num_steps):
            one = slice(None), slice(sequence, sequence + 1), slice(step, step + 1)
            since = (since or not in_fog[step]) and not arrays["touching"][sequence, step]
            inside = in_fog[step] and in_fog[step + 1]
            for member, stack in enumerate(stacks.values()):
                inputs = stack.encode(batch.views.select(one))[:, :, 0], batch.delta[one][:, :, 0]
                with torch.inference_mode():
                    carries[member], (mean, _) = stack.transition.step()(
                        carries[member], *inputs, batch.action[one][:, :, 0]
                    )
                if inside:
                    errors[member].append(reported[step] + mean[0, 0].numpy() - true[step + 1])
            if inside:
                noise.append(reported[step] - true[step])
                untouched.append(since)
    assert 0 < sum(untouched) < len(untouched), "otherwise nothing is tested"
    np.testing.assert_allclose(found.errors, errors, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found.noise, noise)
    assert found.untouched.tolist() == untouched
    assert found.clear.noise.tolist() == found.noise[untouched].tolist()
    assert found.clear.errors.shape == (2, sum(untouched), 2)


def test_walls_are_passed_in_the_order_of_the_way() -> None:
    """Walls at 1.1 and 1.9 u, with posts of 0.17 u: two runs to the right, two to the left, the last to the goal."""
    ways = [[0.2, 1.26, 0.5], [0.2, 1.28, 1.2], [2.8, 1.0, 1.8], [2.8, 1.5, 0.2]]
    position = np.zeros((4, 3, 2))
    position[..., 0] = ways
    goal = np.array([[2.8, 1.0], [2.8, 1.0], [0.2, 1.0], [0.2, 1.0]])
    reached = np.array([[0, 0], [0, 0], [0, 0], [0, 1]], bool)
    rest: Any = dict.fromkeys(("planned_position", "planned_std", "action", "prediction_error"), np.empty(0))
    flags: Any = dict.fromkeys(("touching", "in_fog"), np.zeros((4, 2), bool))
    runs = Trajectories(position=position, goal=goal, reached=reached, member=np.arange(4), run=np.arange(4),
                        **rest, **flags)  # fmt: skip
    assert passed(runs, LAYOUT).tolist() == [[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 1]]
