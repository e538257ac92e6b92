"""A sweep that is killed, again and again, ends with the results of an undisturbed one."""

import os
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from sweeps import finish, results, said, start, undisturbed_sweep

NUM_KILLS = 40


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep that nothing happened to."""
    return undisturbed_sweep(tmp_path_factory.mktemp("undisturbed"))


def written(folder: Path) -> set[tuple[str, int]]:
    """What a sweep has written so far: files and folders of its store, each with its time."""
    found = set()
    for place, folders, files in os.walk(folder / "store"):
        for path in (os.path.join(place, name) for name in (*folders, *files)):
            with suppress(FileNotFoundError):  # renamed or removed meanwhile
                found.add((path, os.stat(path).st_mtime_ns))
    return found


def test_a_sweep_killed_at_forty_random_moments_ends_with_the_same_results(
    undisturbed: Path, tmp_path: Path, tried: Callable[[str, int, str], None]
) -> None:
    """Undisturbed sweep, byte by byte; whenever a sweep is complete, a new one begins.

    The clock is what the sweep writes, so that kills hit all of it however busy the machine is.
    """
    rng = np.random.default_rng(0)
    kills, sweeps, folder = 0, 0, tmp_path / "0"
    where: Counter[str] = Counter()
    while kills < NUM_KILLS:
        process, seen = start(folder), written(folder)
        goal = len(seen) + rng.integers(1, 25)
        while process.exitcode is None and len(seen) < goal:
            process.join(0.005)
            seen |= written(folder)
        process.join(rng.uniform(0, 0.05))
        if process.exitcode is None:
            process.kill()
            process.join()
            kills += 1
            where[next((path.parent.name for path in folder.glob("store/*/*.partial")), "between")] += 1
            continue
        assert process.exitcode == 0, said(folder)
        assert results(folder) == results(undisturbed)
        sweeps += 1
        folder = tmp_path / str(sweeps)
    assert finish(start(folder)) == 0, said(folder)
    assert results(folder) == results(undisturbed)
    print(f"{kills} kills ({dict(where)}) in {sweeps + 1} sweeps")
    assert len(where.keys() - {"between"}) > 2, "kills that hit few kinds of stages say little"
    tried("SIGKILL at a random moment of a sweep", kills, "the files of an undisturbed sweep")
