"""Agents of several kinds in one sweep and one report, at the tiniest scale."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from commands import in_process, jobs, line

from affmap import pipeline
from affmap.cli.app import read_sweep
from affmap.config.root import label
from affmap.control.episodes import control
from affmap.control.filter import Filter
from affmap.control.oracle import HalfOracle, Oracle
from affmap.pipeline import control as stage
from affmap.pipeline.completed import completed
from affmap.pipeline.job import agents_without_models
from affmap.results.tables import Results

AGENTS = ["agent=planner,random,straight", "model.context_size=1"]


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The three agents with one model, flown and reported."""
    folder, threads = tmp_path_factory.mktemp("agents"), torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert in_process(patch, "affmap", ["-m", *line(folder, *AGENTS)]) == 0
        assert in_process(patch, "affmap-report", line(folder, *AGENTS)) == 0
    torch.set_num_threads(threads)  # `run` sets the number of threads of its process
    return folder


def test_agents_share_everything_but_control(swept: Path) -> None:
    """One data set, training and map; a folder for each job, that of a planner named as before there were agents."""
    made = [path.parent.name for path in (swept / "store").glob("*/*") if path.is_dir()]
    assert {name: made.count(name) for name in made} == {"data": 1, "train": 1, "predict": 1, "map": 1, "control": 3}
    folders = {path.name for path in (swept / "output/jobs").iterdir() if path.is_dir()}
    assert folders == {"0_context1_cem", "1_context1_random", "2_context1_straight"}


def test_the_default_agent_is_in_no_stage_s_configuration(swept: Path) -> None:
    """Stages from before there were agents are still found; others have theirs."""
    agents = []
    for config in jobs(swept, *AGENTS):
        job = pipeline.find(config)
        assert job is not None
        agents.append(json.loads((job.control[0] / "provenance.json").read_text())["config"].get("agent"))
    assert agents == [None, {"kind": "random"}, {"kind": "straight", "foresight": 8.0, "slow_distance": 0.3}]


def test_models_that_only_serve_a_report_are_announced(swept: Path) -> None:
    """By hand: models that are there, models that another agent of the sweep uses, and two agents alone."""
    other = "model.context_size=3"
    assert agents_without_models(jobs(swept, *AGENTS)) == []
    assert agents_without_models(jobs(swept, "agent=planner,oracle", other)) == []
    assert agents_without_models(jobs(swept, "agent=straight,oracle,true_mean", other)) == []
    assert agents_without_models(jobs(swept, "agent=straight,oracle", other)) == ["oracle", "straight"]


def test_the_tables_tell_agents_apart(swept: Path) -> None:
    """On the same starts and goals; who predicts nothing has empty cells, and nothing else is lacking."""
    runs = pd.read_csv(swept / "output/tables/runs.csv")
    assert runs.groupby("planner").size().to_dict() == {"cem": 8, "random": 8, "straight": 8}
    starts = runs.pivot(index=["member", "run"], columns="planner", values=["start_x", "start_y", "goal_x", "goal_y"])
    for key in ("start_x", "start_y", "goal_x", "goal_y"):
        assert (starts[key].nunique(axis=1) == 1).all()
    lacking = runs.groupby("planner")["prediction_error"].apply(lambda errors: errors.isna().mean())
    assert lacking.to_dict() == {"cem": 0.0, "random": 1.0, "straight": 1.0}
    assert not runs.drop(columns=["prediction_error", "steps_to_reach"]).isna().any(axis=None)
    medians = pd.read_csv(swept / "output/tables/medians.csv").set_index(["metric", "planner"])["center"]
    assert np.isnan(medians["prediction_error", "straight"]) and medians["mean_distance", "straight"] > 0


def test_the_report_shows_all_of_them(swept: Path) -> None:
    """All figures; runs of each agent to be played; no sentence about what nobody predicted."""
    figures = {path.stem for path in (swept / "output/figures").glob("*.png")}
    assert {"results", "trajectories", "maps", "world", "exploration", "outcomes"} <= figures
    page = (swept / "output/report.html").read_text("utf-8")
    for name in ("EB", "random", "straight"):
        assert f'"original", "{name}", "1", "run 0 of member 0"' in page
    assert "Median prediction error (EB)" in page and "Median prediction error (random)" not in page


def test_a_report_of_agents_without_a_model_is_drawn(swept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fog, which has a figure of failures, and a world for each run, where that has errors of steps."""
    monkeypatch.chdir(swept)
    overrides = [
        *("agent=random,straight", "world=training_fog", "control_layout=procedural_easy", "model.context_size=0"),
        f"output={swept / 'without'}",
    ]
    arguments = [*line(swept)[:-1], *overrides]
    assert in_process(monkeypatch, "affmap", ["-m", *arguments]) == 0
    assert in_process(monkeypatch, "affmap-report", arguments) == 0
    assert (swept / "without/figures/failures.png").is_file()
    page = (swept / "without/report.html").read_text("utf-8")
    assert "One moment of each run by “random”" in page


def test_agents_can_be_compared_one_with_the_other(swept: Path, tmp_path: Path) -> None:
    """The default agent among them, whose key is in no stage; differences by hand from the table of runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(swept)
        asked = [*line(swept, *AGENTS), "report.compare=agent", f"output={tmp_path / 'compared'}"]
        assert in_process(patch, "affmap-report", asked) == 0
    table = pd.read_csv(tmp_path / "compared/tables/agent.csv").query("metric == 'mean_distance'").set_index("b")
    means = pd.read_csv(swept / "output/tables/runs.csv").groupby("planner")["mean_distance"].mean()
    assert set(table["a"]) == {"planner"} and set(table.index) == {"random", "straight"}
    for agent, difference in table["difference"].items():
        assert difference == pytest.approx(means[agent] - means["cem"])


@pytest.mark.parametrize(
    ("name", "kind", "true_mean"),
    [
        ("oracle", Oracle, None),
        ("seen", Oracle, None),
        ("filter", Filter, None),
        ("true_mean", HalfOracle, True),
        ("true_deviation", HalfOracle, False),
    ],
)
def test_agents_that_know_the_physics_are_flown_by_the_pipeline(
    swept: Path, name: str, kind: type[Oracle], true_mean: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The right class with the file's number and the job's planner, in the job's world; tables name it by its kind."""
    (config,) = jobs(swept, "model.context_size=1", f"agent={name}", "planner.num_iterations=2", "agent.std=0.01")
    flying: list[Any] = []

    def remember(controller: Any, *arguments: Any) -> Any:
        flying.append(controller)
        return control(controller, *arguments)

    monkeypatch.setattr(stage, "control", remember)
    threads = torch.get_num_threads()
    job = pipeline.run(config)
    torch.set_num_threads(threads)
    (controller,) = flying
    assert type(controller) is kind and (controller.planner, controller.settings) == (config.planner, config.control)
    assert (controller.vehicle, controller.step_std) == (config.vehicle, 0.01)
    assert getattr(controller, "true_mean", None) is true_mean
    runs = pd.read_csv(job.control[0] / "runs.csv")
    assert set(runs["planner"]) == {name} and len(runs) == 8
    assert runs[["prediction_error", "mean_distance"]].notna().all(axis=None)
    assert job.planner == name and label(config) == f"original, context size 1, {name}, map of 0.25 u"
    origin = json.loads((job.control[0] / "provenance.json").read_text())["config"]
    assert origin["agent"] == {"kind": name, "std": 0.01}
    beside = pipeline.find(jobs(swept, "model.context_size=1")[0])
    assert beside is not None and (job.train, job.map) == (beside.train, beside.map)


def test_an_agent_without_a_planner_stands_once_beside_several_planners(tmp_path: Path) -> None:
    """It flies the same whatever planner is named: three settings of four jobs."""
    both = line(tmp_path, "planner=cem,gradient", "agent=planner,random", "model.context_size=1")
    for config in jobs(tmp_path, "planner=cem,gradient", "agent=planner,random", "model.context_size=1"):
        pipeline.run(config)
    settings = completed(read_sweep(both)).settings
    assert [setting.planner for setting in settings] == ["cem", "random", "gradient"]
    results = Results(settings)
    results.check_factors()
    assert results.color_values == ["cem", "gradient", "random"]
