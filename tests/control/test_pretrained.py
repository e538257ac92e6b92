"""Agents from runs: against the files they come from, and the flights that the runs themselves have recorded."""

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from commands import command, in_process, jobs, line
from safetensors.torch import load_file

import affmap
from affmap import pipeline
from affmap.control import Protocol, pretrained, scoring
from affmap.env.procedural import Procedural
from affmap.experiments import ROOMS, is_of_paper
from affmap.model.lookup import AffordanceMap
from affmap.model.weights import WEIGHTS
from affmap.planning.cem import CEMPlanner
from affmap.random import generator
from affmap.results.files import read_validation
from affmap.settings import ConfigError
from affmap.store.stage import StoreError

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def test_a_reference_agent_is_what_was_published() -> None:
    """Weights against the file, settings against what the report says, the world against `conf/layout`."""
    record = json.loads((ROOT / "runs/reference/exp4/provenance.json").read_text("utf-8"))
    (digest,) = next(job for job in record["jobs"] if job["context_size"] == 8)["train"]
    weights = load_file(ROOT / "runs/reference/store/train" / digest / WEIGHTS)
    agent = affmap.load("exp4", context_size=8, members=(3, 11))
    for name, weight in agent.stack.state_dict().items():
        torch.testing.assert_close(weight, weights[name][[3, 11]], rtol=0, atol=0)
    assert agent.seeds == (3, 11) and agent.settings.beta == 10
    assert isinstance(agent.planner, CEMPlanner) and agent.planner.num_iterations == 5
    assert isinstance(agent.lookup, AffordanceMap)
    assert agent.lookup.worlds == [affmap.Layout.load("layout", "fog").map]


def test_all_members_can_be_loaded_without_their_seeds(tmp_path: Path) -> None:
    """The 25 of an experiment; of a saved agent, those that it has."""
    assert affmap.load("exp1", context_size=0, members="all").seeds == tuple(range(25))
    affmap.load("exp1", context_size=0, members=(2, 5)).save(tmp_path / "mine")
    assert affmap.load(tmp_path / "mine", members="all").seeds == (2, 5)


def test_a_planner_can_be_named_or_given() -> None:
    """The configuration's own; and one that was made."""
    assert affmap.load("exp1", planner="gradient").planner == affmap.GradientPlanner.load("planner", "gradient")
    own = affmap.CEMPlanner.load("planner", "cem", horizon=7)
    assert affmap.load("exp1", planner=own).planner is own
    few = affmap.load("exp1", planner={"num_iterations": 3}).planner
    assert isinstance(few, CEMPlanner) and few == affmap.CEMPlanner.load("planner", "cem", num_iterations=3)


def test_in_random_worlds_it_is_in_the_first_that_its_member_flew_in() -> None:
    agent = affmap.load("exp5", members=(2,))
    world = Procedural.load("layout", "procedural_easy").draw(generator(2, "world", 0))
    assert isinstance(agent.lookup, AffordanceMap) and agent.lookup.worlds == [world.map]


def test_everything_of_the_reference_run_can_be_flown() -> None:
    """Each experiment, each context size; beyond the paper there is at least C = 8."""
    assert pretrained.experiments() == sorted(ROOMS)
    for name in pretrained.experiments():
        origin = pretrained.origin(name)
        assert ({0, 1, 3, 5, 8} if is_of_paper(name) else {8}) <= set(origin.context_sizes)
        for size in origin.context_sizes:
            agent = affmap.load(name, context_size=size)
            assert (agent.stack.context_size, agent.stack.num_channels) == (size, len(origin.channels))


def test_transition_models_have_the_names_by_which_the_sweep_chose_them() -> None:
    """Two of Experiment VI are of one kind, and differ in their codes."""
    encoders = {"mlp": "plain", "hyper": "centered", "split": "centered", "split_channels": "channels"}
    for name, encoder in encoders.items():
        vision = affmap.load("exp6", transition=name, members=(201,)).stack.vision
        assert vision is not None and vision.encoder == encoder
    listed = r"has the transition models mlp, hyper, additive, split, split_channels \(given\); none is 'gru'\.$"
    with pytest.raises(ConfigError, match=listed):
        affmap.load("exp6", transition="gru")
    for name, encoder in (("mlp", "plain"), ("split_one_radius", "centered"), ("given", "channels")):
        assert affmap.load("exp6_radii", transition=name, members=(301,)).stack.vision.encoder == encoder
    with pytest.raises(
        ConfigError, match=r"models offline, random, deviation, disagreement, information; none is 'mlp'"
    ):
        affmap.load("exp8", transition="mlp")
    with pytest.raises(
        ConfigError, match=r"models mlp; none is 'ppo'\. Its rivals, distilled, .*ppo, .* affmap rival="
    ):
        affmap.load("exp10", transition="ppo")
    losses = {kind: affmap.load("exp8", transition=kind).losses for kind in ("offline", "disagreement")}
    assert losses["offline"] is not None and not losses["offline"].equals(losses["disagreement"])
    listed = r"models mlp_one_radius \(MLP \(one\)\), mlp, .*, split, given; none is 'split_channels'"
    with pytest.raises(ConfigError, match=listed):
        affmap.load("exp6_radii", transition="split_channels")


def test_transition_models_have_their_names_in_the_report_too() -> None:
    """Each is the one of the sweep's name; a name of the sweep comes first."""
    for source, name, meant in [
        ("exp6", "given", "split_channels"),
        ("exp6", "MLP", "mlp"),
        ("exp6_radii", "split (one)", "split_one_radius"),
        ("exp6_radii", "given", "given"),
    ]:
        one, other = (affmap.load(source, transition=each).stack for each in (name, meant))
        assert one.settings == other.settings
        for weight, same in zip(one.state_dict().values(), other.state_dict().values(), strict=True):
            assert torch.equal(weight, same)


def test_agents_show_their_transition_models_and_codes() -> None:
    """The two split models of Experiment VI differ in their codes only."""
    shown = {name: repr(affmap.load("exp6", transition=name)) for name in ("mlp", "split", "given")}
    assert [text.split(", ")[2] for text in shown.values()] == ["mlp", "split (centered)", "split (channels)"]


def test_what_comes_with_the_package_can_be_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files that a wheel gets besides the code, alone in a folder: less than a MiB, found and whole."""
    build = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["build"]
    included = build["targets"]["wheel"]["force-include"]
    files = {source: place for source, place in included.items() if place.startswith("affmap/reference/")}
    for source, place in files.items():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / source, tmp_path / place)
    weights = tmp_path.rglob("*.safetensors")
    assert sum(path.stat().st_size for path in weights) < 2**20
    for module in (pretrained, scoring):
        monkeypatch.setattr(module, "reference", lambda: tmp_path / "affmap/reference")
    monkeypatch.setattr(Protocol, "fly", None)  # the ends of the scale need no flight
    oracle, random = scoring.references(Protocol())
    assert oracle["success"].mean() > 0.9 and random["success"].mean() < 0.1
    for name, sizes in {"exp1": [0, 1, 3, 5, 8], "exp2": [0, 1, 3, 5, 8], "exp4": [0, 8], "exp5": [0, 8]}.items():
        assert pretrained.origin(name).context_sizes == sizes
        for size in sizes:
            assert affmap.load(name, context_size=size).losses is None
    with pytest.raises(ConfigError, match=r"has models of the context sizes \[0, 8\], and none of 3"):
        affmap.load("exp4", context_size=3)
    with pytest.raises(
        ConfigError, match=r"models of exp3 are not here: .* exp1, exp2, exp4, exp5; a clone .* has all\.$"
    ):
        affmap.load("exp3")


SWEEP = ["members=1", "vehicle.thrust=0.7", "vehicle.radius=0.05"]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep in a vehicle of its own, whose members were divided among two jobs, with its report."""
    folder = tmp_path_factory.mktemp("ran")
    sweep = [*SWEEP, "model.context_size=0,1", "seed=0,1"]
    result = command(folder, *sweep)
    assert result.returncode == 0, result.stdout + result.stderr
    with pytest.MonkeyPatch.context() as patch:
        assert in_process(patch, "affmap-report", line(folder, *sweep)) == 0
    return folder


def test_an_agent_of_a_run_flies_what_the_run_has_recorded(ran: Path) -> None:
    """The same starts, goals, plans and vehicle, so the same paths, to rounding."""
    for seed in (0, 1):
        (config,) = jobs(ran, *SWEEP, "model.context_size=1", f"seed={seed}")
        job = pipeline.find(config)
        assert job is not None
        recorded = np.load(job.control[0] / "trajectories.npz")
        agent = affmap.load(ran / "output", context_size=1, members=(seed,))
        runs = affmap.fly(agent, "original")
        for key in ("position", "goal", "action", "planned_position"):
            np.testing.assert_allclose(runs.trajectories[key], recorded[key], atol=1e-5)
        assert agent.vehicle == pretrained.origin(ran / "output").vehicle == config.vehicle
        pd.testing.assert_frame_equal(agent.losses, read_validation(job.train[0]))


def test_a_mistake_is_told(ran: Path) -> None:
    for arguments, told in (
        (
            {"source": "exp0"},
            r"^exp0 does not exist, and is none of .* exp1, .*, exp2, .* exp7_doors, .*\.$",
        ),
        ({"source": "./nothing"}, r"^\./nothing does not exist, and is none of"),
        ({"source": ran}, "is neither the folder of an experiment's report, nor that of a saved agent, nor one of"),
        ({"source": ""}, r"^source = '' is not allowed; give a folder, or the name of an experiment"),
        ({"source": 3}, r"^source = 3 is not allowed; give a folder, or the name of an experiment, such as 'exp1'\.$"),
        ({"source": ran / "output", "context_size": "1"}, r"and none of '1'\.$"),
        ({"source": ran / "output", "context_size": 3}, r"has models of the context sizes \[0, 1\], and none of 3"),
        ({"source": ran / "output", "context_size": 1, "members": (0, 1)}, r"members = \[0, 1\] .* one job only"),
        ({"source": "exp1", "members": (25,)}, r"^members = \[25\] is not allowed: exp1 has \[0, 1, "),
        (
            {"source": "exp1", "members": ()},
            r"^members = \(\) is not allowed; give at least one seed, such as \(0,\)\.$",
        ),
        ({"source": "exp1", "context_size": 4}, r"^exp1 has models of the context sizes \[0, 1, 3, 5, 8\], and none"),
        (
            {"source": "exp1", "members": 3},
            r"^members = 3 is not allowed; give the seeds .*, or 'all'\.$",
        ),
        ({"source": "exp1", "members": "every"}, r"^members = 'every' is not allowed; give the seeds"),
        ({"source": "exp1", "members": (0.5,)}, r"^members = \(0\.5,\) is not allowed; give the seeds"),
        ({"source": "exp1", "members": (1, 1)}, r"^members = \(1, 1\) names a member twice; give each seed once\.$"),
        ({"source": "exp1", "planner": "pid"}, "conf/planner holds: cem, gradient"),
        ({"source": "exp1", "planner": 3}, r"^planner = 3 is not allowed: give some of its keys and values, such as"),
        ({"source": "exp1", "planner": CEMPlanner}, r"^planner = <class '.*CEMPlanner'> is not allowed: give some"),
        ({"source": "exp1", "planner": {"iterations": 3}}, r"^load: planner\.iterations = 3 is not a known key"),
    ):
        with pytest.raises(ConfigError, match=told):
            affmap.load(**arguments)


def test_corrupted_weights_are_reported(ran: Path, tmp_path: Path) -> None:
    shutil.copytree(ran, tmp_path / "copy")
    for path in (tmp_path / "copy").rglob(WEIGHTS):
        path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(StoreError, match=r"weights\.safetensors is corrupted or missing; remove the folder"):
        affmap.load(tmp_path / "copy/output", context_size=1)


def test_a_world_with_other_channels_cannot_be_seen() -> None:
    with pytest.raises(ConfigError, match=r"'four_properties' has channels .* the agent was trained with \['solid'\]"):
        affmap.fly(affmap.load("exp1"), "four_properties")
    swapped = affmap.Layout.load("layout", "fog", channels=["border", "fog"])
    with pytest.raises(ConfigError, match=r"\['border', 'fog'\], and the agent was trained with \['fog', 'border'\]"):
        affmap.fly(affmap.load("exp4"), swapped)


def test_the_conditions_of_experiment_3_have_models_of_their_own() -> None:
    """What they see."""
    assert affmap.load("exp3").channels == ("solid",)
    hard = affmap.load("exp3", layout="three_looks")
    assert hard.channels == ("upper", "lower", "meaningless") and hard.stack.num_channels == 3
    with pytest.raises(ConfigError, match="has flights in original, three_looks, and none in 'fog'"):
        affmap.load("exp3", layout="fog")


def test_without_its_store_a_report_has_no_models(ran: Path, tmp_path: Path) -> None:
    shutil.copytree(ran / "output", tmp_path / "output")
    with pytest.raises(ConfigError, match=r"has no models: its store, .*store, is not there"):
        affmap.load(tmp_path / "output", context_size=1)


def test_in_random_worlds_it_flies_in_the_first() -> None:
    """As `control` draws it."""
    runs = affmap.fly(affmap.load("exp5", members=(1,)), "procedural_easy")
    assert len(runs.table) == 4
