"""The store: equal configurations share a folder, a folder is whole or not there, a stage is built once."""

import json
import multiprocessing
import re
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.store import PROVENANCE, Stage, Store, canonical

scalars = st.none() | st.booleans() | st.integers(-5, 5) | st.floats(allow_nan=False, allow_infinity=False) | st.text()
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3), max_leaves=6
)
STAGE = Stage("train", {"seed": 3, "model": {"context_size": 8, "widths": [1, 2.5]}})


def reordered(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: reordered(value[key]) for key in reversed(value)}
    return [reordered(item) for item in value] if isinstance(value, list) else value


def build(folder: Path) -> None:
    (folder / "result.txt").write_text("done")


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.dictionaries(st.text(), values))
def test_the_order_of_keys_does_not_matter(config: dict[str, Any]) -> None:
    """The same configuration, written in the reverse order at every level; and read back from JSON."""
    digest = Stage("data", config).digest
    assert Stage("data", reordered(config)).digest == digest
    assert Stage("data", json.loads(json.dumps(config))).digest == digest


@settings(max_examples=60, deadline=None, derandomize=True)
@given(values, values)
def test_every_difference_matters(one: Any, other: Any) -> None:
    """Digests are equal if and only if the JSON texts are; so 1, 1.0, true and "1" all differ."""
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (Stage("data", {"key": one}).digest == Stage("data", {"key": other}).digest) == same


def test_the_digest_is_that_of_2026() -> None:
    """Stored in 2026-11: the reference run's folders are found by it."""
    assert STAGE.digest == "2b946ecaeb51bbe4"
    different = [
        STAGE._replace(name="data"),
        STAGE._replace(config={**STAGE.config, "seed": 4}),
        STAGE._replace(config={**STAGE.config, "seed": 3.0}),
        STAGE._replace(config={**STAGE.config, "model": {"context_size": 8, "widths": [2.5, 1]}}),
        STAGE._replace(config={**STAGE.config, "more": None}),
    ]
    digests = {stage.digest for stage in [STAGE, *different]}
    assert len(digests) == 6 and all(re.fullmatch(r"[0-9a-f]{16}", digest) for digest in digests)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), Path("x"), {1, 2}])
def test_what_json_cannot_say_has_no_digest(bad: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        canonical({"key": bad})


def test_a_stage_is_built_once_and_found_from_then_on(tmp_path: Path) -> None:
    """Counted; a new `Store` on the same folder finds it too, and nothing but a lock is left over."""
    built: list[Path] = []

    def count(folder: Path) -> None:
        built.append(folder)
        build(folder)

    store = Store(tmp_path / "store")
    assert store.find(STAGE) is None and not (tmp_path / "store").exists()
    folder = store.ensure(STAGE, count)
    assert folder == tmp_path / "store" / "train" / STAGE.digest == Store(tmp_path / "store").ensure(STAGE, count)
    assert len(built) == 1 and built[0] != folder
    assert {path.name for path in folder.iterdir()} == {"result.txt", PROVENANCE}
    assert {path.name for path in folder.parent.iterdir()} - {f"{STAGE.digest}.lock"} == {STAGE.digest}
    assert store.find(STAGE._replace(name="data")) is None


def test_a_failure_keeps_what_was_done_for_the_next_attempt(tmp_path: Path) -> None:
    """What the first attempt wrote is there for the second, and only then the stage is found."""
    store = Store(tmp_path)

    def fail(folder: Path) -> None:
        (folder / "half.txt").write_text("half")
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut") as caught:
        store.ensure(STAGE, fail)
    partial = tmp_path / "train" / f"{STAGE.digest}.partial"
    assert store.find(STAGE) is None and (partial / "half.txt").exists() and not (partial / PROVENANCE).exists()
    # While the exception is still at hand, as in a debugger, another job can already go on.
    with FileLock(partial.with_suffix(".lock")).acquire(timeout=0):
        assert caught.value

    def go_on(folder: Path) -> None:
        assert (folder / "half.txt").read_text() == "half"
        build(folder)

    assert (store.ensure(STAGE, go_on) / "half.txt").exists() and not partial.exists()


def slow(store: Path, seconds: float, log: Path) -> None:
    """A job of its own process: notes in `log` when it builds."""

    def note(folder: Path) -> None:
        with log.open("a") as file:
            file.write("built\n")
        time.sleep(seconds)
        build(folder)

    assert (Store(store).ensure(STAGE, note) / "result.txt").read_text() == "done"


def test_processes_that_need_the_same_stage_build_it_once(tmp_path: Path) -> None:
    """One builds, the other waits and takes it; built once in all."""
    context = multiprocessing.get_context("fork")
    arguments = (tmp_path / "store", 0.5, tmp_path / "log")
    jobs = [context.Process(target=slow, args=arguments) for _ in range(2)]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(20)
    assert [job.exitcode for job in jobs] == [0, 0]
    assert (tmp_path / "log").read_text() == "built\n"


def test_threads_that_need_the_same_stage_build_it_once(tmp_path: Path) -> None:
    """The same in one process."""
    threads = [threading.Thread(target=slow, args=(tmp_path / "store", 0.3, tmp_path / "log")) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert (tmp_path / "log").read_text() == "built\n"
    assert (Store(tmp_path / "store").find(STAGE) or tmp_path).name == STAGE.digest


def test_waiting_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """While another job has the lock; the stage is built after it gave it back without building."""
    (tmp_path / "train").mkdir()
    held = threading.Event()

    def other_job() -> None:
        with FileLock(tmp_path / "train" / f"{STAGE.digest}.lock"):
            held.set()
            time.sleep(0.3)

    thread = threading.Thread(target=other_job)
    thread.start()
    assert held.wait(5)
    with caplog.at_level("INFO", logger="affmap"):
        assert (Store(tmp_path).ensure(STAGE, build) / "result.txt").exists()
    thread.join()
    assert f"Waiting for another job that makes train/{STAGE.digest}." in caplog.messages


def test_a_read_only_place_comes_first_and_is_never_written(tmp_path: Path) -> None:
    """The same stage in both: the read-only one; one that is in neither goes to the writable one."""
    kept = Store(tmp_path / "kept").ensure(STAGE, build)
    own = Store(tmp_path / "own").ensure(STAGE, build)
    store = Store(tmp_path / "own", [tmp_path / "nowhere", tmp_path / "kept"])
    assert store.find(STAGE) == store.ensure(STAGE, build) == kept != own
    before = sorted(tmp_path.glob("kept/**/*"))
    other = STAGE._replace(name="map")
    assert store.ensure(other, build).is_relative_to(tmp_path / "own")
    assert sorted(tmp_path.glob("kept/**/*")) == before and not (tmp_path / "nowhere").exists()


def test_a_folder_without_provenance_is_no_result(tmp_path: Path) -> None:
    """As a copy that was interrupted leaves it."""
    folder = tmp_path / "train" / STAGE.digest
    folder.mkdir(parents=True)
    assert Store(tmp_path).find(STAGE) is None
    (folder / PROVENANCE).write_text("{}")
    assert Store(tmp_path).find(STAGE) == folder


def test_provenance_tells_where_a_result_comes_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every field the report reads, against what is known here."""
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/affmap", "-m", "members=3", "store=/somewhere/store"])
    folder = Store(tmp_path).ensure(STAGE, lambda folder: time.sleep(0.05))
    record = json.loads((folder / PROVENANCE).read_text())
    assert record["stage"] == "train" and record["digest"] == STAGE.digest == folder.name
    assert record["config"] == STAGE.config
    assert record["command"] == "affmap -m members=3"
    assert 0.05 <= record["seconds"] < 5
    assert 10 < record["peak_memory_mib"] < 20_000
    assert time.strptime(record["started"], "%Y-%m-%dT%H:%M:%S%z")
    assert {"affmap", "torch", "lightning", "numpy", "python"} <= set(record["versions"])
    assert record["versions"]["numpy"] == np.__version__
    assert record["git"] is None or re.fullmatch(r"[0-9a-f]{12}(-dirty)?", record["git"])
    assert record["machine"]["cores"] >= 1
