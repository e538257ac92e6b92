"""Reports of sweeps over any two keys, and metrics that came later: real sweeps at the tiniest scale."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import in_process, jobs, line
from contents import content_of, table_of
from stage_files import write_stages

from affmap import pipeline
from affmap.cli.app import read_sweep
from affmap.pipeline.completed import completed
from affmap.report import build
from affmap.report.experiment import ExperimentReport, Room
from affmap.results.files import Trajectories, read_trajectories
from affmap.results.metrics import METRICS, Metric
from affmap.results.numbers import NOTHING
from affmap.results.scores import medians
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, ReportSettings, Setting, make_factor
from affmap.results.tables import Results
from affmap.settings import ConfigError

SWEEP = ["world=fog", "model.context_size=1", "control.beta=0,1,10", "planner=cem,gradient", "training.num_epochs=1"]
FIGURES = {"results", "trajectories", "maps", "world", "exploration", "outcomes", "failures", "steps"}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete sweep over the weight on uncertainty and the planner; all settings share a training."""
    folder = tmp_path_factory.mktemp("swept")
    for config in jobs(folder, *SWEEP):
        pipeline.run(config)
    return folder


def report(
    swept: Path, output: Path, monkeypatch: pytest.MonkeyPatch, *overrides: str, entry: str = "affmap-report"
) -> int:
    monkeypatch.chdir(swept)
    return in_process(monkeypatch, entry, [*line(swept), *SWEEP, f"output={output}", *overrides])


def test_a_sweep_over_beta_and_planner_has_a_full_report(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every figure and table; beta on the x axis, planners by colour; medians by hand from the table of runs."""
    output = tmp_path / "beta"
    assert report(swept, output, monkeypatch) == 0, capsys.readouterr().err
    assert {path.stem for path in output.glob("figures/*.png")} == FIGURES
    runs = pd.read_csv(output / "tables/runs.csv")
    assert runs.groupby(["control_beta", "planner"]).size().to_dict() == dict.fromkeys(
        [(beta, planner) for beta in (0, 1, 10) for planner in ("cem", "gradient")], 2 * 4
    )
    medians = pd.read_csv(output / "tables/medians.csv").query("metric == 'mean_distance'")
    expected = runs.groupby(["planner", "control_beta"])["mean_distance"].median()
    found = medians.replace({"EB": "cem", "GB": "gradient"}).set_index(["planner", "control_beta"])["center"]
    assert found.sort_index().to_dict() == pytest.approx(expected.to_dict())
    text = (output / "report.html").read_text("utf-8")
    for words in ("beta = 0", "beta = 10", "beta 0, 1, 10", "at beta = 1"):
        assert words in text, words
    assert report(swept, output, monkeypatch, "--check") == 0


def test_the_factors_can_be_chosen(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The other way around: planners on the x axis, beta by colour; a key that does not vary is refused."""
    chosen = ["report.x=planner", "report.color=control.beta"]
    assert report(swept, tmp_path / "turned", monkeypatch, *chosen) == 0, capsys.readouterr().err
    assert "beta = 10" in (tmp_path / "turned/report.html").read_text("utf-8")
    assert report(swept, tmp_path / "wrong", monkeypatch, "report.x=control.goal_radius") == 2
    assert "report.x = 'control.goal_radius' is not a key that varies here" in capsys.readouterr().err


def test_factors_follow_from_the_sweep(swept: Path, tmp_path: Path) -> None:
    """By hand: the context size comes first, then numbers; one of two keys that say the same is left out."""
    settings = completed(read_sweep([*line(swept), *SWEEP])).settings
    results = Results(settings)
    assert (results.x, results.color) == (make_factor("control.beta"), PLANNER)
    assert results.x_values == [0, 1, 10] and results.color_values == ["cem", "gradient"]
    for experiment, color in {"exp1": "planner", "exp3": "control_layout", "exp5": "control_layout"}.items():
        small = Results(tuple(write_stages(tmp_path, (0, 8), members=1, epochs=1, experiment=experiment)))
        assert (small.x, small.color.key) == (CONTEXT_SIZE, color)
    worlds = write_stages(tmp_path, (8,), planners=("cem", "gradient"), members=1, epochs=1, experiment="exp2")
    names = Results(tuple(worlds))
    assert (names.x.key, names.color) == ("control_layout", PLANNER)
    assert names.x_values == ["original", "two_obstacles", "twelve_obstacles"]
    assert list(dict.fromkeys(names.runs["layout"])) == names.x_values
    names.check_factors()


def test_more_than_two_keys_are_refused_with_a_remedy(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for config in jobs(swept, *SWEEP, "planner=cem", "control.goal_radius=0.1,0.2", "control.beta=0,1"):
        pipeline.run(config)
    three = ["control.goal_radius=0.1,0.2", "control.beta=0,1"]
    monkeypatch.chdir(tmp_path)
    for config in jobs(swept, *SWEEP, *three):
        pipeline.run(config)
    assert report(swept, tmp_path / "three", monkeypatch, *three) == 2
    assert "several values of control.goal_radius, too; give one, such as control.goal_radius=0.1" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("experiment", "planners", "sizes", "chosen"),
    [
        ("exp2", ("cem", "gradient"), (8,), (None, None)),
        ("exp2", ("cem", "gradient"), (8,), ("planner", None)),
        ("exp3", ("cem",), (0, 8), ("control_layout", None)),
        ("exp4", ("cem", "gradient"), (8,), ("planner", None)),
        ("exp1", ("cem", "gradient"), (0, 8), (None, "model.context_size")),
    ],
)
@pytest.mark.filterwarnings("error")
def test_every_choice_of_factors_is_drawn(
    tmp_path: Path, experiment: str, planners: tuple[str, ...], sizes: tuple[int, ...], chosen: tuple[str | None, ...]
) -> None:
    """Names on the x axis, or sizes by colour: every figure, no warning of its layout, medians in every column."""
    settings = ReportSettings.load("report", "default")
    written = write_stages(tmp_path, sizes, planners=planners, members=2, epochs=2, experiment=experiment)
    results = Results(tuple(written), None, *chosen)
    told = {"name": "mine", "title": "Mine", "command": "affmap"}
    report = ExperimentReport(tmp_path / "out", results, settings, Room(), **told, notice=None)
    build.write(report)
    _, rows = table_of(content_of(results, settings).medians())
    shown = len({factor.column for factor in (results.color, PLANNER, LAYOUT)} - {results.x.column})
    assert all(len(row) == 1 + shown + 1 + len(results.x_values) for row in rows)
    assert all(value != NOTHING for row in rows for value in row[-len(results.x_values) :])


def test_policies_have_no_validation_loss_of_the_models(tmp_path: Path) -> None:
    """Beside agents that share a training with them, in the table of medians."""
    stages = write_stages(tmp_path, (8,), planners=("cem", "gradient"), members=2, epochs=1)
    policies = [
        Setting(each.values, {**each.folders, "policy": each.control}) if each.planner == "gradient" else each
        for each in stages
    ]
    for settings, is_blank in ((stages, False), (policies, True)):
        content = content_of(Results(tuple(settings), None, "planner"), ReportSettings.load("report", "default"))
        _, (loss, *others) = table_of(content.medians())
        assert (loss[-1] == NOTHING) == is_blank and loss[-2] != NOTHING
        assert all(NOTHING not in row[-2:] for row in others)


def test_one_key_cannot_be_both_factors(tmp_path: Path) -> None:
    results = Results(tuple(write_stages(tmp_path, (0, 8), members=1, epochs=1)), None, "planner", "planner")
    with pytest.raises(ConfigError, match=r"report.x and report.color are both 'planner'; name two keys"):
        results.check_factors()


def test_the_spacing_of_look_ups_is_a_factor_like_others(tmp_path: Path) -> None:
    """Its column is in the table of a stage; medians have it, too."""
    first, *_ = write_stages(tmp_path, (8,), planners=("cem",), members=2, epochs=1)
    settings = tuple(
        Setting({**first.values, "lookup.spacing": spacing, "lookup.differentiable": choice}, first.folders)
        for spacing in (0.1, 0.2)
        for choice in (True, False)
    )
    results = Results(settings)
    assert (results.x.key, results.color.key) == ("lookup.spacing", "lookup.differentiable")
    table = medians(results, ReportSettings.load("report", "default"))
    expected = {(spacing, choice) for spacing in (0.1, 0.2) for choice in (True, False)}
    chosen = table.query("metric == 'mean_distance'")
    assert set(zip(chosen["lookup_spacing"], chosen["lookup_differentiable"], strict=True)) == expected


def _path_length(paths: Trajectories) -> np.ndarray:
    return np.linalg.norm(np.diff(paths.position, axis=1), axis=-1).sum(axis=1)


def test_a_new_metric_is_one_entry_and_shows_in_the_report_of_an_old_store(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Computed when it is read, to six decimals as others; the stored tables stay as they are."""
    stored = {path: path.read_bytes() for path in swept.glob("store/control/*/runs.csv")}
    monkeypatch.setitem(METRICS, "path_length", Metric("path length", "u", "length of the path (u)", _path_length))
    assert report(swept, tmp_path / "longer", monkeypatch) == 0, capsys.readouterr().err
    assert {path: path.read_bytes() for path in stored} == stored
    runs = pd.read_csv(tmp_path / "longer/tables/runs.csv")
    assert list(runs)[-1] == "path_length"
    setting = completed(read_sweep([*line(swept), *SWEEP])).settings[0]
    chosen = runs.query("planner == 'cem' and control_beta == 0")["path_length"]
    assert chosen.tolist() == pytest.approx(_path_length(read_trajectories(setting.control)).tolist(), abs=1e-6)
    medians = pd.read_csv(tmp_path / "longer/tables/medians.csv")
    assert (medians["metric"] == "path_length").sum() == 3 * 2
    text = (tmp_path / "longer/report.html").read_text("utf-8")
    assert "median path length (u)" in text and "Length of the path (u)" in text


def test_a_column_that_is_no_metric_cannot_be_computed(swept: Path, tmp_path: Path) -> None:
    setting = completed(read_sweep([*line(swept), *SWEEP])).settings[0]
    table = pd.read_csv(setting.control[0] / "runs.csv")
    (tmp_path / "runs.csv").write_text(table.drop(columns="crossable").to_csv(index=False))
    lacking = Results((type(setting)(setting.values, {**setting.folders, "control": (tmp_path,)}),))
    with pytest.raises(ConfigError, match=r"lacks the columns \['crossable'\]"):
        _ = lacking.runs


def test_results_know_the_names_of_a_report(swept: Path) -> None:
    """Those of its settings; other values are told in words."""
    results = completed(read_sweep([*line(swept), *SWEEP])).results(ReportSettings.load("report", "default").names)
    assert (results.name("cem"), results.name("procedural_hard")) == ("EB", "procedural hard")
