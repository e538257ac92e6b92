"""Planners, models, agents, terrains and metrics from outside, by the real commands: installed, and in a folder."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import outside
import pandas as pd
import pytest
from commands import COMMAND, ENVIRONMENT, in_process, jobs, line

from affmap.config import notes
from affmap.env.registration import environments
from affmap.results.files import read_trajectories
from affmap.settings import ConfigError, extensions, folder
from affmap.store.stage import Stage

SWEEP = ["planner=cem,shooting", "model/transition=wide", "model.context_size=1", "world=breezy", "baselines=[still]"]


def run(folder: Path, name: str, *overrides: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command in a user's folder, with two workers."""
    arguments = [each for each in line(folder, *overrides) if "n_jobs" not in each]
    variables = ENVIRONMENT | environment
    return subprocess.run(
        [COMMAND.with_name(name), *arguments], cwd=folder, capture_output=True, text=True, env=variables, timeout=200
    )


def path_of(*folders: Path) -> dict[str, str]:
    return {"PYTHONPATH": os.pathsep.join([*map(str, folders), ENVIRONMENT.get("PYTHONPATH", "")])}


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's folder after a sweep with two workers, and its report."""
    site, folder = tmp_path_factory.mktemp("site"), outside.write(tmp_path_factory.mktemp("work"))
    outside.install(site)
    known = {**path_of(site), "AFFMAP_IMPORT": "notes"}
    for name, more in (("affmap", ["hydra.launcher.n_jobs=2"]), ("affmap-report", [])):
        result = run(folder, name, *SWEEP, *more, **known)
        assert result.returncode == 0, result.stdout + result.stderr
    return folder


def records(folder: Path, stage: str) -> list[dict[str, Any]]:
    return [json.loads(path.read_text("utf-8")) for path in sorted(folder.glob(f"store/{stage}/*/provenance.json"))]


def test_a_stage_names_the_modules_that_it_was_made_with(reported: Path) -> None:
    """And has the digest of its configuration, in which there are kinds and keys only."""
    names = set()
    for stage in ("data", "train", "control"):
        for record in records(reported, stage):
            assert record["digest"] == Stage(stage, record["config"], record.get("rules", {})).digest
            assert "garden" not in json.dumps(record["config"])
            for each in record["extensions"]:
                installed = {"distribution": outside.PACKAGE, "version": outside.VERSION}
                is_installed = each["name"] != "agent.kind=still"
                assert each["module"] == ("garden" if is_installed else "notes") and len(each["sha256"]) == 64
                assert {key: each[key] for key in installed if key in each} == (installed if is_installed else {})
            names.add((stage, *(each["name"] for each in record["extensions"])))
    effects = ("effect=whirl", "effect=wind")
    assert names == {
        ("data", *effects),
        ("train", *effects, "transition.kind=wide"),
        ("control", *effects, "transition.kind=wide"),
        ("control", *effects, "planner.kind=shooting", "transition.kind=wide"),
        ("control", "agent.kind=still", *effects, "transition.kind=wide"),
    }


def test_the_report_shows_all_of_them(reported: Path) -> None:
    """The metric is computed from trajectories, and is not stored; labels of terrains; the modules in provenance."""
    runs = pd.read_csv(reported / "output/tables/runs.csv")
    assert set(runs["planner"]) == {"cem", "shooting"}
    for record in records(reported, "control"):
        folder = reported / "store/control" / record["digest"]
        assert "path_length" not in pd.read_csv(folder / "runs.csv")
        if "agent" not in record["config"]:
            steps = np.diff(read_trajectories([folder]).position, axis=1)
            rows = runs.query(f"planner == {record['config']['planner']['kind']!r}")
            assert rows["path_length"].tolist() == pytest.approx(np.hypot(*np.moveaxis(steps, -1, 0)).sum(1), abs=1e-6)
    assert "path_length" in set(pd.read_csv(reported / "output/tables/medians.csv")["metric"])
    text = (reported / "output/report.html").read_text("utf-8")
    for part in ("shooting", "still", "whirls", "blows to the left", "Length of the path (u)"):
        assert part in text, part
    markdown = (reported / "output/report.md").read_text("utf-8")
    assert "**Not of affmap:** planner.kind=shooting, by the module garden of garden 1.2" in markdown
    assert "**Not of affmap:** metric=path\\_length, by the module notes\n" in markdown
    listed = json.loads((reported / "output/provenance.json").read_text("utf-8"))["extensions"]
    assert {each["name"]: each["module"] for each in listed} == {
        "agent.kind=still": "notes",
        "effect=whirl": "garden",
        "effect=wind": "garden",
        "metric=path_length": "notes",
        "planner.kind=shooting": "garden",
        "transition.kind=wide": "garden",
    }


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's folder, in which this process is; nothing that tests load here registers anything."""
    monkeypatch.chdir(outside.write(tmp_path / "work"))
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delenv(extensions.VARIABLE, raising=False)
    extensions._load.cache_clear()
    yield tmp_path / "work"
    extensions._load.cache_clear()


def told(folder: Path, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        jobs(folder, *overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("names", "override", "sentence"),
    [
        (
            "",
            "world=breezy",
            "effect = 'wind' is not allowed: it should be one of 'none', .*; one of your own is known",
        ),
        (
            "",
            "agent=still",
            r"agent.kind = 'still' is not allowed: it should be .*'oracle' .*; one of your own is known",
        ),
        (
            "note",
            "agent=still",
            "AFFMAP_IMPORT = 'note': importing 'note' failed with ModuleNotFoundError",
        ),
        (
            "re, broken",
            "agent=still",
            r"importing 'broken' failed in .*/work/broken\.py, line 3, with ZeroDivisionError: .*; correct the name",
        ),
        (
            "again",
            "agent=still",
            r"importing 'again' failed in .*/work/again/__init__\.py, line 2, with ValueError: the metric 'reached'",
        ),
        (
            "uneven",
            "agent=still",
            r"importing 'uneven' failed with SyntaxError: .*\(uneven\.py, line 2\); correct the name",
        ),
        (
            "shelve",
            "agent=still",
            r"another module 'shelve', .*/python3\..*/shelve\.py, which hides .*/work/shelve\.py; rename your module",
        ),
    ],
)
def test_a_name_that_is_not_known_is_told(
    work: Path, monkeypatch: pytest.MonkeyPatch, names: str, override: str, sentence: str
) -> None:
    """In a line each, with the names that there are, or the module and its error."""
    (work / "broken.py").write_text("import re\n\n1 / 0\n")
    (work / "uneven.py").write_text("import re\nx = (\n")
    (work / "again").mkdir()
    (work / "again/__init__.py").write_text(
        "import affmap\naffmap.register_metric('reached', affmap.Metric('reached', 'share', 'reached', print))\n"
    )
    (work / "shelve.py").touch()
    monkeypatch.setenv("AFFMAP_IMPORT", names)
    messages = told(work, override).splitlines()  # of a layout with two such circles: two
    assert messages and all(re.search(sentence, message) and ".;" not in message for message in messages)


def test_a_package_that_is_damaged_is_told_with_its_version(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who asks for nothing of it is not bothered."""
    outside.install(work / "site")
    (work / "site/garden.py").write_text("import no_such_module\n")
    monkeypatch.syspath_prepend(work / "site")
    assert told(work, "planner=shooting").endswith(
        "planner: the entry point 'things' of garden 1.2: importing 'garden' failed in "
        f"{work / 'site/garden.py'}, line 1, with ModuleNotFoundError: "
        "No module named 'no_such_module'; mend or uninstall the package."
    )
    assert jobs(work)[0].planner.kind == "cem"


@pytest.mark.parametrize("names", ["nosuch", "re,nosuch"])
def test_a_module_that_cannot_be_imported_is_told_before_anything_runs(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], names: str
) -> None:
    """Although the sweep itself needs none of them."""
    monkeypatch.setenv("AFFMAP_IMPORT", names)
    assert in_process(monkeypatch, "affmap", line(work)) == 2
    assert "importing 'nosuch' failed with ModuleNotFoundError" in capsys.readouterr().err
    assert not (work / "store").exists() and not (work / "output").exists()


def test_a_stored_file_imports_nothing(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A note of a sweep with the name of a module that lies beside it: only the variable loads it."""
    (work / "still.py").write_text(f"import os; os.mkdir({str(work / 'canary')!r})\n")
    notes.write_note(work / "output", line(work, "agent=still"))
    for names in ("", "still"):
        monkeypatch.setenv("AFFMAP_IMPORT", names)
        assert in_process(monkeypatch, "affmap-status", ["output"]) == 2
        assert "agent.kind = 'still' is not allowed" in capsys.readouterr().err
        assert (work / "canary").exists() == bool(names)


def test_a_file_of_the_current_folder_adds_to_ours_and_replaces_none(work: Path) -> None:
    """Layouts and planners; one with the name of ours is refused, but for a copy, and for names that all have."""
    planner = work / "conf/planner/mine.yaml"
    planner.write_text((folder() / "planner/cem.yaml").read_text().replace("num_candidates:", "num_candidates: 7 #"))
    layout = (folder() / "layout/original.yaml").read_text()
    (work / "conf/layout/meadow.yaml").write_text(layout.replace("name: original", "name: meadow"))
    (work / "conf/vehicle").mkdir()
    (work / "conf/vehicle/default.yaml").write_text("wheels: 4\n")
    (work / "conf/layout/original.yaml").write_text(layout)
    mine, cem = jobs(work, "planner=mine,cem", "world=meadow")
    assert mine.planner.num_candidates == 7 != cem.planner.num_candidates and mine.control_layout.name == "meadow"
    assert "affmap/Meadow-v0" in environments() and "affmap/Fog-v0" in environments()
    assert re.search("did you mean mine[?] There are: .*mine", told(work, "planner=mien"))
    assert jobs(work)[0].control_layout.name == "original"
    (work / "conf/layout/original.yaml").write_text(layout.replace("radius: 0.", "radius: 0.0"))
    ending = "of the current folder has the name of a file of affmap; give it one of its own."
    assert f"conf/layout/original.yaml {ending}" in told(work)
    planner.rename(work / "conf/planner/cem.yaml")
    assert told(work, "world=fog") == f"conf/planner/cem.yaml {ending}"
