"""An experiment and the agents that it is compared with: run, counted, listed and drawn by the commands."""

import json
import shlex
import shutil
from pathlib import Path

import pandas as pd
import pytest
import torch
from commands import contents, in_process, line

from affmap import pipeline
from affmap.cli.app import read_sweep
from affmap.config.sweep import Sweep
from affmap.pipeline.completed import completed
from affmap.pipeline.job import all_stages
from affmap.pipeline.stage import CONTROL, TRAIN

SWEEP = ["planner=cem", "planner.num_iterations=1", "model.context_size=0,1", "baselines=[oracle,straight]"]


def asked(folder: Path, *more: str) -> Sweep:
    return read_sweep(line(folder, *SWEEP, *more))


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two context sizes, an oracle and an agent that flies straight on, run by one command and reported."""
    folder, threads = tmp_path_factory.mktemp("baselines"), torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert in_process(patch, "affmap", line(folder, *SWEEP)) == 0
        assert in_process(patch, "affmap-report", line(folder, *SWEEP)) == 0
    torch.set_num_threads(threads)  # `run` sets the number of threads of its process
    return folder


@pytest.fixture
def lacking(swept: Path, tmp_path: Path) -> Path:
    """A copy without the flights of one of the baselines, and without a report."""
    folder = tmp_path / "lacking"
    shutil.copytree(swept, folder)
    baselines = asked(folder).baselines()
    assert baselines is not None
    shutil.rmtree(folder / "store/control" / CONTROL.of(baselines.configs[1]).digest)
    for name in ("report.html", "report.pdf", "provenance.json"):
        (folder / "output" / name).unlink()
    shutil.rmtree(folder / "output/tables")
    return folder


def test_baselines_are_run_after_their_experiment_and_share_its_models(swept: Path) -> None:
    """By hand: one data set, a training for each size, none for the baselines, which fly with the first size's."""
    made = [path.parent.name for path in (swept / "store").glob("*/*") if path.is_dir()]
    counts = {name: made.count(name) for name in made}
    assert (counts["data"], counts["train"], counts["control"]) == (1, 2, 4)
    folders = {path.name for path in (swept / "output/jobs").iterdir() if path.is_dir()}
    assert folders == {"0_context0_cem", "1_context1_cem"}
    folders = {path.name for path in (swept / "output/baselines/jobs").iterdir() if path.is_dir()}
    assert folders == {"0_context0_oracle", "1_context0_straight"}
    sweep, baselines = asked(swept), asked(swept).baselines()
    assert baselines is not None
    assert {TRAIN.of(config).digest for config in baselines.configs} == {TRAIN.of(sweep.configs[0]).digest}
    actual = [pipeline.find(config) for config in (*sweep.configs, *baselines.configs)]
    assert all(actual)
    assert len(all_stages(sweep)) == len(made)


def test_baselines_fly_the_same_runs(swept: Path) -> None:
    """From the same starts to the same goals as the experiment's agents, member by member; 8 runs each."""
    whole = completed(asked(swept))
    assert whole.missing == "" and len(whole.settings) == 2
    assert [setting.planner for setting in whole.baselines] == ["oracle", "straight"]
    keys = ["member", "run", "start_x", "start_y", "goal_x", "goal_y"]
    tables = [pd.read_csv(setting.control[0] / "runs.csv")[keys] for setting in (*whole.settings, *whole.baselines)]
    assert len(tables[0]) == 8
    for table in tables[1:]:
        pd.testing.assert_frame_equal(table, tables[0])


def test_running_it_again_changes_nothing(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every file the same, to the nanosecond; a line for the experiment, one for its baselines, and what comes next."""
    before = contents(swept)
    monkeypatch.chdir(swept)
    assert in_process(monkeypatch, "affmap", line(swept, *SWEEP)) == 0
    assert capsys.readouterr().out.splitlines() == [
        "single: 2 of 2 settings are complete.",
        "single/baselines: 2 of 2 settings are complete.",
        f"affmap-report {swept / 'output'} shows and draws the results.",
    ]
    assert contents(swept) == before


def test_status_lists_the_experiment_and_its_baselines_once(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """For all of `runs`, by folder, and by overrides: each of the four settings is listed once."""
    (swept / "runs").symlink_to(swept)
    monkeypatch.chdir(swept)
    for arguments in ([], [str(swept / "output"), str(swept / "output/baselines")], line(swept, *SWEEP)):
        assert in_process(monkeypatch, "affmap-status", arguments) == 0
        message = capsys.readouterr().out
        assert message.count("2 of 2 settings complete; ") == 2
        for output in (swept / "output", swept / "output/baselines"):
            assert message.count(f"({output}):") == 1
        rows = [row.split()[:2] for row in message.splitlines() if row.strip().startswith(("model.", "agent="))]
        expected = ["model.context_size=0", "model.context_size=1", "agent=oracle", "agent=straight"]
        assert rows == [[label, "complete"] for label in expected]
    (swept / "runs").unlink()


def test_the_report_has_them(swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Their runs in a table of their own and in no other; provenance; everything can be checked."""
    tables = swept / "output/tables"
    runs, baselines = pd.read_csv(tables / "runs.csv"), pd.read_csv(tables / "baselines.csv")
    assert set(runs["planner"]) == {"cem"} and len(runs) == 16
    assert baselines.groupby("planner").size().to_dict() == {"oracle": 8, "straight": 8}
    assert not {"context_size", "lookup_spacing"} & set(baselines.columns)
    for setting in completed(asked(swept)).baselines:
        stored = pd.read_csv(setting.control[0] / "runs.csv")
        mine = baselines[baselines["planner"] == setting.planner].reset_index(drop=True)
        pd.testing.assert_series_equal(mine["mean_distance"], stored["mean_distance"])
    assert baselines[baselines["planner"] == "oracle"]["prediction_error"].notna().all()
    assert baselines[baselines["planner"] == "straight"]["prediction_error"].isna().all()
    page = (swept / "output/report.html").read_text("utf-8")
    assert "Agents without a learned model" in page
    used = {stage["digest"] for stage in json.loads((swept / "output/provenance.json").read_text())["stages"]}
    flown = {CONTROL.of(config).digest for each in asked(swept).companions() for config in each.configs}
    assert len(flown) == 2 and flown <= used
    monkeypatch.chdir(swept)
    assert in_process(monkeypatch, "affmap-report", ["--check", *line(swept, *SWEEP)]) == 0
    assert f"{len(all_stages(asked(swept)))} stages and the report" in capsys.readouterr().out


def test_a_report_waits_for_the_baselines(
    lacking: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence with what lacks and the command that makes it; status says so; that command makes only it."""
    monkeypatch.chdir(lacking)
    arguments = line(lacking, *SWEEP)
    assert in_process(monkeypatch, "affmap-report", arguments) == 2
    command = shlex.join(asked(lacking).overrides)
    assert capsys.readouterr().err == (
        f"1 of 4 settings are not complete (agent=straight); run `affmap {command}` first.\n"
    )
    assert not (lacking / "output/report.html").exists()
    assert in_process(monkeypatch, "affmap-status", arguments) == 0
    message = capsys.readouterr().out
    assert "2 of 2 settings complete; " in message and "1 of 2 settings complete, 1 missing; " in message
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 1
    assert " is missing." in capsys.readouterr().err
    before = contents(lacking / "store")
    assert in_process(monkeypatch, "affmap", arguments) == 0
    after = contents(lacking / "store")
    assert {name: after[name] for name in before} == before
    assert {Path(name).parts[0] for name in after.keys() - before.keys()} == {"control"}
    assert in_process(monkeypatch, "affmap-report", arguments) == 0


def test_a_partial_report_does_without_the_baselines_that_lack(
    lacking: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The others are drawn, and the notice counts all; it is not published."""
    monkeypatch.chdir(lacking)
    assert in_process(monkeypatch, "affmap-report", line(lacking, *SWEEP, "report.partial=true")) == 0
    printed = capsys.readouterr().out.splitlines()  # before and after the tables
    assert ["PARTIAL: 1 of 4 settings are not complete" in each for each in (printed[0], printed[-2])] == [True, True]
    baselines = pd.read_csv(lacking / "output/tables/baselines.csv")
    assert set(baselines["planner"]) == {"oracle"}
    assert "PARTIAL: 1 of 4 settings are not complete" in (lacking / "output/report.html").read_text("utf-8")
    assert in_process(monkeypatch, "affmap-publish", line(lacking, *SWEEP, "report.partial=true", "notice=null")) == 2
    assert "not to be published: PARTIAL: 1 of 4 settings are not complete." in capsys.readouterr().err


def test_without_baselines_nothing_of_them_is_drawn(swept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs reported without baselines; and a comparison, which has none."""
    monkeypatch.chdir(swept)
    places = [f"output={swept / 'plain'}", "baselines=[]"]
    arguments = [*(each for each in line(swept, *SWEEP) if not each.startswith(("output=", "baselines="))), *places]
    assert in_process(monkeypatch, "affmap-report", arguments) == 0
    assert not (swept / "plain/tables/baselines.csv").exists()
    assert "Agents without a learned model" not in (swept / "plain/report.html").read_text("utf-8")
    assert completed(asked(swept, "report.compare=model.context_size")).baselines == ()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("planner", "has 'planner', which imagines with a trained model; sweep over it instead"),
        ("oracle,true_mean", "has 'true_mean', which imagines with a trained model"),
        ("oracle,straight,oracle", "has 'oracle' twice; name each agent once"),
    ],
)
def test_agents_that_are_no_baselines_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], names: str, words: str
) -> None:
    """Before anything runs, by every command."""
    for entry in ("affmap", "affmap-report", "affmap-status"):
        assert in_process(monkeypatch, entry, line(tmp_path, *SWEEP[:3], f"baselines=[{names}]")) == 2
        message = capsys.readouterr().err
        assert words in message and message.count("\n") == 1
    assert not (tmp_path / "store").exists()
