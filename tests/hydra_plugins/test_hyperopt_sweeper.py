import csv
import logging
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from hydra.plugins.launcher import Launcher
from omegaconf import DictConfig, OmegaConf

from hydra_plugins.hyperopt_sweeper import FinalError, SearchError, TrialError

App = Callable[..., Path]
Stored = Callable[[Path], list[dict[str, Any]]]

SPACE = ["x=interval(-2,2)", "y=int(interval(-3,3))", "z=a,b"]
SIX = ["hydra.sweeper.num_trials=6", "hydra.sweeper.batch_size=3", "hydra.sweeper.num_startup=4"]
SMALL = ["hydra.sweeper.num_trials=7", "hydra.sweeper.batch_size=3", "hydra.sweeper.num_startup=4"]


def quadratic(config: DictConfig) -> float:
    return float((config.x - 1) ** 2 + config.y**2 + (config.z == "b"))


def members(config: DictConfig) -> list[float]:
    each = zip(config.x, config.y, config.z, strict=True)
    return [quadratic(OmegaConf.create(dict(zip("xyz", values, strict=True)))) for values in each]


def results(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "results.csv").read_text().splitlines()))


def best(folder: Path) -> Any:
    return yaml.safe_load((folder / "optimization_results.yaml").read_text())


def test_every_trial_is_recorded_as_the_application_saw_it(app: App, stored: Stored) -> None:
    """Reference: the application's own notes."""
    seen: list[dict[str, Any]] = []

    def task(config: DictConfig) -> float:
        seen.append(dict(config))
        return quadratic(config)

    folder = app(task, *SPACE, *SMALL)
    assert [trial["values"] for trial in stored(folder)] == seen
    assert [trial["result"] for trial in stored(folder)] == [quadratic(OmegaConf.create(each)) for each in seen]
    assert [{key: row[key] for key in "xyz"} for row in results(folder)] == [
        {key: str(value) for key, value in each.items()} for each in seen
    ]
    least = min(trial["result"] for trial in stored(folder))
    number = [trial["result"] for trial in stored(folder)].index(least)
    assert best(folder) == {"name": "hyperopt", "best_params": seen[number], "best_value": least}
    assert {path.name for path in folder.iterdir() if path.is_dir()} == {str(number) for number in range(7)}


@pytest.mark.parametrize(("stacked", "direction"), [(False, "maximize"), (True, "minimize")])
def test_killed_in_each_batch_and_started_again(app: App, stored: Stored, stacked: bool, direction: str) -> None:
    """Reference: the same undisturbed. The first start is killed in the first batch, each other one a batch later."""
    calls, killed_in = 0, 0

    def task(config: DictConfig) -> Any:
        nonlocal calls
        calls += 1
        if calls == killed_in:
            raise KeyboardInterrupt
        return members(config) if stacked else quadratic(config)

    arguments = [*SPACE, *SMALL, f"hydra.sweeper.stacked={stacked}", f"hydra.sweeper.direction={direction}"]
    jobs = 1 if stacked else 3  # of a batch
    folder = app(task, *arguments, folder="whole")
    whole = stored(folder)
    assert calls == 2 * jobs + 1 and len(whole) == 7
    killed = folder.with_name("killed")
    for killed_in in (jobs, jobs + 1, jobs + 1):
        calls = 0
        with pytest.raises(KeyboardInterrupt):
            app(task, *arguments, folder="killed")
        assert killed_in == jobs or stored(killed) in (whole[:3], whole[:6])
    assert stored(killed) == whole[:6]
    calls, killed_in = 0, 0
    app(task, *arguments, folder="killed")
    assert calls == 1
    assert stored(killed) == whole
    assert best(killed) == best(folder)


def test_stacked_trials_are_those_of_single_jobs(app: App, stored: Stored) -> None:
    """Reference: the same batches with a job a trial."""
    sizes = []

    def task(config: DictConfig) -> list[float]:
        sizes.append(len(config.x))
        return members(config)

    stacked = app(task, *SPACE, *SMALL, "hydra.sweeper.stacked=true", folder="stacked")
    single = app(quadratic, *SPACE, *SMALL, folder="single")
    assert sizes == [3, 3, 1]
    assert stored(stacked) == stored(single)
    assert {path.name for path in stacked.iterdir() if path.is_dir()} == {"0", "3", "6"}


def test_more_trials_go_on_and_complete_ones_are_left(app: App, stored: Stored) -> None:
    """Reference: the longer search from the beginning."""
    calls = []

    def task(config: DictConfig) -> float:
        calls.append(config)
        return quadratic(config)

    for _ in range(2):
        part = app(task, *SPACE, *SIX, folder="part")
        assert len(calls) == 6
    app(task, *SPACE, *SMALL, folder="part")
    assert len(calls) == 7
    assert stored(part) == stored(app(quadratic, *SPACE, *SMALL, folder="whole"))
    assert len(results(part)) == 7


def test_maximizing_is_minimizing_the_opposite(app: App, stored: Stored) -> None:
    """Reference: the search for the minimum of the negative."""

    def negative(config: DictConfig) -> float:
        return -quadratic(config)

    small = app(negative, *SPACE, *SMALL, folder="small")
    large = app(quadratic, *SPACE, *SMALL, "hydra.sweeper.direction=maximize", folder="large")
    assert [trial["values"] for trial in stored(small)] == [trial["values"] for trial in stored(large)]
    assert best(large)["best_value"] == -best(small)["best_value"] == max(t["result"] for t in stored(large))


def test_failed_trials_are_named_and_do_not_stop_the_search(
    app: App, stored: Stored, caplog: pytest.LogCaptureFixture
) -> None:
    """Reference: which trials must fail, by hand."""
    calls = 0

    def task(config: DictConfig) -> float | None:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise ValueError("too large")
        return {5: None, 6: float("nan")}.get(calls, quadratic(config))

    folder = app(task, *SPACE, *SMALL)
    trials = stored(folder)
    assert [trial["error"] for trial in trials if trial["error"]] == [
        "ValueError: too large",
        "returned None, which is no number",
        "returned nan, which is not finite",
    ]
    assert [row["status"] for row in results(folder)] == ["fail" if i in (1, 4, 5) else "ok" for i in range(7)]
    warnings = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert warnings[0].getMessage() == "Trial 1 failed: ValueError: too large"
    assert warnings[0].exc_info and warnings[0].exc_info[0] is ValueError
    assert warnings[-1].getMessage() == "3 of 7 trials failed: 1, 4, 5."
    assert best(folder)["best_value"] == min(trial["result"] for trial in trials if trial["error"] is None)


def hungry(config: DictConfig) -> float:
    """An application without the memory for some of its values."""
    if config.x > 0.5:
        raise MemoryError("a large array")
    return quadratic(config)


def test_a_trial_that_never_succeeds_blocks_a_search_until_it_may_fail(app: App, stored: Stored) -> None:
    """The search in which as many may fail from the beginning: one that is stopped at each failure, and goes on with
    what its sentence says, makes the same trials."""
    arguments = ["x=interval(0,1)", "hydra.sweeper.initial=[{x:0.9},{x:0.1},{x:0.8}]", "hydra.sweeper.num_startup=3"]
    arguments += ["hydra.sweeper.num_trials=5", "hydra.sweeper.batch_size=2"]
    whole = app(hungry, *arguments, "hydra.sweeper.max_failures=4", folder="whole")
    failed = [number for number, trial in enumerate(stored(whole)) if trial["values"]["x"] > 0.5]
    batches = {number // 2 for number in failed}
    assert {0, 2} <= {*failed} and 1 not in failed
    assert [number for number, trial in enumerate(stored(whole)) if trial["crashed"]] == failed
    assert [row["status"] == "fail" for row in results(whole)] == [number in failed for number in range(5)]
    assert best(whole)["best_params"]["x"] <= 0.5
    allowed = "hydra.sweeper.max_failures=0"
    for _ in batches:
        with pytest.raises(TrialError, match=r"^Trials? \d.* could not be run: MemoryError: a large") as stopped:
            app(hungry, *arguments, allowed, folder="stopped")
        (allowed,) = re.findall(r"If that never succeeds, add (\S+=\d) to count this as failed\.", str(stopped.value))
    assert stored(app(hungry, *arguments, allowed, folder="stopped")) == stored(whole)


def test_failures_are_counted_over_all_starts_and_bad_values_are_none(app: App) -> None:
    """By hand: a start after two failures has one left; a ValueError is no such failure."""
    arguments = ["x=interval(0,1)", "hydra.sweeper.max_failures=3"]

    def task(config: DictConfig) -> float:
        raise {0: ValueError, 1: ZeroDivisionError}.get(HydraConfig.get().job.num, RuntimeError)("oh")

    with pytest.raises(SearchError, match="All 4 trials failed"):
        app(task, *arguments, "hydra.sweeper.num_trials=4")
    with pytest.raises(TrialError, match=r"Trial 5 could not be run: RuntimeError: oh; .*max_failures=4 to"):
        app(task, *arguments, "hydra.sweeper.num_trials=9")


def test_an_application_can_end_a_search(app: App, stored: Stored) -> None:
    """With an error of its own, which is raised as it is; no trial of its batch is kept, however many may fail."""
    arguments = ["x=interval(0,1)", "hydra.sweeper.num_trials=4", "hydra.sweeper.max_failures=9"]

    def task(config: DictConfig) -> float:
        if HydraConfig.get().job.num == 2:
            raise FinalError("no GPU")
        return quadratic(config)

    with pytest.raises(FinalError, match=r"^no GPU$"):
        app(task, *arguments)
    assert len(stored(Path("sweep"))) == 2
    assert len(stored(app(quadratic, *arguments))) == 4


def test_a_killed_process_fails_its_batch(app: App, stored: Stored, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: joblib and clusters raise an error of their own; the batch is repeated, or counts as failed."""
    basic: Any = next(each for each in Plugins.instance().discover(Launcher) if each.__name__ == "BasicLauncher")
    launch, arguments = basic.launch, ["x=interval(0,1)", "hydra.sweeper.num_trials=3"]

    def killed(self: Launcher, jobs: Any, initial_job_idx: int) -> Any:
        if initial_job_idx == 1:
            raise OSError("A worker was killed")
        return launch(self, jobs, initial_job_idx)

    with monkeypatch.context() as patch:
        patch.setattr(basic, "launch", killed)
        with pytest.raises(TrialError, match=r"Trial 1 could not be run: OSError: A worker .*max_failures=1 to"):
            app(quadratic, *arguments, folder="repeated")
        failed = stored(app(quadratic, *arguments, "hydra.sweeper.max_failures=1", folder="failed"))
    assert [trial["crashed"] for trial in failed] == [False, True, False]
    repeated = stored(app(quadratic, *arguments, folder="repeated"))
    assert [trial["values"] for trial in failed[:2]] == [trial["values"] for trial in repeated[:2]]
    assert not any(trial["error"] for trial in repeated)


def test_all_trials_fail(app: App) -> None:
    """Reference: written by hand."""

    def task(config: DictConfig) -> None:
        raise ZeroDivisionError("oh")

    with pytest.raises(SearchError, match=r"^All 7 trials failed, the first one with ZeroDivisionError: oh; correct"):
        app(task, *SPACE, *SMALL)


def test_initial_values_and_a_space_from_a_file(app: App, stored: Stored) -> None:
    """Reference: the values given; the command line's space instead of the file's."""
    params = {"x": "interval(-2,2)", "y": "int(interval(5,9))", "z": "a,b"}
    initial = [{"x": 1, "y": 0, "z": "b"}, {"x": -2.0, "y": 3, "z": "a"}]
    config = {"x": 0.0, "y": 0, "z": "", "hydra": {"sweeper": {"params": params, "initial": initial}}}
    folder = app(quadratic, "y=int(interval(-3,3))", *SMALL, config=config)
    values = [trial["values"] for trial in stored(folder)]
    assert values[:2] == initial
    assert all(-3 <= each["y"] <= 3 for each in values)


def test_group_choices(app: App, stored: Stored, tmp_path: Path) -> None:
    """Reference: the files' own values; stacked, a group would be several files at once."""
    (tmp_path / "conf" / "shape").mkdir(parents=True)
    for size in (1, 2, 3):
        (tmp_path / "conf" / "shape" / f"s{size}.yaml").write_text(f"size: {size}")

    def task(config: DictConfig) -> int:
        return int(config.shape.size)

    arguments = ["+shape=glob(*)", "hydra.sweeper.num_trials=8", "hydra.sweeper.algorithm=random"]
    trials = stored(app(task, *arguments))
    assert {trial["values"]["shape"] for trial in trials} == {"s1", "s2", "s3"}
    assert all(trial["values"]["shape"] == f"s{trial['result']:.0f}" for trial in trials)
    with pytest.raises(SearchError, match=r"^shape is a group of configurations"):
        app(task, *arguments, "hydra.sweeper.stacked=true", folder="stacked")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["x=tag(log,interval(0,1))"], r"^x=tag\(log,interval\(0,1\)\): a logarithmic interval"),
        (["x=1"], "^There is nothing to search over"),
        (
            ["x=interval(0,1)", "hydra.sweeper.num_trials=0"],
            "^hydra.sweeper.num_trials = 0 is not allowed; it should be 1",
        ),
        (["x=interval(0,1)", "hydra.sweeper.batch_size=-1"], "^hydra.sweeper.batch_size = -1 is not allowed"),
        (["x=interval(0,1)", "hydra.sweeper.seed=-1"], "it should be 0 or more"),
        (["x=interval(0,1)", "hydra.sweeper.max_failures=-1"], "^hydra.sweeper.max_failures = -1 is not allowed"),
        (["x=interval(0,1)", "hydra.sweeper.initial=[{x:2}]"], r"^hydra.sweeper.initial\[0\]: x = 2 does not lie in"),
        (["x=interval(0,1)", "hydra.sweeper.algorithm=tpa"], "algorithm"),
        (["typo=interval(0,1)"], "Could not override 'typo'"),
    ],
)
def test_mistakes_are_reported_before_any_job(app: App, arguments: list[str], problem: str) -> None:
    """Reference: written by hand; the last two are Hydra's own sentences."""

    def task(config: DictConfig) -> None:
        raise AssertionError("a job has started")

    with pytest.raises((SearchError, ConfigCompositionException), match=problem):
        app(task, *arguments)


@pytest.mark.parametrize(
    ("argument", "problem"),
    [
        ("x=interval(-2,3)", "space was"),
        ("hydra.sweeper.seed=1", "seed was 0 and is now 1"),
        ("hydra.sweeper.direction=maximize", 'direction was "minimize"'),
        ("hydra.sweeper.algorithm=anneal", 'algorithm was "tpe"'),
        ("+other=1", "fixed was"),
    ],
)
def test_trials_of_another_search_are_kept(app: App, argument: str, problem: str) -> None:
    """Reference: the file as it was."""
    arguments = [*SPACE, *SMALL, "hydra.sweeper.num_trials=3"]
    path = app(quadratic, *arguments) / "trials.jsonl"
    content = path.read_bytes()
    with pytest.raises(SearchError, match=f"trials.jsonl belongs to another search: {problem}"):
        app(quadratic, *arguments, argument)
    assert path.read_bytes() == content
    path.write_bytes(content[:-9])
    with pytest.raises(SearchError, match=r"trials.jsonl is corrupted"):
        app(quadratic, *arguments)
    assert path.read_bytes() == content[:-9]


APP = """
import os, signal
import hydra

@hydra.main(version_base="1.3", config_path=None)
def main(config):
    if hydra.core.hydra_config.HydraConfig.get().job.num == int(os.environ.get("KILL", -1)):
        os.kill(os.getpid(), signal.SIGKILL)
    return (config.x - 1) ** 2

main()
"""


def command(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    (folder / "app.py").write_text(APP)
    root = str(Path(__file__).parents[2])
    return subprocess.run(
        [sys.executable, "app.py", "-m", "hydra/sweeper=hyperopt", "+x=interval(-2,2)", *SIX, *arguments],
        cwd=folder,
        env={**os.environ, "HYDRA_FULL_ERROR": "0", "PYTHONPATH": root, **environment},
        capture_output=True,
        text=True,
    )


def test_processes(tmp_path: Path, stored: Stored) -> None:
    """Reference: one undisturbed process, for one that gets SIGKILL and goes on with jobs in processes of their own."""
    whole = command(tmp_path, "hydra.sweep.dir=whole")
    assert (whole.returncode, whole.stderr) == (0, "")
    assert "6 of 6 trials are complete; the best is trial" in whole.stdout
    assert command(tmp_path, "hydra.sweep.dir=killed", KILL="4").returncode == -signal.SIGKILL
    assert len(stored(tmp_path / "killed")) == 3
    parallel = command(tmp_path, "hydra.sweep.dir=killed", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    assert parallel.returncode == 0 and "Joblib.Parallel" in parallel.stdout
    assert stored(tmp_path / "killed") == stored(tmp_path / "whole")


def test_a_mistake_is_one_sentence_in_the_terminal(tmp_path: Path) -> None:
    """Reference: written by hand; Hydra adds its hint."""
    actual = command(tmp_path, "+y=interval(1,0)")
    assert actual.returncode == 1 and actual.stdout == ""
    assert actual.stderr.splitlines() == [
        "+y=interval(1,0): the interval is empty, because 1.0 is not less than 0.0; exchange its ends, "
        "or give y a fixed value.",
        "",
        "Set the environment variable HYDRA_FULL_ERROR=1 for a complete stack trace.",
    ]
    assert not (tmp_path / "multirun").exists()


def test_other_applications_do_not_wait_for_hyperopt() -> None:
    """Reference: the modules that are there after Hydra has imported all plugins."""
    program = (
        "import sys; from hydra.core.plugins import Plugins; from hydra.plugins.sweeper import Sweeper;"
        "print([each.__name__ for each in Plugins.instance().discover(Sweeper)], 'hyperopt' in sys.modules)"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    actual = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert "'HyperoptSweeper'" in actual.stdout and actual.stdout.endswith(" False\n")
    assert actual.stderr == ""
