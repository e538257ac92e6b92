"""The stage of policies, and control with them."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from affmap.config.compose import compose, values
from affmap.config.root import Config
from affmap.control.controller import Observation
from affmap.data.collect import DATASET, read_dataset
from affmap.env.vehicle import VehicleEnv
from affmap.pipeline import execution
from affmap.pipeline.machine import MachineError, check_rival
from affmap.pipeline.policy import WEIGHTS, load_policy
from affmap.pipeline.stage import CONTROL, TRAIN, control_of, policy_of, stages_of
from affmap.random import integer
from affmap.results.files import read_trajectories
from affmap.rivals.cloning import Cloner
from affmap.rivals.imitation import Imitator
from affmap.rivals.settings import Cloning
from affmap.rivals.td3_bc import Offline

TINY = ["members=3", "scale=smoke", "model.context_size=2", "data.num_sequences=4", "data.num_validation=1"]
TINY += ["data.num_steps=20", "control.num_steps=8", "control.runs_per_member=2", "training.num_epochs=1"]
TINY += ["lookup.spacing=0.25", "report.map_spacing=0.25", "planner.num_candidates=8", "planner.horizon=4"]


def config(folder: Path, *line: str) -> Config:
    whole = values(compose([*TINY, *line]))
    return Config.checked({**whole, "store": folder / "store", "output": folder / "output"}, "test")


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "provenance.json"}


def test_a_policy_is_of_the_sequences_that_models_learn_from(tmp_path: Path) -> None:
    """Trained here on all sequences but the last, which is for validation."""
    own = config(tmp_path, "rival=cloning", "rival.rounds=2", "rival.updates=500")
    setting = execution.run(own)
    assert isinstance(own.rival, Cloning)
    data = {key: part[:3] for key, part in read_dataset(setting.data[0] / DATASET).items()}
    cloner = Cloner(own.rival.scaled(0.002), [0, 1, 2], data)
    cloner.round()
    cloner.round()
    found = load_policy(own, setting.folders["policy"][0])
    assert all(map(torch.equal, cloner.network.parameters(), found.network.parameters()))


@pytest.mark.parametrize("rival", ["cloning", "td3_bc", "distilled"])
def test_a_policy_flies_as_its_network_says(tmp_path: Path, rival: str) -> None:
    """The first steps of the first members, in environments of the test; there is no prediction, and no look-up."""
    own = config(tmp_path, f"rival={rival}", "rival.members=2", "rival.rounds=1")
    setting = execution.run(own)
    policy, flown = load_policy(own, setting.folders["policy"][0]), read_trajectories(setting.control)
    assert flown.member.tolist() == [0, 0, 1, 1]
    layout = own.training_layouts[0]
    envs = [VehicleEnv(layout, own.vehicle) for _ in range(4)]
    sensed = [
        env.reset(seed=integer(member, "start and goal", run), options={"corner": run})[0]
        for env, member, run in zip(envs, flown.member, flown.run, strict=True)
    ]
    for step in range(3):
        action = policy.network.act(Observation.of(sensed)).numpy()
        np.testing.assert_allclose(flown.action[:, step], action, atol=1e-6)
        sensed = [env.step(each)[0] for env, each in zip(envs, action, strict=True)]
    assert np.isnan(flown.prediction_error).all()
    runs = pd.read_csv(setting.control[0] / "runs.csv")
    assert set(runs["planner"]) == {rival} and set(runs["lookup_error"]) == {0.0}


@pytest.mark.parametrize("rival", ["cloning", "td3_bc", "distilled"])
def test_an_interrupted_training_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rival: str
) -> None:
    """An undisturbed one in a process of its own; the second round fails once."""
    line = [f"rival={rival}", "rival.rounds=3"]
    arguments = [*TINY, *line, f"store={tmp_path / 'whole'}", f"output={tmp_path / 'output'}"]
    command = [sys.executable, "-W", "ignore", "-c", "from affmap.cli.run import main; main()", *arguments]
    subprocess.run(command, check=True, cwd=tmp_path, capture_output=True)
    (undisturbed,) = (path for path in (tmp_path / "whole" / "policy").iterdir() if path.suffix == "")
    learner = Offline if rival == "td3_bc" else Imitator
    rounds, whole = [], learner.round

    def failing(self: Any) -> Any:
        rounds.append(self.num_rounds)
        if rounds == [0, 1]:
            raise RuntimeError("power cut")
        return whole(self)

    monkeypatch.setattr(learner, "round", failing)
    own = config(tmp_path, *line)
    with pytest.raises(RuntimeError, match="power cut"):
        execution.run(own)
    setting = execution.run(own)
    assert files(setting.folders["policy"][0]) == files(undisturbed)
    assert rounds == [0, 1, 1, 2] and (undisturbed / WEIGHTS).is_file()


@pytest.mark.parametrize("rival", ["ppo_million", "sac"])
def test_reinforcement_is_a_stage_that_few_members_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rival: str
) -> None:
    """One member of three; its policy, and the runs of this member alone. Once it is trained, its library may go."""
    pytest.importorskip("stable_baselines3")
    own = config(tmp_path, f"rival={rival}", "rival.members=1", "rival.num_steps=20")
    setting = execution.run(own)
    assert len(load_policy(own, setting.folders["policy"][0]).network.layers[0].weight) == 1
    assert set(pd.read_csv(setting.control[0] / "runs.csv")["member"]) == {0}
    monkeypatch.setattr("affmap.pipeline.machine.find_spec", lambda name: None)
    assert execution.run(own) == setting


def test_a_library_that_is_missing_is_named_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is made, with a command that installs it."""
    monkeypatch.setattr("affmap.pipeline.machine.find_spec", lambda name: None)
    with pytest.raises(MachineError, match=r"rival = 'ppo' needs a package .* pip install .*, or leave it out"):
        execution.run(config(tmp_path, "rival=ppo"))
    assert not (tmp_path / "store").exists()


def test_a_library_is_needed_only_to_train(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages that are planned, with and without the policy."""
    monkeypatch.setattr("affmap.pipeline.machine.find_spec", lambda name: None)
    own = config(tmp_path, "rival=sac")
    planned = stages_of(own)
    check_rival(own, [stage for stage in planned if stage.name != "policy"])
    with pytest.raises(MachineError, match=r"rival = 'sac' needs a package"):
        check_rival(own, planned)


CHANGES = {
    "data.seed=1": {"cloning", "td3_bc", "distilled"},
    "model.context_size=3": {"distilled"},
    "planner.num_iterations=2": {"distilled"},
    "control.beta=2": {"distilled"},
    "training_layouts=[two_obstacles]": {"cloning", "td3_bc", "distilled", "ppo", "sac"},
    "vehicle.mass=0.2": {"cloning", "td3_bc", "distilled", "ppo", "sac"},
    "seed=3": {"cloning", "td3_bc", "distilled", "ppo", "sac"},
    "rival_share=0.5": {"cloning", "td3_bc", "distilled", "ppo", "sac"},
    "control_layout=two_obstacles": set(),
    "report.map_spacing=0.1": set(),
}
"""A change of the configuration, and the policies that must be trained anew."""


@pytest.mark.parametrize("change", CHANGES)
def test_a_policy_depends_on_its_source_alone(tmp_path: Path, change: str) -> None:
    """The table above; control, which flies it, depends on all of them, and on the version of its training."""
    anew = set()
    for rival in ("cloning", "td3_bc", "distilled", "ppo", "sac"):
        before, after = config(tmp_path, f"rival={rival}"), config(tmp_path, f"rival={rival}", change)
        one, other = policy_of(before), policy_of(after)
        assert one and other
        if one.of(before).digest != other.of(after).digest:
            anew.add(rival)
            assert control_of(before).of(before).digest != control_of(after).of(after).digest
    assert anew == CHANGES[change]


def test_without_a_rival_stages_are_those_of_before(tmp_path: Path) -> None:
    """No policy, and control as it always was."""
    own, rival = config(tmp_path), config(tmp_path, "rival=distilled")
    assert control_of(own) is CONTROL and policy_of(own) is None
    names = [stage.name for stage in stages_of(own)]
    assert [stage.name for stage in stages_of(rival)] == [*names[:-1], "policy", "control"]
    assert TRAIN.of(own).digest == TRAIN.of(rival).digest
