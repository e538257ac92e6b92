"""Whatever else happens to a sweep, the same command ends with the tables of an undisturbed one, or says what to do.

Real sweeps (`sweeps.py`).
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from sweeps import CONTEXT, LINE, finish, line, results, said, start, undisturbed_sweep

from affmap import pipeline
from affmap.cli import run
from affmap.cli.status import main as show_status
from affmap.config.sweep import Sweep
from affmap.pipeline import status
from affmap.store.stage import StoreError


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep that nothing happened to."""
    return undisturbed_sweep(tmp_path_factory.mktemp("undisturbed"))


@pytest.mark.parametrize(("number", "workers"), [(signal.SIGINT, 1), (signal.SIGTERM, 2)])
def test_a_signal_ends_a_sweep_at_once_with_a_checkpoint(
    undisturbed: Path, tmp_path: Path, number: signal.Signals, workers: int
) -> None:
    """The console script in the middle of its trainings: the status of the shell's convention, a sentence, no
    traceback; no process is left, locks are free, the state says how far it is, and the same command goes on."""
    overrides = [*line(tmp_path), "training.num_epochs=100000", f"hydra.launcher.n_jobs={workers}"]
    with (tmp_path / "output.txt").open("w") as output:
        process = subprocess.Popen(
            [Path(sys.executable).with_name("affmap"), *overrides],
            stdout=output,
            stderr=output,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
    deadline = time.monotonic() + 600
    while len({path.parent for path in tmp_path.glob("store/train/*/unfinished/*.ckpt")}) < workers:
        assert process.poll() is None and time.monotonic() < deadline, said(tmp_path)
        time.sleep(0.05)
    os.kill(process.pid, number)
    assert process.wait(60) == 128 + number
    assert "run the same command again to resume." in said(tmp_path) and "Traceback" not in said(tmp_path)
    assert "resource_tracker" not in said(tmp_path)
    wait_for_workers(process.pid)
    assert len({path.parent for path in tmp_path.glob("store/train/*/unfinished/*.ckpt")}) == workers
    states = [setting.state for setting in status.jobs(Sweep.read(overrides))]
    assert states == ["stopped", "stopped" if workers == 2 else "missing"]
    assert finish(start(tmp_path)) == 0, said(tmp_path)
    assert results(tmp_path).items() >= results(undisturbed).items()


QUICK = [*LINE, "training.num_epochs=1", "seed=range(12)", "hydra.launcher.n_jobs=2"]


def wait_for_workers(session: int) -> None:
    """Wait until no process of a session is there; within seconds, or a minute on a busy machine."""
    deadline = time.monotonic() + 60
    while subprocess.run(["pgrep", "--session", str(session)], capture_output=True, check=False).stdout:
        assert time.monotonic() < deadline, "a worker is left"
        time.sleep(0.1)


def test_a_signal_at_any_moment_ends_two_workers_too(tmp_path: Path) -> None:
    """The console script with jobs of a fraction of a second, so that workers are often about to send a result: SIGTERM
    and SIGINT in turn, six times; within seconds no process is left, and in the end all is complete."""
    rng = np.random.default_rng(0)
    script = [Path(sys.executable).with_name("affmap"), *QUICK, *line(tmp_path)[len(LINE) :]]
    for turn in range(6):
        with (tmp_path / "output.txt").open("w") as output:
            process = subprocess.Popen(
                script,
                stdout=output,
                stderr=output,
                start_new_session=True,
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
            )
        deadline = time.monotonic() + 600
        while not list(tmp_path.glob("store/*/*")) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(rng.uniform(1, 6))
        number = (signal.SIGTERM, signal.SIGINT)[turn % 2]
        process.send_signal(number)
        # The last one while Python still imports.
        assert process.wait(60) in (0, 128 + number, -number), said(tmp_path)
        wait_for_workers(process.pid)
        if process.returncode == 0:
            shutil.rmtree(tmp_path / "store")
    assert subprocess.run(script, stdout=subprocess.DEVNULL, check=False).returncode == 0


def test_two_sweeps_at_once_make_everything_once(undisturbed: Path, tmp_path: Path) -> None:
    """Undisturbed sweep, byte by byte; the logs tell of one exploration, and of two trainings."""
    processes = [start(tmp_path) for _ in range(2)]
    assert [finish(process) for process in processes] == [0, 0], said(tmp_path)
    assert results(tmp_path) == results(undisturbed)
    assert said(tmp_path).count("exploration of original: 4 sequences") == 1
    assert said(tmp_path).count("training of 1 member,") == 2


def damaged(content: bytes, rng: np.random.Generator) -> Iterator[bytes | None]:
    """A file with a flipped bit, cut short, empty, and gone."""
    place = int(rng.integers(len(content)))
    yield content[:place] + bytes([content[place] ^ (1 << int(rng.integers(8)))]) + content[place + 1 :]
    yield content[:place]
    yield b""
    yield None


def test_every_damaged_file_of_a_finished_sweep_is_reported_with_a_remedy_that_helps(
    undisturbed: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tried: Callable[[str, int, str], None],
) -> None:
    """Each file in four ways: whoever asks for the results is told which it is; the command says so, too, and does
    nothing. What it advises helps: all is as it was."""
    folder = tmp_path / "sweep"
    shutil.copytree(undisturbed, folder)
    configs = Sweep.read(line(folder)).configs
    monkeypatch.setattr(sys, "argv", ["affmap", *line(folder)])
    rng = np.random.default_rng(0)
    count = 0
    for path in sorted(path for path in folder.glob("store/**/*") if path.is_file()):
        content = path.read_bytes()
        message = f"{path} .*; remove the folder {path.parent} .* and run the same command again"
        for harmed in damaged(content, rng):
            count += 1
            path.unlink() if harmed is None else path.write_bytes(harmed)
            if harmed is None and path.name == "provenance.json":
                assert not all(pipeline.find(config) for config in configs)
            else:
                with pytest.raises(StoreError, match=message):
                    [pipeline.find(config) for config in configs]
        path.write_bytes(content[:-2])
        with pytest.raises(SystemExit, match="1"):
            run.main()
        error = capsys.readouterr().err
        assert re.match(message, error) and "Traceback" not in error
        path.write_bytes(content)
    assert results(folder) == results(undisturbed)
    for stage in ("data", "train", "map", "control"):
        shutil.rmtree(next(folder.glob(f"store/{stage}/*")))
        assert finish(start(folder)) == 0, said(folder)
        assert results(folder) == results(undisturbed)
    tried("a damaged file of a finished sweep", count, "reported with a remedy that gives the same files")


@pytest.mark.parametrize("limit", [1, 700, 4_000, 20_000])
def test_a_disk_that_takes_no_more_costs_nothing(undisturbed: Path, tmp_path: Path, limit: int) -> None:
    """No file may be longer than so many bytes, as on a full disk: the sweep fails, and says so without a traceback on
    the terminal's error stream; with room again, the same command ends as an undisturbed sweep."""
    assert finish(start(tmp_path, limit=limit)) == 1
    assert "File too large" in said(tmp_path) or limit == 1  # when nothing can be said, either
    assert finish(start(tmp_path)) == 0, said(tmp_path)
    assert results(tmp_path) == results(undisturbed)


def test_a_full_disk_is_reported_and_costs_nothing(undisturbed: Path, tmp_path: Path) -> None:
    """A real one, of 100 KiB; then it grows."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(folder)], check=False)
    if mounted.returncode:
        pytest.skip("a file system of a given size can be mounted by the administrator only")
    try:
        assert finish(start(folder)) == 1
        assert "No space left on device" in said(folder) or "is full; make room" in said(folder)
        subprocess.run(["mount", "-o", "remount,size=50m", str(folder)], check=True)
        assert finish(start(folder)) == 0, said(folder)
        assert results(folder) == results(undisturbed)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def run_without_streams(folder: Path) -> None:
    """A sweep and its status in a process whose standard streams are closed, as those of a fresh interpreter."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        os.close(number)
        setattr(sys, name, None)
    sys.argv = ["affmap", *line(folder), "model.context_size=0"]
    run.main()
    sys.argv[0] = "affmap-status"
    show_status()
    assert [os.stat(number).st_rdev for number in range(3)] == 3 * [os.stat(os.devnull).st_rdev]
    assert all(os.get_inheritable(number) for number in range(3))
    sys.argv = ["affmap", "members=0"]
    try:
        run.main()
    except SystemExit as leaving:
        os._exit(40 + int(leaving.code or 0))


def test_closed_streams_stay_silent(tmp_path: Path) -> None:
    """`affmap <&- >&- 2>&-`: complete, and a mistake has its status."""
    process = CONTEXT.Process(target=run_without_streams, args=(tmp_path,))
    process.start()
    assert finish(process) == 42
    assert len(results(tmp_path)) == 2 + 4 + 2 + 1 + 3
