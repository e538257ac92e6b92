"""The commands at the tiniest scale: complete, resumable, brief where all is done, clear in errors."""

import contextlib
import errno
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from commands import COMMAND, ENVIRONMENT, TINY, command, contents, in_process, jobs, line

import affmap.pipeline.machine
from affmap import pipeline
from affmap.cli import app, paper, publish, report, run, status
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.env import Layout
from affmap.env.procedural import Procedural
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.stack import Stack
from affmap.model.weights import restore
from affmap.pipeline.completed import completed
from affmap.pipeline.machine import MachineError, check_devices
from affmap.pipeline.stage import CONTROL, TRAIN
from affmap.play import render, window
from affmap.random import generator
from affmap.results import manifest
from affmap.results.files import VALIDATION_COLUMNS
from affmap.results.setting import Setting
from affmap.results.tables import Results
from affmap.settings import ConfigError
from affmap.store.files import sha256
from affmap.store.store import Store

SWEEP = ["planner=cem", "model.context_size=0,1"]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """`run` sets the number of threads of its process."""
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


def find_setting(folder: Path, *overrides: str) -> Setting:
    """The one job of a command line, complete."""
    (config,) = jobs(folder, *overrides)
    job = pipeline.find(config)
    assert job is not None
    return job


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of two context sizes, as the console script leaves it."""
    folder = tmp_path_factory.mktemp("swept")
    result = command(folder, *SWEEP)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "Traceback" not in result.stdout + result.stderr and "Warning" not in result.stdout + result.stderr
    for message in ("exploration of original: 4 sequences", "training of 2 members", "control", "complete"):
        assert message in result.stdout
    return folder


def test_a_sweep_completes_every_stage_once(swept: Path) -> None:
    """One data set, two of everything else; every folder whole, nothing half-made, nothing written elsewhere."""
    counts = {"data": 1, "train": 2, "predict": 2, "map": 2, "control": 2}
    assert {path.name for path in (swept / "store").iterdir()} == set(counts)
    for stage, count in counts.items():
        folders = [path for path in (swept / "store" / stage).iterdir() if path.suffix != ".lock"]
        assert len(folders) == count
        for folder in folders:
            record = json.loads((folder / "provenance.json").read_text())
            assert record["digest"] == folder.name and record["stage"] == stage
            assert record["command"].startswith("affmap ") and "hydra.job" not in record["command"]
    assert {path.name for path in swept.iterdir()} == {"store", "output"}


def test_hydra_ran_the_jobs_that_were_checked(swept: Path) -> None:
    """Hydra's own record of the overrides of each job, against our expansion."""
    actual = [yaml.safe_load(path.read_text()) for path in (swept / "output").rglob(".hydra/overrides.yaml")]
    expected = [[*line(swept)[:-4], *line(swept)[-3:], "planner=cem", f"model.context_size={c}"] for c in (0, 1)]
    assert sorted(actual) == sorted(expected)
    assert [config.model.context_size for config in jobs(swept, *SWEEP)] == [0, 1]
    logs = [path.read_text() for path in (swept / "output").rglob("affmap.log")]
    assert len(logs) == 2 and all("complete" in text for text in logs)
    names = [{line[10:].partition(": ")[0] for line in text.splitlines()} for text in logs]
    assert sorted(names, key=str) == [{f"model.context_size={c}"} for c in (0, 1)], "of each line"


def test_the_tables_are_what_the_report_reads(swept: Path) -> None:
    """Columns of the report's own list, a row for each run; arrays in the shapes that it documents."""
    results = Results(tuple(job for config in jobs(swept, *SWEEP) if (job := pipeline.find(config))))
    assert list(results.runs.columns) == list(pd.read_csv(results.settings[0].control[0] / "runs.csv"))
    rows = results.runs[["context_size", "planner", "member", "run"]].to_numpy().tolist()
    assert rows == [[c, "cem", m, r] for c in (0, 1) for m in (0, 1) for r in range(4)]
    assert set(results.validation.columns) == {"layout", "context_size", *VALIDATION_COLUMNS}
    assert len(results.validation) == 2 * 2 * 2
    job = results.setting(1, "cem", "original")
    assert job is not None
    trajectories = results.trajectories(job)
    assert trajectories.in_fog.shape == trajectories.reached.shape == (8, 3)
    assert trajectories.position.shape == (8, 4, 2) and trajectories.planned_position.shape == (8, 3, 20, 2)
    layout = Layout.load("layout", "original")
    for (start, goal), number in zip(
        zip(trajectories.position[:, 0], trajectories.goal, strict=True), trajectories.run, strict=True
    ):
        for place, corner in ((start, number), (goal, 3 - number)):
            low, high = layout.corner(int(corner))
            assert (place >= low - 1e-6).all() and (place <= high + 1e-6).all()
    maps = results.maps("original")[1]
    assert maps.codes.shape == (2, 9, 13, 1) and maps.member.tolist() == [0, 1] and maps.snapshots == {}
    assert results.exploration(job).counts.shape == (1, 20, 30) and results.exploration(job).counts.sum() == 4 * 21
    assert len(results.run_layouts(job)) == 8 and set(results.run_layouts(job)) == {results.map_layout(job)}
    assert results.training_layouts(job) == [results.map_layout(job)]
    assert results.runs["crossable"].all() and not results.runs["steps_in_fog"].any()


def test_running_it_again_changes_nothing(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every file the same, to the nanosecond; it says so and goes on. In another order, and one setting alone, too."""
    before = contents(swept)
    monkeypatch.chdir(swept)
    for overrides, count in (
        (SWEEP, 2),
        ([SWEEP[0], "model.context_size=1,0", "threads=2"], 2),
        (["model.context_size=1"], 1),
    ):
        assert in_process(monkeypatch, "affmap", line(swept, *overrides)) == 0
        hint = f"affmap-report {swept / 'output'} shows and draws the results."
        assert capsys.readouterr().out == f"single: {count} of {count} settings are complete.\n{hint}\n"
    assert contents(swept) == before


def test_a_folder_stands_for_the_sweep_that_was_run_into_it(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sweep's own settings, its stages, and the remedies; other overrides win; nothing is written."""
    before, output = contents(swept), str(swept / "output")
    monkeypatch.chdir(swept)
    for more, count in (([], 2), (["model.context_size=1"], 1)):
        assert in_process(monkeypatch, "affmap", ["output", *more]) == 0
        assert capsys.readouterr().out.startswith(f"single: {count} of {count} settings are complete.\naffmap-report ")
    assert in_process(monkeypatch, "affmap-report", [output, "--check"]) == 1  # its stages are whole
    assert capsys.readouterr().err == f"{output} holds no report.\naffmap-report makes a report anew.\n"
    assert in_process(monkeypatch, "affmap-publish", [output]) == 2
    assert "this result is not to be published: SMOKE RUN" in capsys.readouterr().err
    assert in_process(monkeypatch, "affmap-status", [output, "model.context_size=0,1,2"]) == 0
    assert "2 of 3 settings complete, 1 missing" in capsys.readouterr().out
    assert contents(swept) == before
    copied = shutil.copytree(output, tmp_path / "copied")
    assert in_process(monkeypatch, "affmap", [str(copied)]) == 2
    assert capsys.readouterr().err.startswith(f"the sweep of {copied} writes to {output}; ")
    assert in_process(monkeypatch, "affmap", [str(copied), f"output={copied}"]) == 0


def test_a_folder_that_is_not_there_is_called_so(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the nearest of those that are there, and all of them."""
    for folder, end in (("ouptut", f"; did you mean {swept / 'output'}?"), ("x", ".")):
        for entry in ("affmap", "affmap-report", "affmap-publish", "affmap-status"):
            assert in_process(monkeypatch, entry, [str(swept / folder)]) == 2
            message = f"{swept / folder} is neither a folder nor an override key=value{end} Folders of sweeps: "
            assert capsys.readouterr().err.endswith(f"{message}{swept / 'output'}.\n")
    assert in_process(monkeypatch, "affmap", [str(swept / "output"), str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"'{tmp_path}' is a second folder; give one folder at a time.\n"


def tables(folder: Path, *overrides: str) -> list[tuple[str, bytes]]:
    """The tables and weights of all jobs, and where they lie in the store."""
    files = []
    for config in jobs(folder, *overrides):
        job = pipeline.find(config)
        assert job is not None
        for path in (
            job.control[0] / "runs.csv",
            job.train[0] / "validation.csv",
            job.train[0] / "weights.safetensors",
        ):
            files.append((str(path.relative_to(folder)), path.read_bytes()))
    return files


def kill(folder: Path, *overrides: str) -> None:
    """Start a sweep and kill it outright in the middle of its first training, or else soon after."""
    process = subprocess.Popen(
        [COMMAND, *line(folder, *overrides)], cwd=folder, env=ENVIRONMENT, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 100
    store = folder / "store"
    while not [*store.glob("train/*/last.ckpt"), *store.glob("map")] and time.monotonic() < deadline:
        assert process.poll() is None, "the sweep ended before it could be killed"
        time.sleep(0.002)
    process.kill()
    process.wait()


def test_a_sweep_that_was_killed_and_goes_on_with_two_workers_ends_with_the_same_tables(
    swept: Path, tmp_path: Path
) -> None:
    """The undisturbed sweep of one worker, byte by byte."""
    kill(tmp_path, *SWEEP)
    assert not any(pipeline.find(config) for config in jobs(tmp_path, *SWEEP))
    result = command(tmp_path, *SWEEP, "hydra.launcher.n_jobs=2")
    assert result.returncode == 0, result.stdout + result.stderr
    lines = ["single: 0 of 2 settings are complete.", "single: all 2 settings are complete."]
    hint = f"affmap-report {tmp_path / 'output'} shows and draws the results."
    told = [line for line in result.stdout.splitlines() if "stages complete" not in line]  # of a slow machine
    assert told == [*lines, hint], "the workers are silent"
    assert all("control" in path.read_text() for path in tmp_path.rglob("affmap.log"))
    assert tables(tmp_path, *SWEEP) == tables(swept, *SWEEP)
    assert not list((tmp_path / "store").glob("*/*.partial"))


def test_a_single_setting_shares_what_a_sweep_has_made(swept: Path) -> None:
    """The gradient planner on the sweep's models: only control is new; the same in this process, from a fresh store."""
    before = contents(swept / "store")
    overrides = ["planner=gradient", "model.context_size=1"]
    result = command(swept, *overrides)
    assert result.returncode == 0, result.stdout + result.stderr
    after = contents(swept / "store")
    assert {name: after[name] for name in before} == before
    assert {Path(name).parts[0] for name in set(after) - set(before)} == {"control"}
    table = pd.read_csv(find_setting(swept, *overrides).control[0] / "runs.csv")
    assert set(table["planner"]) == {"gradient"} and set(table["context_size"]) == {1} and len(table) == 8


def test_stages_do_not_depend_on_what_ran_before(swept: Path, tmp_path: Path) -> None:
    """One setting of the sweep alone, called as a function in this process, against the sweep: byte by byte."""
    (config,) = jobs(tmp_path, "planner=cem", "model.context_size=1")
    job = pipeline.run(config)
    assert tables(tmp_path, "model.context_size=1") == tables(swept, "model.context_size=1")
    for name, folder in (("dataset.npz", *job.data), ("maps.npz", *job.map), ("trajectories.npz", *job.control)):
        own = np.load(folder / name)
        other = np.load(swept / folder.relative_to(tmp_path) / name)
        assert set(own) == set(other)
        for key in own:
            np.testing.assert_array_equal(own[key], other[key], err_msg=key)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["model.context_size=-1"], "conf/model/default.yaml or the command line: model.context_size = -1 is not"),
        (["experiment=exp1", "members=0"], "conf/config.yaml or the command line: members = 0 is not allowed"),
        (["planner=oracle"], "planner = 'oracle' does not exist"),
        (["modle.context_size=3"], "modle is not a known key"),
        (["experiment=exp1,lookups"], "experiment takes one name at a time"),
        (["vehicle.radius=0.15"], "start_margin = 0.1 is too small for a vehicle of radius 0.15"),
        (["data.num_validation=4"], "data: num_validation = 4 leaves nothing to train on"),
    ],
)
def test_a_mistake_is_reported_in_a_sentence_before_anything_is_made(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    overrides: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for entry in ("affmap", "affmap-report", "affmap-publish") if "members=0" in overrides else ("affmap",):
        assert in_process(monkeypatch, entry, line(tmp_path, *overrides)) == 2
        captured = capsys.readouterr()
        assert message in captured.err and "Traceback" not in captured.err and captured.out == ""
    assert not list(tmp_path.iterdir())


def test_a_mistake_on_a_real_command_line(tmp_path: Path) -> None:
    """Status 2, the sentence alone on the error stream, and no file."""
    result = command(tmp_path, "control.beta=nan", "planner=cem,gradient")
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr == (
        "conf/control/default.yaml or the command line: control.beta = nan is not allowed: "
        "it should be a finite number.\n"
    )
    assert not list(tmp_path.iterdir())


def test_without_reference_models_there_is_nothing_to_control(tmp_path: Path) -> None:
    """`models=reference` never trains, with a reference run of other models, or without one."""
    (config,) = jobs(tmp_path, "models=reference")
    with pytest.raises(
        ConfigError, match=r"reference does not exist; a clone of the repository has it\. .* models=train"
    ):
        pipeline.run(config)
    config.reference.mkdir()
    with pytest.raises(ConfigError, match=r"reference holds no models of this configuration .* models=train"):
        pipeline.run(config)
    assert not list((tmp_path / "store").glob("train/*/weights.safetensors"))


def test_reference_models_are_controlled_without_training(swept: Path, tmp_path: Path) -> None:
    """The sweep's models put where the reference run's lie: the same runs as the sweep's, and no training."""
    (config,) = jobs(tmp_path, "models=reference", "model.context_size=1")
    (tmp_path / "reference").mkdir()
    (tmp_path / "reference" / "train").symlink_to(swept / "store" / "train")
    job = pipeline.run(config)
    assert not (tmp_path / "store" / "train").exists() and (tmp_path / "reference") in job.train[0].parents
    trained = find_setting(swept, "model.context_size=1")
    assert (job.control[0] / "runs.csv").read_bytes() == (trained.control[0] / "runs.csv").read_bytes()
    assert job.control != trained.control


TRIALS = ["training.transition_lr=[0.008,1e4,0.001]", "training.vision_lr=[0.001,0.002,0.003]", "model.context_size=1"]


def test_trials_are_trained_and_validated_only(swept: Path, tmp_path: Path) -> None:
    """Means over members by hand from the table, one for each trial, and NaN for the one that no training survives;
    the first two stages, once."""
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "data").symlink_to(swept / "store" / "data")
    (config,) = jobs(tmp_path, *TRIALS)
    actual = pipeline.validation(config)
    table = pd.read_csv(tmp_path / "store" / "train" / TRAIN.of(config).digest / "validation.csv")
    last = table[table["epoch"] == 2].pivot(index="trial", columns="member", values="validation_nll")
    assert last.shape == (3, 2)
    np.testing.assert_allclose(actual, [last.loc[0].mean(), np.nan, last.loc[2].mean()])
    assert np.isfinite(actual).tolist() == [True, False, True]
    before = contents(tmp_path / "store")
    np.testing.assert_array_equal(pipeline.validation(config), actual)
    assert contents(tmp_path / "store") == before
    assert {path.name for path in (tmp_path / "store").iterdir()} == {"data", "train"}


def test_without_trials_there_is_one_validation(swept: Path) -> None:
    """The sweep's table, by hand; nothing is made again."""
    (config,) = jobs(swept, "planner=cem", "model.context_size=1")
    before = contents(swept / "store")
    table = pd.read_csv(find_setting(swept, "planner=cem", "model.context_size=1").train[0] / "validation.csv")
    np.testing.assert_allclose(pipeline.validation(config), [table.query("epoch == 2")["validation_nll"].mean()])
    assert contents(swept / "store") == before


def test_trials_are_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a function and as a command: a sentence, before anything is made."""
    message = (
        "training.vision_lr = [0.001, 0.002, 0.003] makes a training of 3 trials, which is validated only; "
        "give numbers to paint maps and fly agents."
    )
    (config,) = jobs(tmp_path, *TRIALS)
    with pytest.raises(ConfigError) as caught:
        pipeline.run(config)
    assert str(caught.value) == message
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap", line(tmp_path, *TRIALS)) == 2
    assert capsys.readouterr().err == message + "\n"
    assert not list(tmp_path.iterdir())


def test_validation_takes_no_other_models_than_those_asked_for(tmp_path: Path) -> None:
    """The reference run has none of these trials."""
    (config,) = jobs(tmp_path, *TRIALS, "models=reference")
    config.reference.mkdir()
    with pytest.raises(ConfigError, match="reference holds no models of this configuration"):
        pipeline.validation(config)
    assert [*tmp_path.iterdir()] == [config.reference]


def test_the_error_of_look_ups_is_that_along_each_run(swept: Path) -> None:
    """Computed again from the trajectories, one member and run at a time, with a map and exact look-ups made anew."""
    (config,) = jobs(swept, "planner=cem", "model.context_size=1")
    job = find_setting(swept, "planner=cem", "model.context_size=1")
    table = pd.read_csv(job.control[0] / "runs.csv")
    whole = restore(Stack(config.model, 1, config.seeds), job.train[0] / "weights.safetensors")
    with np.load(job.control[0] / "trajectories.npz") as arrays:
        positions = torch.from_numpy(arrays["position"])
    painted = AffordanceMap.paint(whole, [config.control_layout.map], config.lookup.spacing)
    exact = ExactLookup(whole, [config.control_layout.map])
    for b, error in enumerate(table["lookup_error"]):
        member = config.seeds.index(table["member"][b])
        path = positions[b].expand(config.members, -1, -1)
        expected = (painted(path) - exact(path))[member].abs().mean()
        assert error == pytest.approx(expected.item(), abs=2e-6)
    assert table["lookup_error"].nunique() > 2


def test_in_a_procedural_layout_each_run_has_a_world_of_its_own_that_all_settings_share(tmp_path: Path) -> None:
    """Experiment V's worlds: eight different ones, drawn again from member and run, the same at each context size."""
    four = "training_layouts=[training_obstacles,training_fog,training_force_up,training_force_down]"
    overrides = [four, "control_layout=procedural_easy", "map_layout=four_properties"]
    drawn = Procedural.load("layout", "procedural_easy")
    expected = [drawn.draw(generator(member, "world", run)) for member in (0, 1) for run in range(4)]
    for size in (0, 1):
        (config,) = jobs(tmp_path, *overrides, f"model.context_size={size}")
        job = pipeline.run(config)
        flown = [Layout.checked(layout, "here") for layout in json.loads((job.control[0] / "layouts.json").read_text())]
        assert flown == expected and len({layout.map for layout in flown}) == 8
        results = Results((job,))
        assert results.layouts == ["procedural_easy"] and results.map_layout(job).name == "four_properties"
        assert [world.name for world in results.training_layouts(job)] == [
            layout.name for layout in config.training_layouts
        ]
        worlds = [[(c.x, c.y, c.radius, c.effect) for c in world.circles] for world in results.run_layouts(job)]
        assert worlds == [[(*c.center, c.radius, c.effect) for c in layout.circles] for layout in expected]
        assert results.exploration(job).counts.shape == (4, 20, 30)


def test_a_growth_run_is_made_with_its_experiment(tmp_path: Path) -> None:
    """Experiment III brings its longer training along: maps of all snapshots, the last of which are the maps."""
    overrides = ["experiment=exp3", "model.context_size=1", "world=three_looks"]
    result = command(tmp_path, *overrides)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "exp3_growth: all 1 settings are complete" in result.stdout
    asked = Sweep.read([*line(tmp_path), *overrides])
    whole = completed(asked)
    results = Results(whole.settings, whole.growth)
    assert whole.missing == "" and results.growth is not None and len(results.settings) == 1
    maps = results.growth_maps
    assert maps is not None and maps.epochs.tolist() == [1, 2] and maps.codes.shape == (2, 9, 13, 8)
    np.testing.assert_array_equal(maps.snapshots[2].codes, maps.codes)
    assert np.abs(maps.snapshots[1].codes - maps.codes).max() > 0
    assert np.abs(maps.snapshots[1].codes - maps.initial_codes).max() > 0
    assert not results.maps()[1].snapshots  # of the experiment itself they are not wanted
    assert asked.growth().first.output != asked.first.output  # which is for this experiment's report


def test_a_partial_report_is_made_of_what_there_is(swept: Path) -> None:
    """On request only: the two settings of three that are complete, and a sentence about the third."""
    wanted = [*line(swept), "planner=cem", "model.context_size=0,1,3"]
    part = completed(Sweep.read([*wanted, "report.partial=true"]))
    assert [job.context_size for job in part.settings] == [0, 1]
    assert part.missing == "1 of 3 settings are not complete (model.context_size=3)"
    with pytest.raises(ConfigError, match="1 of 3 settings are not complete"):
        completed(Sweep.read(wanted))
    with pytest.raises(ConfigError, match="1 of 1 settings are not complete"):
        completed(Sweep.read([*wanted[:-1], "model.context_size=3", "report.partial=true"]))


def test_one_factor_at_a_time(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table of the values of a key on request, with no other key varied."""
    monkeypatch.chdir(tmp_path)
    overrides = ["model.context_size=1", "control.beta=1,10", f"output={tmp_path / 'beta'}"]
    for beta in (1, 10):
        pipeline.run(jobs(swept, "model.context_size=1", f"control.beta={beta}")[0])
    assert in_process(monkeypatch, "affmap-report", [*line(swept), *overrides, "report.compare=control.beta"]) == 0
    table = pd.read_csv(tmp_path / "beta/tables/control_beta.csv")
    assert set(table["a"]) == {1} and set(table["b"]) == {10} and set(table["members"]) == {2}
    assert (tmp_path / "beta/figures/control_beta.png").is_file()
    for beta in (1, 10):
        pipeline.run(jobs(swept, "model.context_size=1", f"control.beta={beta}", "planner.num_iterations=2")[0])
    several = [*line(swept), *overrides, "planner.num_iterations=2,3", "report.compare=control.beta"]
    assert in_process(monkeypatch, "affmap-report", several) == 2
    assert "but planner.num_iterations differ, too; sweep over one key at a time" in capsys.readouterr().err
    manifest.save(tmp_path / "beta", {"stages": []}, {})
    again = [*line(swept), *overrides, "report.compare=control.beta"]
    assert in_process(monkeypatch, "affmap-report", again) == 2
    assert "holds a report; say output=runs/<name> for a comparison" in capsys.readouterr().err


def test_a_report_of_an_incomplete_sweep_says_what_is_missing(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of three settings was never run."""
    before = contents(swept)
    for entry in ("affmap-report", "affmap-publish"):
        assert in_process(monkeypatch, entry, line(swept, "model.context_size=0,1,3")) == 2
        assert (
            "1 of 3 settings are not complete (model.context_size=3); run `affmap scale=smoke"
            in capsys.readouterr().err
        )
    assert contents(swept) == before


def test_a_report_of_a_large_incomplete_sweep_lists_few_settings_and_names_one_that_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By hand: 40 jobs, of which nothing is there, beside a smoke run of one; and of that folder itself."""
    monkeypatch.chdir(tmp_path)
    large = ["experiment=lookups", "members=1", "seed=range(40)", "lookup.spacing=0.1"]
    small = [*TINY, "experiment=lookups", "lookup.spacing=0.25"]
    assert in_process(monkeypatch, "affmap", small) == 0
    folder = Sweep.read(small).first.output
    other = f" Another sweep is complete: `affmap-report {folder}` reports it.\n"
    capsys.readouterr()
    listed = "40 of 40 settings are not complete (seed=0; seed=1; seed=2; seed=3; seed=4 and 35 more); run `affmap "
    for arguments, hint in ((large, other), ([*large, f"output={folder}"], "\n")):
        assert in_process(monkeypatch, "affmap-report", arguments) == 2
        message = capsys.readouterr().err
        assert message.startswith(listed) and message.endswith(f"` first.{hint}")
    shutil.rmtree(tmp_path / "runs/store/control")
    assert in_process(monkeypatch, "affmap-report", large) == 2
    assert capsys.readouterr().err.endswith("` first.\n")


def test_losses_go_to_tensorboard_where_that_is_asked_for(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder for each training; stages of the same names and bytes as without."""
    pytest.importorskip("tensorboard")
    assert in_process(monkeypatch, "affmap", [*line(tmp_path, *SWEEP), "logger=tensorboard"]) == 0
    for name in ("validation.csv", "runs.csv", "weights.safetensors"):
        actual, expected = (
            {str(path.relative_to(folder)): path.read_bytes() for path in folder.glob(f"store/*/*/{name}")}
            for folder in (tmp_path, swept)
        )
        assert len(actual) == 2 and actual == {each: expected[each] for each in actual}, (
            name
        )  # others may have added some
    boards = {path.name for path in (tmp_path / "output" / "tensorboard").iterdir()}
    trained = {config.model.context_size: TRAIN.of(config).digest for config in jobs(tmp_path, *SWEEP)}
    assert boards == {f"context size {size}, {digest[:8]}" for size, digest in trained.items()}


@pytest.mark.parametrize("asked", [SWEEP, ["search=training", "hydra.sweeper.num_trials=1"]], ids=["sweep", "search"])
@pytest.mark.parametrize("logger", ["tensorboard", "wandb", "mlflow", "trackio"])
def test_a_missing_logger_is_reported_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], asked: list[str], logger: str
) -> None:
    """One sentence with the remedy."""
    monkeypatch.setattr(affmap.pipeline.machine, "find_spec", lambda name: None)
    assert in_process(monkeypatch, "affmap", [*line(tmp_path, *asked), f"logger={logger}"]) == 2
    message = capsys.readouterr().err
    assert re.fullmatch(rf"logger = '{logger}' needs .*: pip install \"{logger}.*\", or say logger=csv\.\n", message)
    assert not list(tmp_path.rglob("*"))


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a GPU."""
    for place, name, value in (
        (torch.cuda, "is_available", False),
        (torch.cuda, "device_count", 0),
        (torch.backends.mps, "is_available", False),
    ):
        monkeypatch.setattr(place, name, lambda value=value: value)


NO_GPU = [
    ("control.device=cuda", "control.device = 'cuda': PyTorch finds no CUDA GPU here; say control.device=cpu"),
    (
        "training.accelerator=gpu",
        "training.accelerator = 'gpu': PyTorch finds no GPU here; say training.accelerator=cpu",
    ),
]


@pytest.mark.usefixtures("no_gpu")
def test_a_missing_gpu_is_reported_before_anything_runs(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence for all jobs; those whose stages are complete need none."""
    for overrides, message in NO_GPU:
        assert in_process(monkeypatch, "affmap", line(tmp_path, *SWEEP, overrides)) == 2
        assert capsys.readouterr().err == f"{message}.\n"
        assert in_process(monkeypatch, "affmap", line(swept, *SWEEP, overrides)) == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_gpu")
def test_a_missing_gpu_of_another_machine_is_reported_at_the_start_of_a_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is explored, with the reason in the status."""
    for overrides, message in NO_GPU:
        (config,) = jobs(tmp_path, overrides)
        with pytest.raises(MachineError, match=re.escape(message)):
            pipeline.run(config)
        assert [path.name for path in (tmp_path / "store").glob("*/*.partial/*")] == ["unfinished"]
        assert in_process(monkeypatch, "affmap-status", line(tmp_path, overrides)) == 0
        assert message in capsys.readouterr().out


@pytest.mark.usefixtures("no_gpu")
def test_a_missing_gpu_stops_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is no failure of the trials, none of which is kept, however many may fail; its sentence is all that is said
    on stderr. Here, before anything runs, and on a cluster, in the first trial."""
    asked = line(tmp_path, "search=training", "training.accelerator=gpu", "hydra.sweeper.num_trials=4")
    assert in_process(monkeypatch, "affmap", asked) == 2
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("affmap.cli.run.runs_here", lambda composed: False)
    for allowed in (0, 9):
        assert in_process(monkeypatch, "affmap", [*asked, f"hydra.sweeper.max_failures={allowed}"]) == 2
        message = "training.accelerator = 'gpu': PyTorch finds no GPU here; say training.accelerator=cpu."
        assert capsys.readouterr().err.splitlines()[-1] == message
    assert not list(tmp_path.rglob("trials.jsonl"))


def test_gpus_that_are_there_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two, the first and the second, not the third; Apple's trains."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: True)
    for device in ("cpu", "cuda", "cuda:0", "cuda:1"):
        (config,) = jobs(tmp_path, f"control.device={device}", "training.accelerator=gpu")
        check_devices(config, (TRAIN, CONTROL))
    (config,) = jobs(tmp_path, "control.device=cuda:2")
    with pytest.raises(MachineError, match=r"'cuda:2': PyTorch finds only 2 \(from cuda:0\) here"):
        check_devices(config, (CONTROL,))
    check_devices(config, (TRAIN,))


@pytest.mark.parametrize("asked", [SWEEP, ["search=training", "hydra.sweeper.num_trials=1"]], ids=["sweep", "search"])
def test_a_disk_without_locks_is_reported_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], asked: list[str]
) -> None:
    """One sentence with the folder and the remedy, and nothing is begun; the status tells what there is."""
    monkeypatch.chdir(tmp_path)

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    arguments = line(tmp_path, *asked)
    assert in_process(monkeypatch, "affmap", arguments) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith(str(tmp_path))
    assert "is on a disk without locks (No locks available)" in message and "store=" in message
    assert not list(tmp_path.rglob("*.partial"))
    assert in_process(monkeypatch, "affmap-status", arguments) == 0
    assert re.search(r"2 missing|0 of 1 trials complete", capsys.readouterr().out)


def test_publishing_keeps_report_and_models(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A report of a few stand-in files: tables and pictures are kept, vector figures and logs are not; models are found
    from then on with `models=reference`. Not kept: smoke runs, reports of other results, models where only the report
    is wanted."""
    output = tmp_path / "runs" / "exp"
    names = ["report.pdf", "figures/one.png", "figures/one.pdf", "tables/runs.csv"]
    for name in (*names, "jobs/a/affmap.log", "tensorboard/a/events.out.tfevents.1"):
        (output / name).parent.mkdir(parents=True, exist_ok=True)
        (output / name).write_text(name)
    kept = tmp_path / "runs" / "reference"
    places = [f"output={output}", f"reference={kept / 'store'}", *SWEEP]
    assert in_process(monkeypatch, "affmap-publish", [*line(swept)[:10], f"store={swept / 'store'}", *places]) == 2
    assert "SMOKE RUN" in capsys.readouterr().err and not kept.exists()
    places.append("notice=null")
    arguments = [*line(swept)[:10], f"store={swept / 'store'}", *places]
    assert in_process(monkeypatch, "affmap-publish", arguments) == 2
    assert "holds no report of these results" in capsys.readouterr().err and not kept.exists()
    used = {stage.digest for config in jobs(swept, *SWEEP) for stage in pipeline.stages(config)}
    listed = {name: sha256(output / name) for name in names}
    manifest.save(output, {"stages": [{"digest": digest} for digest in used]}, listed)
    assert in_process(monkeypatch, "affmap-publish", [*arguments, "--report-only"]) == 0
    assert [path.name for path in kept.iterdir()] == ["exp"]
    for _ in range(2):  # the second time replaces the first
        assert in_process(monkeypatch, "affmap-publish", arguments) == 0
    capsys.readouterr()
    files = {str(path.relative_to(kept)) for path in kept.rglob("*") if path.is_file()}
    assert {name for name in files if name.startswith("exp/")} == {
        "exp/provenance.json",
        "exp/report.pdf",
        "exp/figures/one.png",
        "exp/tables/runs.csv",
    }
    for config in jobs(swept, *SWEEP):
        folder = f"store/train/{TRAIN.of(config).digest}"
        for name in ("weights.safetensors", "validation.csv"):
            assert (kept / folder / name).read_bytes() == (swept / folder / name).read_bytes()
        assert Store(kept / "store").find(TRAIN.of(config)) == kept / folder
    assert len(files) == 4 + 2 * 3


def test_a_report_is_not_published_onto_itself(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the reference's store beside the reports, logs and pages would be lost; publishing is not reached."""
    monkeypatch.setattr(publish, "check_publishable", lambda notice: None)
    monkeypatch.setattr("affmap.report.build.check", lambda report: None)
    before = contents(swept)
    assert in_process(monkeypatch, "affmap-publish", line(swept, *SWEEP)) == 2
    assert "would be published as" in (message := capsys.readouterr().err) and "say reference=<folder>/store" in message
    assert contents(swept) == before


@pytest.mark.parametrize("entry", ["affmap", "affmap-report"])
@pytest.mark.parametrize("output", ["file", "file/deeper"])
def test_an_output_that_can_be_no_folder_is_refused(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], entry: str, output: str
) -> None:
    """A file is there, or on the way; the sweep itself is complete, so nothing else would tell."""
    (swept / "file").write_text("mine")
    assert in_process(monkeypatch, entry, [*line(swept, *SWEEP), f"output={swept / output}"]) == 2
    captured = capsys.readouterr()
    assert f"output = {swept / output} cannot be made: {swept / 'file'} is a file; say output=" in captured.err
    assert captured.out == "" and (swept / "file").read_text() == "mine"


def test_a_report_of_other_results_is_not_replaced(
    swept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By hand: the provenance of a report names one stage that is not of this sweep; nothing is run or drawn."""
    output = swept / "taken"
    output.mkdir()
    manifest.save(output, {"stages": [{"digest": "another"}]}, {})
    for entry in ("affmap", "affmap-report"):
        assert in_process(monkeypatch, entry, [*line(swept, *SWEEP), f"output={output}"]) == 2
        assert "holds the report of other results" in capsys.readouterr().err
    assert [path.name for path in output.iterdir()] == ["provenance.json"]


def test_a_report_and_all_that_it_comes_from_can_be_checked(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whole; then a table changed, a stage corrupted, and a sweep larger than the one run: each is reported."""
    folder = tmp_path / "checked"
    shutil.copytree(swept, folder)
    arguments = line(folder, *SWEEP)
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 1
    told = f"{folder / 'output'} holds no report.\naffmap-report makes a report anew.\n"
    assert capsys.readouterr().err == told
    assert in_process(monkeypatch, "affmap-report", arguments) == 0
    capsys.readouterr()
    assert in_process(monkeypatch, "affmap-report", [*arguments, "--check"]) == 0
    assert (
        capsys.readouterr().out == f"9 stages and the report in {folder / 'output'}: every file is as it was written.\n"
    )
    table = folder / "output/tables/runs.csv"
    table.write_text(table.read_text().replace("0.", "1.", 1))
    weights = find_setting(folder, "model.context_size=1").train[0] / "weights.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1])
    more = [each.replace("=0,1", "=0,1,2") for each in arguments]
    assert in_process(monkeypatch, "affmap-report", ["--check", *more]) == 1
    message = capsys.readouterr().err
    assert f"{table} is not as it was written." in message and f"{weights} is corrupted; remove the folder" in message
    assert message.count(" is missing.") == 4  # the third setting's training, predictions, maps and control
    by_stages = "affmap with the same arguments makes missing stages.\n"
    assert message.index(str(weights)) < message.index(by_stages) < message.index(str(table))
    assert message.endswith("affmap-report makes a report anew.\n")
    shutil.rmtree(weights.parent)
    assert in_process(monkeypatch, "affmap-report", arguments) != 0  # as the stage is missing, no report can be made
    table.write_text(table.read_text().replace("1.", "0.", 1))
    capsys.readouterr()
    assert in_process(monkeypatch, "affmap-report", ["--check", *arguments]) == 1
    assert re.fullmatch(rf"Stage train/\w+ is missing\.\n{by_stages}", capsys.readouterr().err)
    fewer = [each.replace("=0,1", "=0") for each in arguments]
    assert in_process(monkeypatch, "affmap-report", ["--check", *fewer]) == 2
    told = f"{folder / 'output'} holds the report of other results; say output= with the folder of this one.\n"
    assert capsys.readouterr().err.endswith(told)


@pytest.mark.parametrize("entry", ["affmap-report", "affmap-publish"])
def test_flags_are_not_swallowed(
    entry: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert in_process(monkeypatch, entry, ["experiment=exp1", "--force"]) == 2
    assert "--force is not known here" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--hydra-help"], "--multirun"),
        (["experiment=exp1", "model.context_size=3", "--cfg", "job"], "context_size: 3"),
    ],
)
def test_hydra_s_own_flags(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    """Flags of every Hydra application; nothing is run."""
    monkeypatch.chdir(tmp_path)
    assert in_process(monkeypatch, "affmap", arguments) == 0
    assert message in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_affmap_without_arguments_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The default setting takes an hour, and is run by name; the answer names purpose, examples, and where to go on."""
    monkeypatch.chdir(tmp_path)
    for arguments in ([], ["-m"]):
        assert in_process(monkeypatch, "affmap", arguments) == 2
        captured = capsys.readouterr()
        assert captured.out == "" and captured.err.startswith("affmap: run the incomplete jobs")
        assert len(re.findall("^  affmap ", captured.err, re.MULTILINE)) == 5
        assert "`affmap --help` lists" in captured.err and "`affmap name=single` runs the defaults" in captured.err
    assert Sweep.read(["name=single"]).configs == Sweep.read([]).configs and not list(tmp_path.iterdir())


def test_the_help_of_affmap_fits_a_window(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """60 lines of 115 columns; every file of a group that has several is an override that the help names."""
    assert in_process(monkeypatch, "affmap", ["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 60 and max(map(len, lines)) <= 115
    words = {word.strip(",") for line in lines for word in line.split()}
    assert {"fog", "procedural_hard", "planner:", "printed/cem", "gru", "factors/beta", "smoke", "reference"} <= words


@pytest.mark.parametrize("entry", ["affmap", "affmap-status", "affmap-report", "affmap-publish"])
def test_all_commands_know_the_version(
    entry: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """That of affmap first, and torch's and Hydra's, on one line."""
    assert in_process(monkeypatch, entry, ["--version"]) == 0
    told = capsys.readouterr().out
    assert re.fullmatch(rf"affmap {version('affmap')} \(torch {re.escape(version('torch'))}, Hydra 1\..*\)\n", told)


@pytest.mark.parametrize("module", [paper, publish, report, run, status, render, window])
def test_optimised_bytecode_has_help(
    module: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without docstrings, as `python -OO` leaves a command."""
    monkeypatch.setattr(module.main, "__doc__", None)
    monkeypatch.setattr(sys, "argv", ["a command", "--help"])
    with contextlib.suppress(SystemExit):
        module.main()
    assert re.match(r"affmap(-\w+)?: [a-z ]{10}.*\n\nusage: affmap(.*\n)+examples:\n  affmap", capsys.readouterr().out)


@pytest.mark.parametrize("entry", ["affmap", "affmap-status", "affmap-report", "affmap-publish"])
def test_help_begins_with_the_purpose_then_usage_and_examples(
    entry: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each example but those of flags alone is a command line that is accepted."""
    assert in_process(monkeypatch, entry, ["--help"]) == 0
    message = capsys.readouterr().out
    assert re.match(rf"{entry}: [a-z ]{{10}}.*\n\nusage: {entry} ?.*\n(.*\n)+ *examples:\n", message)
    examples = re.findall(rf"^  {entry}((?: [\w/=.,-]+)*)(?:$|   )", message.partition("examples:")[2], re.MULTILINE)
    assert len(examples) >= 3
    for example in examples:
        overrides = [argument for argument in example.split() if "=" in argument]
        assert Sweep.read(overrides).configs or Search.read(overrides)


def test_a_configuration_that_cannot_be_run_is_not_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert in_process(monkeypatch, "affmap", ["members=-1", "--cfg", "job"]) == 2
    captured = capsys.readouterr()
    assert "members = -1 is not allowed" in captured.err and captured.out == ""


def test_several_jobs_are_not_printed_as_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hydra's own error speaks of an ambiguous value; a sweep of the experiment is none of the line."""
    for flags in ([], ["-m"]):
        assert in_process(monkeypatch, "affmap", [*flags, "model.context_size=3,5", "--cfg", "job"]) == 2
        told = "--cfg shows a single job, and model.context_size=3,5 makes several; give one value.\n"
        assert capsys.readouterr().err == told


def test_output_that_nobody_reads_is_no_mistake() -> None:
    """`head -1` closes the pipe after a line."""
    program = """
from affmap.cli import app
from affmap.pipeline.stage import TRAIN

app.command(lambda _: [print(line, flush=True) for line in range(100_000)])
"""
    shell = f"{shlex.join([sys.executable, '-c', program])} | head -1"
    ended = subprocess.run(shell, shell=True, capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.stderr) == ("0\n", "")


def test_commands_draw_whatever_the_user_s_settings_of_matplotlib_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """A backend that is no more, and a file that is none, end the import of Matplotlib; not in a command's processes.

    Afterwards the caller's variables are as they were.
    """
    monkeypatch.setenv("MPLBACKEND", "Qt4Agg")
    monkeypatch.setenv("MATPLOTLIBRC", sys.executable)
    monkeypatch.setattr(sys, "argv", ["affmap-status"])
    before = dict(os.environ)
    program = [sys.executable, "-c", "import matplotlib; print(matplotlib.get_backend())"]
    answers = []

    def ask(_: list[str]) -> None:
        ended = subprocess.run(program, capture_output=True, text=True, check=False)
        answers.append(ended.stdout.strip().lower())

    ask([])
    app.command(ask)
    assert answers == ["", "agg"] and dict(os.environ) == before
