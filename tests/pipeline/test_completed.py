"""Sweeps whose report could not be drawn are known before they run: see `affmap.pipeline.completed`."""

from pathlib import Path

import pytest

from affmap.cli import run
from affmap.cli.app import read_sweep
from affmap.config.sweep import Sweep
from affmap.pipeline.completed import report_problem
from affmap.settings import ConfigError

ROOT = Path(__file__).parents[2]
THREE = ["experiment=exp1", "model.context_size=0,8", "control.beta=0,1", "control.num_steps=20,30"]


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        (THREE, "there are several values of control.beta and control.num_steps, too"),
        ([*THREE[:3], "planner=cem"], ""),  # of planners, only one
        (THREE[:3], "several values of control.beta"),  # two planners, three keys
        ([*THREE, "report.compare=control.beta"], ""),  # a table, of any number of keys
        (["experiment=exp1", "seed=0,2", "members=2"], ""),  # one setting, its members in two jobs
        (["experiment=exp1", "planner=cem", "report.x=model.context_size", "model.context_size=8"], ""),
        (["experiment=exp5", "report.x=control.beta", "control.beta=1"], "report.x = 'control.beta'"),
        (["experiment=exp6", "model/transition=split"], ""),  # its key on the x axis has one value
        (["experiment=exp7_doors", "lookahead=time_to_go"], ""),
        (["experiment=exp6_radii", "learner=split", "planner=cem,gradient"], ""),
        (["experiment=exp6", "model/transition=split", "control.beta=0,1", "planner=cem,gradient"], "tells two keys"),
    ],
)
def test_a_report_that_cannot_be_drawn_is_known_before_the_sweep(overrides: list[str], problem: str) -> None:
    found = report_problem(read_sweep(overrides))
    assert (problem in found) if problem else not found


def test_a_misspelt_factor_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"report\.x = 'lookahed' is no key that results depend on"):
        read_sweep(["experiment=exp7_doors", "lookahead=time_to_go", "report.x=lookahed"])


def test_every_experiment_has_a_report() -> None:
    folder = ROOT / "conf" / "experiment"
    names = [str(file.relative_to(folder).with_suffix("")) for file in sorted(folder.rglob("*.yaml"))]
    assert len(names) > 20
    assert not {name: problem for name in names if (problem := report_problem(Sweep.read([f"experiment={name}"])))}


def test_the_command_says_so_and_runs_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tables of its jobs may be all that somebody wants."""
    launched: list[list[str]] = []
    monkeypatch.setattr(run, "_launch", lambda arguments: launched.append(list(arguments)) or [])
    monkeypatch.setattr(run.status, "failures", lambda jobs, output: [])
    monkeypatch.setattr(run, "_run_companions", lambda jobs: None)
    run._run_sweep(Sweep.read([*THREE, f"output={tmp_path / 'output'}", f"store={tmp_path / 'store'}", "members=1"]))
    assert len(launched) == 1
    assert "affmap-report will not draw this sweep: a report tells two keys apart" in capsys.readouterr().out
