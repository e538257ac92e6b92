"""The store: equal configurations share a folder, a folder is whole or not there, a stage is built once."""

import errno
import json
import multiprocessing
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import given, settings
from hypothesis import strategies as st
from traces import Trace

from affmap import compiled
from affmap.settings import ConfigError
from affmap.store import provenance
from affmap.store.attempt import Attempt
from affmap.store.files import digests
from affmap.store.provenance import PROVENANCE, canonical, versions, with_checksum, without_paths
from affmap.store.stage import Stage, StoreError, check, copy_stage
from affmap.store.store import State, Store

scalars = st.none() | st.booleans() | st.integers(-5, 5) | st.floats(allow_nan=False, allow_infinity=False) | st.text()
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3), max_leaves=6
)
STAGE = Stage("train", {"seed": 3, "model": {"context_size": 8, "widths": [1, 2.5]}})


def reordered(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: reordered(value[key]) for key in reversed(value)}
    return [reordered(item) for item in value] if isinstance(value, list) else value


def build(work: Attempt) -> None:
    (work.folder / "result.txt").write_text("done")


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.dictionaries(st.text(), values))
def test_the_order_of_keys_does_not_matter(config: dict[str, Any]) -> None:
    """One configuration, written in the reverse order at every level, and read back from JSON."""
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
        replace(STAGE, name="data"),
        replace(STAGE, config={**STAGE.config, "seed": 4}),
        replace(STAGE, config={**STAGE.config, "seed": 3.0}),
        replace(STAGE, config={**STAGE.config, "model": {"context_size": 8, "widths": [2.5, 1]}}),
        replace(STAGE, config={**STAGE.config, "more": None}),
    ]
    digests = {stage.digest for stage in [STAGE, *different]}
    assert len(digests) == 6 and all(re.fullmatch(r"[0-9a-f]{16}", digest) for digest in digests)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), Path("x"), {1, 2}])
def test_what_json_cannot_say_has_no_digest(bad: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        canonical({"key": bad})


def test_a_stage_is_built_once_and_found_from_then_on(tmp_path: Path) -> None:
    """Counted; a new `Store` on the same folder finds it too, and nothing else is left over."""
    built: list[Path] = []

    def count(work: Attempt) -> None:
        built.append(work.folder)
        build(work)

    store = Store(tmp_path / "store")
    assert store.find(STAGE) is None and not (tmp_path / "store").exists()
    folder = store.ensure(STAGE, count)
    assert folder == tmp_path / "store" / "train" / STAGE.digest == Store(tmp_path / "store").ensure(STAGE, count)
    assert len(built) == 1 and built[0] != folder
    assert {path.name for path in folder.iterdir()} == {"result.txt", PROVENANCE}
    assert {path.name for path in folder.parent.iterdir()} == {STAGE.digest}
    assert store.find(replace(STAGE, name="data")) is None


def test_a_failure_keeps_the_scratch_folder_for_the_next_attempt(tmp_path: Path) -> None:
    """What the first attempt put there is there for the second, what it wrote elsewhere is not; only then is the stage
    found, without either."""
    store = Store(tmp_path)

    def fail(work: Attempt) -> None:
        (work.folder / "half.txt").write_text("half")
        (work.scratch / "checkpoint").write_text("three quarters")
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut") as caught:
        store.ensure(STAGE, fail)
    partial = tmp_path / "train" / f"{STAGE.digest}.partial"
    assert store.find(STAGE) is None and not (partial / PROVENANCE).exists()
    # While the exception is still at hand, as in a debugger, another job can already go on.
    with FileLock(partial.with_suffix(".lock")).acquire(timeout=0):
        assert caught.value

    def go_on(work: Attempt) -> None:
        assert (work.scratch / "checkpoint").read_text() == "three quarters"
        assert list(work.folder.iterdir()) == [work.scratch]
        build(work)

    folder = store.ensure(STAGE, go_on)
    assert {path.name for path in folder.iterdir()} == {"result.txt", PROVENANCE} and not partial.exists()


def test_the_time_of_all_attempts_is_added_up(tmp_path: Path) -> None:
    """Two attempts of a twentieth of a second and more."""

    def fail(work: Attempt) -> None:
        time.sleep(0.05)
        raise RuntimeError("power cut")

    for _ in range(2):
        with pytest.raises(RuntimeError):
            Store(tmp_path).ensure(STAGE, fail)
    record = json.loads((Store(tmp_path).ensure(STAGE, build) / PROVENANCE).read_text())
    assert 0.1 <= record["seconds"] < 5


def test_a_kill_between_the_last_file_and_the_new_name_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The renaming fails once; the next attempt does not build again."""
    with monkeypatch.context() as patch:
        patch.setattr("affmap.store.store.shutil.rmtree", lambda *_, **__: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            Store(tmp_path).ensure(STAGE, build)
    assert Store(tmp_path).find(STAGE) is None
    folder = Store(tmp_path).ensure(STAGE, lambda work: pytest.fail("built again"))
    assert {path.name for path in folder.iterdir()} == {"result.txt", PROVENANCE}


def slow(store: Path, seconds: float, log: Path) -> None:
    """A job of its own process: notes in `log` when it builds."""

    def note(work: Attempt) -> None:
        with log.open("a") as file:
            file.write("built\n")
        time.sleep(seconds)
        build(work)

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
    """As for processes, in one process."""
    threads = [threading.Thread(target=slow, args=(tmp_path / "store", 0.3, tmp_path / "log")) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert (tmp_path / "log").read_text() == "built\n"
    assert (Store(tmp_path / "store").find(STAGE) or tmp_path).name == STAGE.digest


def test_waiting_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
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
    """A stage in both comes from the read-only one; a stage in neither goes to the writable one."""
    kept = Store(tmp_path / "kept").ensure(STAGE, build)
    own = Store(tmp_path / "own").ensure(STAGE, build)
    store = Store(tmp_path / "own", [tmp_path / "nowhere", tmp_path / "kept"])
    assert store.find(STAGE) == store.ensure(STAGE, build) == kept != own
    before = sorted(tmp_path.glob("kept/**/*"))
    other = replace(STAGE, name="map")
    assert store.ensure(other, build).is_relative_to(tmp_path / "own")
    assert sorted(tmp_path.glob("kept/**/*")) == before and not (tmp_path / "nowhere").exists()


def test_a_folder_without_provenance_is_no_result(tmp_path: Path) -> None:
    """As a copy that was interrupted leaves it; an empty one is none at all."""
    folder = tmp_path / "train" / STAGE.digest
    folder.mkdir(parents=True)
    (folder / "result.txt").write_text("done")
    assert Store(tmp_path).find(STAGE) is None
    with pytest.raises(StoreError, match=f"{STAGE.digest} has no provenance.json: .* remove the folder"):
        Store(tmp_path).ensure(STAGE, build)
    (folder / "result.txt").unlink()
    (folder / ".DS_Store").touch()
    assert Store(tmp_path).ensure(STAGE, build) == folder == Store(tmp_path).find(STAGE)


@pytest.fixture
def complete(tmp_path: Path) -> Path:
    """The folder of a stage of two files, one of them in a folder of its own."""

    def two(work: Attempt) -> None:
        build(work)
        (work.folder / "more").mkdir()
        (work.folder / "more" / "numbers.bin").write_bytes(bytes(range(256)))

    return Store(tmp_path).ensure(STAGE, two)


@pytest.mark.parametrize("name", ["result.txt", "more/numbers.bin", PROVENANCE])
def test_every_flipped_bit_and_every_truncation_is_found(complete: Path, tmp_path: Path, name: str) -> None:
    """A bit of each byte in turn, and each length; the message names the file and the remedy."""
    path = complete / name
    whole = path.read_bytes()
    generator = np.random.default_rng(0)
    places = range(len(whole)) if len(whole) < 300 else generator.integers(0, len(whole), 200)
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(generator.integers(8))
        for corrupted in (bytes(flipped), whole[:place]):
            path.write_bytes(corrupted)
            try:
                same = json.loads(corrupted) == json.loads(whole) if name == PROVENANCE else False
            except ValueError:
                same = False
            if same:  # white space of a text
                continue
            with pytest.raises(StoreError, match=f"{name} is .*; remove the folder .*{STAGE.digest} .* run the same"):
                Store(tmp_path).find(STAGE)
    path.write_bytes(whole)
    assert Store(tmp_path).find(STAGE) == complete


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda folder: (folder / "result.txt").unlink(), "result.txt is missing"),
        (lambda folder: (folder / "another.txt").write_text("new"), "another.txt does not belong there"),
        (lambda folder: rewrite(folder, stage="map"), "provenance.json is that of another stage"),
        (lambda folder: rewrite(folder, config={"seed": 4}), "provenance.json is that of another stage"),
        (lambda folder: (folder / PROVENANCE).write_text("[]"), "provenance.json is corrupted"),
        *((lambda folder, rules=rules: rewrite(folder, rules=rules), "is corrupted") for rules in ([1], "x", 5, None)),
        (lambda folder: rewrite(folder, rules={"train": 1.5}), "provenance.json is corrupted"),
        (lambda folder: rewrite(folder, rules={"train": 2}), "provenance.json is that of another stage"),
        (lambda folder: rewrite(folder, files=3), "provenance.json is corrupted"),
        (lambda folder: rewrite(folder, stage=None), "provenance.json is corrupted"),
        (lambda folder: (folder / PROVENANCE).write_bytes(b"\xff"), "provenance.json is corrupted"),
    ],
)
def test_other_corruption_is_reported(
    complete: Path, tmp_path: Path, harm: Callable[[Path], Any], message: str
) -> None:
    """By hand; a job that needs the stage reports the same error, and the stage stays as it is."""
    harm(complete)
    before = digests(complete)
    for use in (Store(tmp_path).find, lambda stage: Store(tmp_path).ensure(stage, build), lambda _: check(complete)):
        with pytest.raises(StoreError, match=message):
            use(STAGE)
    assert digests(complete) == before and Store(tmp_path).has(STAGE)
    assert Store(tmp_path).state(STAGE, check=True).name == "corrupted"


def test_what_systems_leave_in_a_stage_costs_nothing(complete: Path, tmp_path: Path) -> None:
    """Beside the files and below them: found, copied without it, and complete however one looks; a file of somebody
    else's is to be removed itself, and not the stage with it."""
    for name in (".DS_Store", "Thumbs.db", "more/.nfs0001", "@eaDir/result.txt@SynoEAStream"):
        (complete / name).parent.mkdir(exist_ok=True)
        (complete / name).write_text("left behind")
    (complete / "empty").mkdir()
    assert Store(tmp_path).find(STAGE) == complete
    assert {Store(tmp_path).state(STAGE, check).name for check in (False, True)} == {"complete"}
    copy_stage(complete, tmp_path / "kept" / "train" / STAGE.digest, ["*"])
    copied = sorted(path.name for path in (tmp_path / "kept").rglob("*") if path.is_file())
    assert copied == ["numbers.bin", PROVENANCE, "result.txt"]
    (complete / "mine.txt").write_text("mine")
    with pytest.raises(StoreError, match=r"mine\.txt does not belong there; remove that file and run the same command"):
        Store(tmp_path).find(STAGE)


def test_what_systems_leave_in_an_attempt_is_not_part_of_the_stage(tmp_path: Path) -> None:
    """Left before an attempt, where it may not be removable, and during it."""

    def fail(work: Attempt) -> None:
        raise RuntimeError("power cut")

    def go_on(work: Attempt) -> None:
        assert (work.folder / ".nfs0001").is_file()
        (work.folder / ".DS_Store").touch()
        build(work)

    with pytest.raises(RuntimeError):
        Store(tmp_path).ensure(STAGE, fail)
    (tmp_path / "train" / f"{STAGE.digest}.partial" / ".nfs0001").touch()
    folder = Store(tmp_path).ensure(STAGE, go_on)
    assert json.loads((folder / PROVENANCE).read_text())["files"].keys() == {"result.txt"}


def test_everything_is_on_the_disk_before_a_stage_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As traced, files and folders, and those below them."""

    def two(work: Attempt) -> None:
        build(work)
        (work.folder / "more").mkdir()
        (work.folder / "more" / "numbers.bin").write_bytes(bytes(256))

    trace = Trace(monkeypatch)
    folder = Store(tmp_path).ensure(STAGE, two)
    assert [path.name for path in trace.renamed] == ["attempt.json", PROVENANCE, folder.name]


OTHERS: list[Any] = [None, 7, -1, 1e300, 10**400, "x", [], ["x"], {}, {"x": 1}, {"x": ["y"]}, True]
"""Values of all types, and numbers without meaning."""


def test_every_entry_of_a_record_with_every_other_type_is_damage(
    complete: Path, tmp_path: Path, tried: Callable[[str, int, str], None]
) -> None:
    """Each has a valid checksum, as one who means it would write; those of `allowed` are what an entry may be."""
    whole = (complete / PROVENANCE).read_text()
    record = json.loads(whole)
    numbers: list[Any] = [7]
    allowed = {"started": ["x"], "git": [None, "x"], "machine": [{}, {"x": 1}], "versions": [{}]}
    allowed |= {"seconds": numbers, "peak_memory_mib": numbers}
    count = 0
    for key in ("stage", "digest", "config", "files", *allowed):
        rest = {name: value for name, value in record.items() if name != key}
        for changed in (rest, *({**rest, key: other} for other in OTHERS)):
            if changed.get(key, "nothing") in allowed.get(key, []):
                continue
            count += 1
            (complete / PROVENANCE).write_text(json.dumps(with_checksum(changed)))
            for look in (lambda: Store(tmp_path).find(STAGE), lambda: Store(tmp_path).ensure(STAGE, build)):
                with pytest.raises(StoreError, match=r"; remove (the|that) f.* run the same command again\."):
                    look()
            assert Store(tmp_path).state(STAGE, check=True).name == "corrupted"
    for text in ("[" * 100_000 + "]" * 100_000, whole.replace('"seconds": ', '"seconds": NaN, "x": ')):
        (complete / PROVENANCE).write_text(text)
        assert Store(tmp_path).state(STAGE).name == "corrupted"
    tried("other types in the record of a stage, with a valid checksum", count, "reported as damage with its remedy")


def test_a_note_with_entries_of_other_types_is_no_note(tmp_path: Path, tried: Callable[[str, int, str], None]) -> None:
    """Each entry that is used with each of `OTHERS`; the stage counts as not begun, and is made."""

    def fail(work: Attempt) -> None:
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError):
        Store(tmp_path).ensure(STAGE, fail)
    (path,) = tmp_path.glob("train/*.partial/unfinished/attempt.json")
    note = json.loads(path.read_text())
    assert Store(tmp_path).state(STAGE).name == "failed"
    count = 0
    for key in ("seconds", "finished", "total", "versions", "started"):
        for other in OTHERS:
            path.write_text(json.dumps(with_checksum({**note, key: other})))
            state = Store(tmp_path).state(STAGE)
            count += state.name == "missing"
            assert state.name in ("missing", "failed")
            assert state.seconds_left is None or state.seconds_left >= 0 or state.total < state.finished
    path.write_text("[" * 100_000)
    assert Store(tmp_path).state(STAGE).name == "missing"
    path.write_text(json.dumps(with_checksum({**note, "seconds": "long"})))
    Store(tmp_path).ensure(STAGE, build)
    tried("other types in the note of an attempt, with a valid checksum", count, "no note: the stage is made")


def test_without_locks_a_stage_is_not_begun_and_its_state_is_what_can_be_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`flock` refuses: complete stages are found; of others nobody knows whether a job works on them."""
    store = Store(tmp_path)
    store.ensure(STAGE, build)

    def stop(work: Attempt) -> None:
        raise KeyboardInterrupt

    other = replace(STAGE, name="map")
    with pytest.raises(KeyboardInterrupt):
        store.ensure(other, stop)

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    assert store.ensure(STAGE, build) == store.find(STAGE)
    stages = (STAGE, other, replace(STAGE, name="data"))
    assert [store.state(stage).name for stage in stages] == ["complete", "unknown", "missing"]
    with pytest.raises(ConfigError, match=r"map is on a disk without locks \(No locks available\)"):
        store.ensure(other, build)


def rewrite(folder: Path, **changes: Any) -> None:
    """Change a stage's provenance as one who means it would."""
    record = json.loads((folder / PROVENANCE).read_text())
    (folder / PROVENANCE).write_text(json.dumps(with_checksum(record | changes)))


def test_what_other_versions_made_is_refused_unless_it_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made with torch 1.0; pandas, which makes no numbers, does not matter. A reference is always used."""
    old = {**versions(), "torch": "1.0", "pandas": "0.1"}
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "versions", lambda: old)
        folder = Store(tmp_path).ensure(STAGE, build)
    message = f"{STAGE.digest} was made with torch 1.0 instead of {re.escape(str(versions()['torch']))}, .*versions=any"
    with pytest.raises(StoreError, match=message):
        Store(tmp_path).find(STAGE)
    assert Store(tmp_path, any_versions=True).find(STAGE) == folder
    assert Store(tmp_path / "new", [tmp_path]).find(STAGE) == folder
    rewrite(folder, versions={**versions(), "pandas": "0.1"})
    assert Store(tmp_path).find(STAGE) == folder
    rewrite(folder, versions={name: each for name, each in versions().items() if name != "numba"})  # older than its use
    assert Store(tmp_path).find(STAGE) == folder


def test_what_other_versions_began_is_not_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Begun with NumPy 1.0, and interrupted: a result of two versions would be that of neither."""

    def fail(work: Attempt) -> None:
        raise RuntimeError("power cut")

    with monkeypatch.context() as patch:
        patch.setattr("affmap.store.attempt.versions", lambda: {**versions(), "numpy": "1.0"})
        with pytest.raises(RuntimeError):
            Store(tmp_path).ensure(STAGE, fail)
    with pytest.raises(StoreError, match=r"partial was made with numpy 1.0 instead of"):
        Store(tmp_path).ensure(STAGE, build)
    assert Store(tmp_path, any_versions=True).ensure(STAGE, build).is_dir()


def test_states(tmp_path: Path) -> None:
    """Looked at from inside the work and after it: missing, running with its progress, failed, stopped, complete."""
    store = Store(tmp_path)
    assert store.state(STAGE) == State("missing")
    seen: list[State] = []

    def work_on(work: Attempt, ending: BaseException | None) -> None:
        work._last_note = -10.0
        work.progress(3, 12)
        seen.append(store.state(STAGE))
        build(work)
        if ending:
            raise ending

    for ending, name in ((ValueError("no luck"), "failed"), (KeyboardInterrupt(), "stopped")):
        with pytest.raises(type(ending)):
            store.ensure(STAGE, lambda work, ending=ending: work_on(work, ending))
        state = store.state(STAGE)
        assert (state.name, state.error) == (name, "ValueError: no luck" if name == "failed" else "")
        assert (state.finished, state.total) == (3, 12)
    store.ensure(STAGE, lambda work: work_on(work, None))
    for state in seen:
        assert (state.name, state.finished, state.total, state.error) == ("running", 3, 12, "")
        assert state.seconds_left == pytest.approx(3 * state.seconds)
    assert store.state(STAGE).name == "complete"


def test_a_full_disk_is_reported(tmp_path: Path) -> None:
    """As the system tells it; the library's own words would not say which disk."""

    def fill(work: Attempt) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(StoreError, match=r"The disk of .*\.partial is full; make room and run the same command again"):
        Store(tmp_path).ensure(STAGE, fill)
    assert Store(tmp_path).state(STAGE).name == "failed"


def test_a_copy_of_some_files_is_a_stage_of_its_own(complete: Path, tmp_path: Path) -> None:
    """Whole, found, and replaced by the next copy; a corrupted one is not copied."""
    target = tmp_path / "kept" / "train" / STAGE.digest
    for patterns, names in ((["*.txt", "*.bin"], {"result.txt", "more/numbers.bin"}), (["result.*"], {"result.txt"})):
        copy_stage(complete, target, patterns)
        assert digests(target).keys() == {*names, PROVENANCE}
        assert Store(tmp_path / "kept").find(STAGE) == target
    (complete / "result.txt").write_text("changed")
    with pytest.raises(StoreError, match=r"result\.txt is corrupted"):
        copy_stage(complete, target, ["*"])
    assert (target / "result.txt").read_text() == "done"


PATHS = [
    "output=/a/b", "output='/a b/out'", 'output="/a"', "store=[c,/a]", "store=c,/a", "+x={a: /b}", "+x={a:'/b'}",
    "output='~/x'", "output=~me/x", "store=file:///a", "title=see\\ /a", "store=glob(/a)", "output=//a",
    "+x=choice(b,/a)", "/run/kernel.json", "--socket=/tmp/x",
]  # fmt: skip
NO_PATHS = [
    "output=runs/a", "model/transition=gru", "~title", "~report/x", "output=../x", "output=${name}/x", "store=a/~b",
    "hydra/launcher=joblib", "control.beta=0,1", "title='1 / 2'", "title=https://a.b/c", "title='about ~5'", "-m",
]  # fmt: skip


def test_paths_of_the_machine_are_no_part_of_a_command() -> None:
    """Quoted, in lists, from somebody's home, as addresses of files; by hand."""
    assert without_paths([*PATHS, *NO_PATHS]) == NO_PATHS


def test_provenance_tells_where_a_result_comes_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every field the report reads, against what is known here."""
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/affmap", "-m", "members=3", "store=/somewhere/store"])
    folder = Store(tmp_path).ensure(STAGE, lambda work: time.sleep(0.05))
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
    assert record["compiled"]
    with compiled.switched(False):
        again = Store(tmp_path / "another").ensure(STAGE, lambda work: None)
    assert not json.loads((again / PROVENANCE).read_text())["compiled"]
