"""A sweep that is killed, again and again, ends with the results of an undisturbed one."""

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sweeps import finish, results, said, start, undisturbed_sweep

NUM_KILLS = 100


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep that nothing happened to."""
    return undisturbed_sweep(tmp_path_factory.mktemp("undisturbed"))


def test_a_sweep_killed_at_a_hundred_random_moments_ends_with_the_same_results(
    undisturbed: Path, tmp_path: Path, tried: Callable[[str, int, str], None]
) -> None:
    """Undisturbed sweep, byte by byte; whenever a sweep is complete, a new one begins."""
    begin = time.monotonic()
    assert finish(start(tmp_path / "timed")) == 0
    seconds = time.monotonic() - begin
    rng = np.random.default_rng(0)
    kills, sweeps, folder = 0, 0, tmp_path / "0"
    where: Counter[str] = Counter()
    while kills < NUM_KILLS:
        process = start(folder)
        process.join(rng.uniform(0.2, 1.0) * seconds)
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
    assert len(where.keys() - {"between"}) > 1, "kills that hit one kind of stage say little"
    tried("SIGKILL at a random moment of a sweep", kills, "the files of an undisturbed sweep")
