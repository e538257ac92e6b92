"""Searches through the real commands at the tiniest scale: space, objective and messages."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from commands import TINY, command, in_process, jobs, line

from affmap import pipeline
from affmap.config.root import Config
from affmap.config.search import Search
from affmap.settings import ConfigError

SPACES = ["training", "cem", "gradient"]
QUICK = ["hydra.sweeper.num_trials=4", "hydra.sweeper.batch_size=2", "model.context_size=1"]


def trials(output: Path) -> list[dict[str, str]]:
    with (output / "jobs/results.csv").open() as file:
        return list(csv.DictReader(file))


def single(folder: Path, *overrides: str) -> Config:
    (config,) = jobs(folder, "model.context_size=1", *overrides)
    return config


@pytest.mark.parametrize("space", SPACES)
def test_every_space_can_be_searched_from_the_values_in_use(space: str) -> None:
    """The values that are tried first are those of the configuration, and each lies in its interval (a search that
    begins outside is refused, which the next test would show)."""
    search = Search.read([f"search={space}"])
    assert search is not None and search.config.objective and search.config.members == 5
    assert search.num_trials == 60 and search.folder == search.config.output / "jobs"
    assert search.config.output == Path("runs/tune") / space


@pytest.mark.parametrize("space", SPACES)
def test_a_search_ends_with_a_report(
    space: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four trials, the first of which is of the values in use and has the result that it has alone; then figures and a
    table, and a second call that makes nothing."""
    monkeypatch.chdir(tmp_path)
    arguments = line(tmp_path, f"search={space}", *QUICK)
    assert in_process(monkeypatch, "affmap", arguments) == 0, capsys.readouterr().err
    actual = trials(tmp_path / "output")
    assert len(actual) == 4 and {row["status"] for row in actual} == {"ok"}
    config = single(tmp_path, "planner=gradient" if space == "gradient" else "planner=cem")
    if space == "training":
        (alone,) = pipeline.validation(config)
    else:
        alone = pd.read_csv(pipeline.run(config).control[0] / "runs.csv")["mean_distance"].mean()
    assert float(actual[0]["result"]) == pytest.approx(alone, abs=2e-3)
    assert in_process(monkeypatch, "affmap-status", [str(tmp_path / "output")]) == 0
    assert "4 of 4 trials complete" in capsys.readouterr().out
    before = (tmp_path / "output/jobs/trials.jsonl").read_bytes()
    assert in_process(monkeypatch, "affmap", arguments) == 0
    assert (tmp_path / "output/jobs/trials.jsonl").read_bytes() == before
    capsys.readouterr()
    assert in_process(monkeypatch, "affmap-report", arguments) == 0
    assert "The values in use, trial 0, come in place" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "output").rglob("search.*")}
    assert names == {"search.md", "search.png", "search.pdf", "search.lock"}
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 0
    assert "4 trials and the report in" in capsys.readouterr().out
    (tmp_path / "output/figures/search.png").write_bytes(b"")
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 1
    assert "search.png is not as it was written" in capsys.readouterr().err


def test_trials_of_a_stack_are_the_trials_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four trials in two stacks of two, against a job for each: the same values, the same results to rounding."""
    monkeypatch.chdir(tmp_path)
    for name in ("true", "false"):
        arguments = [*line(tmp_path), "search=training", *QUICK, f"output={tmp_path / name}"]
        assert in_process(monkeypatch, "affmap", [*arguments, f"hydra.sweeper.stacked={name}"]) == 0
    stacked, alone = (pd.DataFrame(trials(tmp_path / name)).drop(columns="batch_seconds") for name in ("true", "false"))
    pd.testing.assert_frame_equal(stacked.drop(columns="result"), alone.drop(columns="result"))
    np.testing.assert_allclose(stacked["result"].astype(float), alone["result"].astype(float), atol=2e-3)


def test_the_issue_s_own_command_line(tmp_path: Path) -> None:
    """By the console script: an experiment gives its configuration and not its sweep; success is maximised; a planner
    that cannot be is a failed trial, with its reason."""
    overrides = [
        "hydra/sweeper=hyperopt",
        "experiment=exp1",
        "training.transition_lr=tag(log,interval(1e-4,1e-1))",
        "planner.momentum=choice(0.0,0.5,1.5)",
        "objective=success",
        "hydra.sweeper.direction=maximize",
        "model.context_size=1",
        "hydra.sweeper.num_trials=5",
    ]
    result = command(tmp_path, *overrides)
    assert result.returncode == 0, result.stderr
    actual = trials(tmp_path / "output")
    failed = [row for row in actual if row["status"] == "fail"]
    assert len(actual) == 5 and failed and all(row["planner.momentum"] == "1.5" for row in failed)
    logs = [path.read_text() for path in (tmp_path / "output/jobs").glob("*/affmap.log")]
    assert sum("planner.momentum = 1.5 is not allowed" in text for text in logs) == len(failed)
    assert len(list((tmp_path / "store/train").iterdir())) == 5 - len(failed)


def test_what_is_no_fault_of_the_values_is_no_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A corrupted model: the search ends with status 1 and the remedy, and keeps its trials. With the remedy,
    it ends as an undisturbed one; irrelevant keys may change, and a report on the way states the progress."""
    monkeypatch.chdir(tmp_path)
    wanted = [*QUICK, "search=cem"]
    whole = line(tmp_path / "whole", *wanted)
    assert in_process(monkeypatch, "affmap", whole) == 0
    expected = pd.DataFrame(trials(tmp_path / "whole/output")).drop(columns="batch_seconds")
    own = line(tmp_path / "own", *wanted)
    two = [each.replace("num_trials=4", "num_trials=2") for each in own]
    assert in_process(monkeypatch, "affmap", two) == 0
    (train,) = (tmp_path / "own/store/train").iterdir()
    weights = train / "weights.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1])
    capsys.readouterr()
    assert in_process(monkeypatch, "affmap", own) == 1
    message = capsys.readouterr().err
    assert (
        f"{weights} is corrupted; remove the folder {train}" in message
        and "run the same command to try again" in message
    )
    assert len(trials(tmp_path / "own/output")) == 2
    assert in_process(monkeypatch, "affmap-report", own) == 0
    assert "PARTIAL: 2 of 4 trials are complete**" in capsys.readouterr().out
    assert in_process(monkeypatch, "affmap-publish", [*own, "notice=null"]) == 2
    assert "not to be published: PARTIAL: 2 of 4 trials are complete." in capsys.readouterr().err
    shutil.rmtree(train)
    assert in_process(monkeypatch, "affmap", [*own, "threads=2", "versions=any"]) == 0
    pd.testing.assert_frame_equal(pd.DataFrame(trials(tmp_path / "own/output")).drop(columns="batch_seconds"), expected)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["hydra/sweeper=hyperopt", "model.context_size=1,2"], "a search needs an objective"),
        (["search=training", "objective=success"], "objective=success needs hydra.sweeper.direction=maximize"),
        (["search=training", "hydra.sweeper.num_trials=0"], "hydra.sweeper.num_trials = 0 is not allowed"),
        (["search=training", "training.vision_lr=interval(1.0,2.0)"], "training.vision_lr"),
        (["search=training", "training.vision_lr=tag(log,interval(0.0,2.0))"], "training.vision_lr"),
        (["search=training", "members=0"], "members = 0 is not allowed"),
        (["search=mars"], "mars"),
        (["search=cem", "objective=validation_nll"], "objective=validation_nll does not depend on planner.horizon, "),
    ],
)
def test_a_mistake_is_reported(
    overrides: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Before any trial; some by the sweeper, which knows the space."""
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap", line(tmp_path, *overrides)) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error
    assert not (tmp_path / "store").exists()


@pytest.fixture
def found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The command line of a search of two trials, whose objective is a constant, on a machine with a GPU."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("affmap.cli.run.check_devices", lambda config, planned: None)
    monkeypatch.setattr("affmap.pipeline.execution.score", lambda config: 1.0)
    arguments = line(tmp_path, "search=cem", "hydra.sweeper.num_trials=2", "control.device=cuda")
    assert in_process(monkeypatch, "affmap", arguments) == 0
    return arguments


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scale=smoke", "scale=full", 'fixed was ["control.num_steps=3", '),
        ("search=cem", "search=gradient", 'space was {"planner.horizon": '),
    ],
)
def test_trials_of_another_search_are_refused_by_every_command(
    old: str,
    new: str,
    message: str,
    found: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of another scale, without its notice, and of another planner. Nothing is written; the note of the folder, which
    `affmap-status` reads, stays that of its trials."""
    path = tmp_path / "output/jobs/trials.jsonl"
    other = [new if each == old else each for each in found]
    for entry, flags in {
        "affmap": [],
        "affmap-report": [],
        "affmap-report --check": ["--check"],
        "affmap-status": [],
        "affmap-publish": [],
    }.items():
        assert in_process(monkeypatch, entry.partition(" ")[0], [*flags, *other]) == 2, entry
        error = capsys.readouterr().err
        assert f"{path} belongs to another search: " in error and message in error
        assert "; give the overrides that it began with, remove that file, or " in error
    assert not (tmp_path / "output/tables").exists()
    assert in_process(monkeypatch, "affmap-status", [str(tmp_path / "output")]) == 0
    assert "2 of 2 trials complete" in capsys.readouterr().out


def test_a_search_goes_on_with_another_device(
    found: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As with all keys that the digests of results leave out. A default that is spelled out makes no other search."""
    own = [each for each in found if each != "control.device=cuda"]
    others = ["hydra.sweeper.num_trials=3", "training.accelerator=auto", "report.partial=true"]
    assert in_process(monkeypatch, "affmap", [*own, *others]) == 0
    assert len(trials(tmp_path / "output")) == 3
    assert in_process(monkeypatch, "affmap-report", found) == 0
    assert "3 trials" in capsys.readouterr().out
    assert in_process(monkeypatch, "affmap-report", [*found, "seed=0"]) == 0
    assert in_process(monkeypatch, "affmap-report", [*found, "seed=1"]) == 2
    assert "belongs to another search: fixed was " in capsys.readouterr().err


def test_no_search_is_none() -> None:
    assert Search.read(TINY) is None
    with pytest.raises(ConfigError, match="members"):
        Search.read([*TINY, "members=0", "search=cem"])


def test_a_report_needs_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = line(tmp_path, "search=cem", "notice=null")
    assert in_process(monkeypatch, "affmap-report", arguments) == 2
    assert "holds no trials with a result; run `affmap`" in capsys.readouterr().err
    assert in_process(monkeypatch, "affmap-publish", arguments) == 2
    assert "not to be published: PARTIAL: 0 of 60 trials are complete." in capsys.readouterr().err


OPTUNA = [
    "hydra/sweeper=optuna",
    "hydra.sweeper.n_jobs=2",
    "hydra.sweeper.study_name=rates",
    "hydra.sweeper.storage=sqlite:///study.db",
    "training.transition_lr=tag(log,interval(1e-4,1e-1))",
    "model.context_size=1",
    "compiled=false",
]


@pytest.mark.slow
def test_optuna_searches_and_resumes(tmp_path: Path) -> None:
    """By the console script: the trials in Optuna's own storage are those of the jobs, each with the result that it has
    alone, and the best one is the sweeper's; a second call adds to them."""
    optuna = pytest.importorskip("optuna")
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    for count in (2, 4):
        result = command(tmp_path, *OPTUNA, "objective=validation_nll", "hydra.sweeper.n_trials=2")
        assert result.returncode == 0, result.stdout + result.stderr
        assert "the search is complete" in result.stdout
        assert len(list((tmp_path / "store/train").iterdir())) == count
    study = optuna.load_study(study_name="rates", storage=f"sqlite:///{tmp_path / 'study.db'}")
    assert len(study.trials) == 4
    for trial in study.trials:
        rate = trial.params["training.transition_lr"]
        (alone,) = pipeline.validation(single(tmp_path, f"training.transition_lr={rate}"))
        assert trial.value == pytest.approx(alone)
    best = yaml.safe_load((tmp_path / "output/jobs/optimization_results.yaml").read_text())
    assert best == {"name": "optuna", "best_params": study.best_params, "best_value": study.best_value}


@pytest.mark.slow
def test_what_optuna_s_searches_lack_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An objective before anything runs; reports, which are of searches by the sweeper on hyperopt."""
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap", line(tmp_path, *OPTUNA)) == 2
    assert "a search needs an objective; say objective=validation_nll" in capsys.readouterr().err
    assert in_process(monkeypatch, "affmap-report", line(tmp_path, *OPTUNA, "objective=success")) == 2
    assert "hydra/sweeper = 'optuna' keeps its trials in its own way" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
