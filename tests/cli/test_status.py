"""The status of a sweep: against states made by hand, and against real sweeps in which a job fails."""

import re
import shutil
from pathlib import Path

import pytest
from commands import command, in_process, line

from affmap.cli import run
from affmap.cli.status import SHARED, own_stages, summary, table
from affmap.config import notes
from affmap.config.sweep import Sweep
from affmap.pipeline import train
from affmap.pipeline.progress import duration
from affmap.pipeline.status import JobStatus, StageStatus, failures, overview
from affmap.store.store import State

DATA = StageStatus("data", "a", State("complete", 10.0))
TRAIN = StageStatus("train", "b", State("complete", 100.0))
OTHER = StageStatus("train", "c", State("complete", 200.0))
HALF = StageStatus("train", "d", State("running", 30.0, 10, 50))
FAILED = StageStatus("train", "e", State("failed", 40.0, 5, 50, "ValueError: no luck", "/logs/e/affmap.log"))
MAP = StageStatus("map", "f", State("missing"))
FOUND = [
    JobStatus("size=0", (DATA, TRAIN)),
    JobStatus("size=1", (DATA, OTHER)),
    JobStatus("size=2", (DATA, HALF)),
    JobStatus("size=3", (DATA, FAILED)),
    JobStatus("size=4", (DATA, StageStatus("train", "g", State("missing")))),
]


def cells(actual: list[JobStatus]) -> list[tuple[str, ...]]:
    drawn = table(actual, own_stages(actual, set()))
    columns = [[str(cell) for cell in column.cells] for column in drawn.columns]
    return list(zip(*columns, strict=True))


def test_each_setting_has_a_row() -> None:
    """By hand: 30 s for 10 of 50 epochs leave 120 s; one that has not begun takes the mean of those complete, 150 s.
    The data, which all share, count once."""
    assert cells(FOUND) == [
        ("size=0", "complete", "", "1:50", ""),
        ("size=1", "complete", "", "3:20", ""),
        ("size=2", "running", "train 10/50", "0:30", "2:00"),
        ("size=3", "failed", "train 5/50", "0:40", "6:00"),
        ("size=4", "missing", "train", "0:00", "2:30"),
    ]


def test_text_from_files_is_shown_as_text(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Rich's markup and emoji, and escapes, in a setting's name, an error and a log file that somebody else wrote."""
    nasty = "a[bold]b[/x] :smile: \x1b[31m\u202e"
    shown = r"a[bold]b[/x] :smile: \x1b[31m\u202e"
    stage = StageStatus("train", "e", State("failed", 1.0, error=nasty, log=f"/logs/{nasty}"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("affmap.pipeline.status.jobs", lambda part: [JobStatus(nasty, (stage,))])
    assert in_process(monkeypatch, "affmap-status", ["scale=smoke"]) == 0
    lines = [each.strip() for each in capsys.readouterr().out.splitlines()]
    assert any(each.startswith(f"{shown}   failed   train") for each in lines)
    assert lines[-2:] == [f"{shown}: {shown}", f"log: /logs/{shown}"]
    assert in_process(monkeypatch, "affmap-status", [nasty, "\udcff"]) == 2  # folders, the second not named in text
    errors = capsys.readouterr().err.splitlines()
    assert [each.partition(": ")[0] for each in errors] == [shown.partition(": ")[0], r"\udcff"]
    assert all(each.isprintable() for each in errors)


def test_what_is_shared_counts_once_in_the_sum() -> None:
    """10 + 100 + 200 + 30 + 40 s; 120 + 360 + 150 s."""
    assert summary(FOUND, own_stages(FOUND, set())) == (
        "2 of 5 settings complete, 1 running, 1 failed, 1 missing; 6:20 spent, 10:30 left, one job at a time"
    )
    counted: set[str] = set()
    assert summary(FOUND[:2], own_stages(FOUND[:2], counted)) == "2 of 2 settings complete; 5:10 spent"
    baselines = [JobStatus("agent=straight", (DATA, TRAIN, StageStatus("control", "f", State("complete", 7.0))))]
    assert summary(baselines, own_stages(baselines, counted)) == "1 of 1 settings complete; 0:07 spent"


def test_the_overview_of_two_workers_takes_half_the_time() -> None:
    """By hand: 3 of 6 stages, and 10/50 and 5/50 of two more; 630 s are left."""
    now = overview(FOUND, workers=2)
    assert now == (2, 5, 3, 6, pytest.approx(3.3), 315.0)
    assert overview([JobStatus("size=0", (MAP,))], 2).seconds_left is None


def test_what_nothing_tells_is_not_guessed() -> None:
    """No map has been made yet."""
    assert cells([JobStatus("size=0", (DATA, TRAIN, MAP))]) == [("size=0", "missing", "map", "1:50", "?")]
    assert summary([JobStatus("size=0", (MAP,))], [[MAP]]).endswith("0:00 spent, ? left, one job at a time")


@pytest.mark.parametrize(("seconds", "message"), [(0.4, "0:00"), (59.6, "1:00"), (3599, "59:59"), (36000, "10:00:00")])
def test_durations(seconds: float, message: str) -> None:
    assert duration(seconds) == message


def test_failures_have_their_reason_and_their_log() -> None:
    corrupted = JobStatus("size=5", (StageStatus("data", "h", State("corrupted", error="x is corrupted; remove it")),))
    assert failures([*FOUND, corrupted], Path("runs/a")) == [
        "size=2: another job works on it",
        "size=3: ValueError: no luck\n    log: /logs/e/affmap.log",
        "size=4: it was not begun",
        "size=5: x is corrupted; remove it",
    ]


def test_a_failure_says_whose_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sweeps share a stage, and that of runs/b was the last to try it."""
    monkeypatch.chdir(tmp_path)
    notes.write_note(Path("runs/b"), [])
    state = State("failed", error="ValueError: no luck", log=str(tmp_path / "runs/b/jobs/0_x/affmap.log"))
    jobs = [JobStatus("size=3", (StageStatus("train", "e", state),))]
    own = "size=3: ValueError: no luck\n    log: runs/b/jobs/0_x/affmap.log"
    assert failures(jobs, Path("runs/b")) == [own]
    assert failures(jobs, Path("runs/a")) == [f"{own} (the last attempt was that of runs/b)"]


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real sweep of three, two at a time, the first of which cannot be trained: a folder stands in its way."""
    folder = tmp_path_factory.mktemp("failing")
    overrides = ["model.context_size=0,1,2", "hydra.launcher.n_jobs=2"]
    stage = train.TRAIN.of(Sweep.read([*line(folder), *overrides]).configs[0])
    (folder / "store/train" / f"{stage.digest}.partial" / "unfinished/checkpoint.tmp").mkdir(parents=True)
    result = command(folder, *overrides)
    (folder / "said.txt").write_text(result.stderr)
    assert result.returncode == 1 and "Traceback" not in result.stderr, result.stderr
    return folder


def test_a_failed_job_does_not_stop_the_others_and_is_named_at_the_end(failing: Path) -> None:
    """Status 1 (above), the setting and what to do; its own log has the traceback, the others' are of success."""
    said = (failing / "said.txt").read_text()
    log = "output/jobs/0_context0_cem/affmap.log"
    assert re.search(rf"1 of 3 settings are not complete:\nmodel.context_size=0: \w+Error: .*\n    log: {log}\n", said)
    assert "run the same command again to resume." in said
    logs = {path.parent.name: path.read_text() for path in failing.rglob("affmap.log")}
    assert len(logs) == 3
    assert "Traceback" in logs["0_context0_cem"] and "checkpoint.tmp" in logs["0_context0_cem"]
    for name in ("1_context1_cem", "2_context2_cem"):
        assert logs[name].endswith("complete\n") and "Traceback" not in logs[name]


def test_of_many_settings_that_are_not_complete_few_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By hand: a launcher that does nothing leaves 12."""
    monkeypatch.setattr(run, "_launch", lambda arguments: [])
    assert in_process(monkeypatch, "affmap", line(tmp_path, "members=1", "seed=range(12)")) == 1
    lines = [f"seed={seed}: it was not begun" for seed in range(10)]
    head, *told, more, _ = capsys.readouterr().err.splitlines()
    assert (head, told, more) == ("single: 12 of 12 settings are not complete:", lines, "... and 2 more.")


def test_the_status_of_a_folder_is_that_of_its_sweep(
    failing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By folder, by overrides, and for all of `runs`: the same rows; nothing is written."""
    before = sorted(failing.rglob("*"))
    overrides = [*line(failing), "model.context_size=0,1,2"]
    (failing / "runs").symlink_to(failing)
    monkeypatch.chdir(failing)
    for arguments in ([str(failing / "output")], overrides, []):
        assert in_process(monkeypatch, "affmap-status", arguments) == 0
        captured = capsys.readouterr()
        rows = [row.split() for row in captured.out.splitlines() if row.strip().startswith("model.context_size")]
        assert rows.pop()[:2] == ["model.context_size=0:", "IsADirectoryError:"]
        assert [row[:2] for row in rows] == [
            ["model.context_size=0", "failed"],
            ["model.context_size=1", "complete"],
            ["model.context_size=2", "complete"],
        ]
        assert "2 of 3 settings complete, 1 failed; 0:" in captured.out and captured.err == ""
        assert captured.out.splitlines()[-1] == SHARED  # the data
    (failing / "runs").unlink()
    assert sorted(failing.rglob("*")) == before


def test_a_sweep_that_cannot_be_read_does_not_hide_the_others(
    failing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A key was renamed since; trials were edited: each is named, and the others are reported."""
    older, edited = failing / "older", failing / "edited"
    notes.write_note(older, ["training.old_name=3"])
    notes.write_note(edited, [*line(failing), "search=cem", f"output={edited}"])
    (edited / "jobs/trials.jsonl").write_text("[]\n")
    folders = [str(folder) for folder in (older, edited, failing / "output")]
    assert in_process(monkeypatch, "affmap-status", folders) == 2
    captured = capsys.readouterr()
    assert f"{older}: " in captured.err and "old_name" in captured.err
    assert f"{edited / 'jobs/trials.jsonl'} is corrupted" in captured.err
    assert "2 of 3 settings complete, 1 failed" in captured.out
    shutil.rmtree(older)
    shutil.rmtree(edited)


def test_of_many_settings_only_those_are_listed_that_need_a_look() -> None:
    """59 complete ones, one that failed."""
    many = [JobStatus(f"seed={seed}", FOUND[0].parts) for seed in range(59)]
    assert [row[:2] for row in cells([*many, FOUND[3]])] == [("size=3", "failed")]
    assert len(cells(many[:50])) == 50


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["runs/nothing"],
            "runs/nothing is neither a folder nor an override key=value; there is no sweep in runs, `affmap ",
        ),
        (["runs/nothing", "seed=3"], "runs/nothing is neither a folder nor an override key=value"),
        (["."], ".: . holds no note of a sweep (jobs/sweep.json); give the overrides"),
        (["exp1"], "exp1 is neither a folder nor an override key=value; there is no sweep in runs, did you mean expe"),
        (["experiment", "=", "exp1"], "an override has no blanks around its =; write experiment=exp1.\n"),
        (["planner=[cem,gradient]"], "planner takes one file, and no list; write planner=cem,gradient for a job of"),
        (["--all"], "--all is not known here"),
        (["--hepl"], "--hepl is not known here; did you mean --help?"),
    ],
)
def test_a_mistake_is_reported(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap-status", arguments) == 2
    assert message in capsys.readouterr().err


def test_of_many_folders_five_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside an experiment of that name, and the nearest folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b", "c", "d", "e", "exp12", "f"):
        notes.write_note(Path("runs") / name, [])
    assert in_process(monkeypatch, "affmap-status", ["exp1"]) == 2
    listed = "runs/a, runs/b, runs/c, runs/d, runs/e and 2 more.\n"
    meant = "did you mean experiment=exp1 or runs/exp12?"
    assert capsys.readouterr().err.endswith(f"key=value; {meant} Folders of sweeps: {listed}")


def test_without_sweeps_there_is_nothing_to_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap-status", []) == 0
    assert capsys.readouterr().out == "There is no sweep in runs; `affmap experiment=exp1` begins one.\n"
