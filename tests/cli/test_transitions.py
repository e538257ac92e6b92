"""A sweep over both kinds of transition models, by the real commands at the tiniest scale: one report, one store."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import command, in_process, jobs, line

import affmap
from affmap import pipeline
from affmap.cli.app import read_sweep
from affmap.model.gru import GRU
from affmap.model.transition import MLP
from affmap.pipeline.completed import completed
from affmap.pipeline.stage import CONTROL, TRAIN
from affmap.results.setting import make_factor
from affmap.settings import ConfigError

SWEEP = ["model/transition=mlp,gru", "planner=cem,gradient", "model.context_size=0,1"]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("swept")
    result = command(folder, *SWEEP)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


def report(folder: Path, monkeypatch: pytest.MonkeyPatch, *overrides: str) -> int:
    monkeypatch.chdir(folder)
    return in_process(monkeypatch, "affmap-report", line(folder, *SWEEP, *overrides))


def test_the_perceptrons_stages_are_those_of_configurations_without_the_key(tmp_path: Path) -> None:
    """Digests, and the plain values that they are of; the recurrent ones are others."""
    (plain,) = jobs(tmp_path, "planner=cem")
    mlp, gru = jobs(tmp_path, "model/transition=mlp,gru")
    for stage in (TRAIN, CONTROL):
        assert stage.of(plain).digest == stage.of(mlp).digest != stage.of(gru).digest
        assert "transition" not in stage.of(mlp).config["model"]
        assert stage.of(gru).config["model"]["transition"] == {"kind": "gru"}


def test_two_processes_make_the_same_bytes(swept: Path, tmp_path: Path) -> None:
    """Fresh ones: every file of the recurrent models' stages, but for times and places."""
    result = command(tmp_path, *SWEEP[1:2], "model/transition=gru", "model.context_size=1")
    assert result.returncode == 0, result.stdout + result.stderr
    paths = [path for path in tmp_path.glob("store/*/*/*") if path.is_file() and path.name != "provenance.json"]
    assert {path.parent.parent.name for path in paths} == {"data", "train", "predict", "map", "control"}
    for path in paths:
        assert path.read_bytes() == (swept / path.relative_to(tmp_path)).read_bytes(), path


def test_both_kinds_are_in_one_report(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Told by colour, with readable names; the medians are those of the runs, by hand."""
    assert report(swept, monkeypatch, "planner=cem", "output=colors") == 0, capsys.readouterr().err
    runs = pd.read_csv(swept / "colors/tables/runs.csv")
    medians = pd.read_csv(swept / "colors/tables/medians.csv").query("metric == 'mean_distance'")
    expected = runs.groupby(["model_transition", "context_size"])["mean_distance"].median()
    found = medians.replace({"MLP": "mlp", "GRU": "gru"}).set_index(["model_transition", "context_size"])["center"]
    assert found.sort_index().to_dict() == pytest.approx(expected.sort_index().to_dict())
    text = (swept / "colors/report.html").read_text("utf-8")
    assert "GRU" in text and "MLP" in text and "transition = gru" not in text
    settings = completed(read_sweep(line(swept, *SWEEP, "planner=cem"))).settings
    assert [setting.values["model.transition"] for setting in settings] == 2 * ["mlp"] + 2 * ["gru"]
    assert make_factor("model.transition").column == "model_transition"


def test_one_kind_is_compared_with_the_other(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table of differences, whose means are those of the runs, by hand; losses are compared, too."""
    overrides = ["report.compare=model.transition", "output=compared"]
    assert report(swept, monkeypatch, *overrides) == 0, capsys.readouterr().err
    table = pd.read_csv(swept / "compared/tables/model_transition.csv")
    assert set(table["a"]) == {"mlp"} and set(table["b"]) == {"gru"} and "validation_nll" in set(table["metric"])
    runs = pd.read_csv(swept / "compared/tables/runs.csv").replace({"cem": "EB", "gradient": "GB"})
    means = runs.groupby(["planner", "context_size", "model_transition"])["mean_distance"].mean().unstack()
    found = table.query("metric == 'mean_distance'").set_index(["planner", "context_size"])
    np.testing.assert_allclose(found["mean_b"] - found["mean_a"], found["difference"], atol=1e-5)
    np.testing.assert_allclose(found[["mean_a", "mean_b"]], means.loc[found.index, ["mlp", "gru"]], atol=1e-5)
    assert "| MLP, GRU |" in (swept / "compared/tables/model_transition.md").read_text("utf-8")
    assert (swept / "compared/figures/model_transition.png").is_file()
    assert report(swept, monkeypatch, *overrides, "--check") == 0


def test_an_agent_of_either_kind_flies_what_was_recorded(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Chosen by its kind; the same starts, goals and plans, so the same paths, to rounding."""
    assert report(swept, monkeypatch, "planner=cem") == 0, capsys.readouterr().err
    record = json.loads((swept / "output/provenance.json").read_text("utf-8"))
    assert {job["model_transition"] for job in record["jobs"]} == {"mlp", "gru"}
    for kind, model in (("mlp", MLP), ("gru", GRU)):
        (config,) = jobs(swept, "model.context_size=1", f"model/transition={kind}")
        job = pipeline.find(config)
        assert job is not None
        recorded = np.load(job.control[0] / "trajectories.npz")
        agent = affmap.load(swept / "output", context_size=1, members=(0, 1), transition=kind)
        assert isinstance(agent.stack.transition, model)
        runs = affmap.fly(agent, "original")
        for key in ("position", "action", "planned_position", "prediction_error"):
            np.testing.assert_allclose(runs.trajectories[key], recorded[key], atol=1e-4)
    assert isinstance(affmap.load(swept / "output", context_size=1).stack.transition, MLP)
    with pytest.raises(ConfigError, match="has the transition models mlp, gru; none is 'lstm'"):
        affmap.load(swept / "output", context_size=1, transition="lstm")


def test_a_model_too_large_for_any_machine_is_refused(tmp_path: Path) -> None:
    """The weights of a recurrent model grow with the square of its hidden units; those of a perceptron do not."""
    large = ["model.hidden_size=200000", "training.batch_size=1", "training.chunk_length=1"]
    jobs(tmp_path, "model/transition=mlp", *large)
    with pytest.raises(ConfigError, match=r"model.hidden_size = 200000: the models would take .* GiB"):
        jobs(tmp_path, "model/transition=gru", *large)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("model=typo", r"model = 'typo' does not exist; there are: default\.$"),
        ("model/transition=typo", r"there are: additive, gatel0rd, gru, hyper, mlp, split, split_channels\.$"),
        ("model.transition=gru", "choose one by model/transition=gru"),
    ],
)
def test_a_mistake_in_the_choice_is_told_with_the_options(tmp_path: Path, wrong: str, message: str) -> None:
    """Golden parts: the files of a group inside another are no options of that one."""
    with pytest.raises(ConfigError, match=message):
        jobs(tmp_path, wrong)
