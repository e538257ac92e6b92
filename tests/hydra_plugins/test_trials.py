import csv
import errno
import hashlib
import json
import os
import pickle
from pathlib import Path
from typing import Any

import pytest
import yaml
from traces import Trace

from hydra_plugins.hyperopt_sweeper._space import SearchError, TrialError
from hydra_plugins.hyperopt_sweeper._trials import Trial, load, read, save, write_results

SEARCH = {"space": {"x": "interval(0.0,1.0)", "z": "choice(a,b)"}, "seed": 0}
TRIALS = [
    Trial(0, {"x": 0.1 + 0.2, "z": 0}, {"x": 0.1 + 0.2, "z": "a"}, 1e-17, None, 0.5),
    Trial(1, {"x": 1e-300, "z": 1}, {"x": 1e-300, "z": "b"}, None, 'ValueError: "no",\nreally ö', 0.5),
    Trial(2, {"x": 0.5, "z": 1}, {"x": 0.5, "z": "b"}, None, "MemoryError: ", 0.5, crashed=True),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save(tmp_path / "trials.jsonl", SEARCH, TRIALS)
    return tmp_path / "trials.jsonl"


def test_trials_come_back_bit_equal(path: Path) -> None:
    """Reference: what was written."""
    assert load(path, SEARCH) == TRIALS
    assert load(path.with_name("none"), SEARCH) == []


def test_a_file_cut_off_anywhere_is_corrupted(path: Path) -> None:
    """Reference: every length but the whole one, the ends of lines among them."""
    content = path.read_bytes()
    for length in range(len(content)):
        path.write_bytes(content[:length])
        with pytest.raises(SearchError, match=f"^{path} is corrupted: .* remove that file, or choose another folder"):
            load(path, SEARCH)


def test_an_edited_file_is_corrupted(path: Path) -> None:
    """Reference: every byte changed in turn."""
    content = path.read_bytes()
    for i in range(len(content)):
        path.write_bytes(content[:i] + bytes([content[i] ^ 1]) + content[i + 1 :])
        with pytest.raises(SearchError, match="is corrupted"):
            load(path, SEARCH)


def test_trials_with_entries_of_other_types_are_corrupted(path: Path) -> None:
    """Each has a valid digest, as one who means it would write."""
    whole = path.read_bytes().splitlines()
    trial = json.loads(whole[2])
    others: list[Any] = [None, "x", [], {}, [1], {"x": []}, True]
    fits: dict[str, list[Any]] = {"error": [None, "x"], "result": [None], "values": [{}, {"x": []}], "point": [{}]}
    for key in trial:
        for other in others:
            if other in fits.get(key, []):
                continue
            body = b"".join(line + b"\n" for line in (whole[1], json.dumps({**trial, key: other}).encode()))
            head = json.dumps({"sha256": hashlib.sha256(body).hexdigest()}).encode()
            path.write_bytes(head + b"\n" + body)
            with pytest.raises(SearchError, match="is corrupted"):
                read(path)


def test_a_foreign_file_executes_nothing(path: Path) -> None:
    """Reference: pickle itself, which does execute it."""

    class Foreign:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(path.with_name("executed")),)

    path.write_bytes(pickle.dumps(Foreign()))
    with pytest.raises(SearchError, match="is corrupted"):
        load(path, SEARCH)
    assert not path.with_name("executed").exists()
    pickle.loads(path.read_bytes())
    assert path.with_name("executed").exists()


def test_trials_of_another_search_are_refused(path: Path) -> None:
    """Reference: written by hand; the file stays."""
    content = path.read_bytes()
    with pytest.raises(SearchError) as error:
        load(path, {**SEARCH, "seed": 1, "direction": "maximize"})
    assert str(error.value) == (
        f'{path} belongs to another search: direction was null and is now "maximize"; seed was 0 and is now 1; '
        "give the overrides that it began with, remove that file, or choose another folder with hydra.sweep.dir."
    )
    assert path.read_bytes() == content


def test_a_kill_while_writing_leaves_the_old_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Reference: the file as it was."""

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    for function in ("fsync", "replace"):
        with monkeypatch.context() as patch:
            patch.setattr(os, function, killed)
            with pytest.raises(KeyboardInterrupt):
                save(path, SEARCH, TRIALS[:1])
        assert load(path, SEARCH) == TRIALS
    save(path, SEARCH, TRIALS[:1])
    assert load(path, SEARCH) == TRIALS[:1]


def test_a_full_disk_is_reported_with_the_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of a full disk names no file; the old file stays."""

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(TrialError, match=f"^{path}: No space left on device; make room and run the same command"):
            save(path, SEARCH, TRIALS[:1])
    assert load(path, SEARCH) == TRIALS


def test_trials_are_on_the_disk_before_they_have_their_name(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As traced: after a power cut the file is the old one or the new one."""
    trace = Trace(monkeypatch)
    save(path, SEARCH, TRIALS)
    assert trace.renamed == [path]


def test_the_file_is_plain_json(path: Path) -> None:
    """Reference: written by hand."""
    lines = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    assert lines[1] == SEARCH
    assert lines[2] == {
        "trial": 0,
        "point": {"x": 0.1 + 0.2, "z": 0},
        "values": {"x": 0.1 + 0.2, "z": "a"},
        "result": 1e-17,
        "error": None,
        "batch_seconds": 0.5,
    }


def test_results(tmp_path: Path) -> None:
    """Reference: written by hand, read by the libraries of both formats."""
    write_results(tmp_path, TRIALS, TRIALS[0])
    rows = list(csv.reader((tmp_path / "results.csv").read_text().splitlines()))
    assert rows == [
        ["trial", "status", "result", "batch_seconds", "x", "z"],
        ["0", "ok", "1e-17", "0.5", "0.30000000000000004", "a"],
        ["1", "fail", "", "0.5", "1e-300", "b"],
        ["2", "fail", "", "0.5", "0.5", "b"],
    ]
    assert yaml.safe_load((tmp_path / "optimization_results.yaml").read_text()) == {
        "name": "hyperopt",
        "best_params": {"x": 0.1 + 0.2, "z": "a"},
        "best_value": 1e-17,
    }
