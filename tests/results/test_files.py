"""Files of stages: every writer's file is what its reader gives back."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from stage_files import load_world, make_world

from affmap.control.episodes import summarise
from affmap.results import files
from affmap.results.files import Maps, Trajectories
from affmap.results.metrics import METRICS, PLACES, run_metrics, stored_metrics


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def paths(rng: np.random.Generator, num_runs: int = 3, num_steps: int = 5, horizon: int = 4) -> Trajectories:
    flags = rng.random((3, num_runs, num_steps)) < 0.5
    return Trajectories(
        position=rng.random((num_runs, num_steps + 1, 2)),
        goal=rng.random((num_runs, 2)),
        planned_position=rng.random((num_runs, num_steps, horizon, 2)),
        planned_std=rng.random((num_runs, num_steps, horizon, 2)),
        action=rng.random((num_runs, num_steps, 4)),
        prediction_error=rng.random((num_runs, num_steps)),
        touching=flags[0],
        in_fog=flags[1],
        reached=flags[2],
        member=np.arange(num_runs),
        run=np.zeros(num_runs, int),
    )


def test_exploration_comes_back(tmp_path: Path, rng: np.random.Generator) -> None:
    """Two layouts, stacked."""
    parts = [{"counts": rng.integers(0, 9, (2, 3)), "free": rng.random((2, 3)) < 0.5, "coverage": np.array(0.5)}] * 2
    written = files.write_coverage(tmp_path, parts)
    for actual, expected in zip(files.read_coverage(tmp_path), written, strict=True):
        np.testing.assert_array_equal(actual, expected)
    assert written.counts.shape == (2, 2, 3) and written.coverage.tolist() == [0.5, 0.5]


def test_experience_of_several_stages_comes_back_as_one(tmp_path: Path, rng: np.random.Generator) -> None:
    """Agents in the order of the stages; coverage by hand: three of four free cells, of two layouts in turn."""
    counts = np.zeros((2, 3, 1, 3), int)
    counts[0, 0, 0, 0] = counts[0, 2, 0, 0] = 5  # round 2 is in the first layout, too
    counts[0, 1, 0] = [0, 3, 2]
    counts[1, :, 0, 2] = 5  # not free in the first layout
    free = np.array([[[True, True, False]], [[False, True, True]]])
    shares = rng.random((2, 2, 3))
    for agent in range(2):
        own = files.Experience(counts[[agent]], free, *shares[:, [agent]], np.array([5 * agent]))
        (tmp_path / str(agent)).mkdir()
        files.write_experience(tmp_path / str(agent), own)
    both = files.read_experience([tmp_path / "0", tmp_path / "1"])
    np.testing.assert_array_equal(both.counts, counts)
    np.testing.assert_array_equal(both.in_fog, shares[1])
    assert both.agent.tolist() == [0, 5] and both.steps.tolist() == [5, 10, 15]
    np.testing.assert_array_equal(both.coverage, [[0.25, 0.75, 0.75], [0.0, 0.25, 0.25]])


def test_losses_come_back(tmp_path: Path) -> None:
    """To six decimals."""
    table = pd.DataFrame(
        {"member": [0, 1], "epoch": [1, 1], "training_nll": [1.5, -2.25], "validation_nll": [0.0, 3e-6]}
    )
    files.write_validation(tmp_path, table)
    pd.testing.assert_frame_equal(files.read_validation(tmp_path), table)


def test_maps_of_several_stages_come_back_as_one(tmp_path: Path, rng: np.random.Generator) -> None:
    """Members one after the other; the snapshots' members are on their second axis."""
    x, y = np.arange(3.0), np.arange(2.0)
    whole = Maps(*(rng.random((*n, 4, 2, 3, 1)) for n in ((), (), (2,))), np.array([1, 2]), x, y, np.arange(4))
    for name, part in (("a", slice(0, 1)), ("b", slice(1, 4))):
        (tmp_path / name).mkdir()
        parts = whole._replace(
            codes=whole.codes[part],
            initial_codes=whole.initial_codes[part],
            snapshot_codes=whole.snapshot_codes[:, part],
            member=whole.member[part],
        )
        files.write_maps(tmp_path / name, parts)
    for actual, expected in zip(files.read_maps([tmp_path / "a", tmp_path / "b"]), whole, strict=True):
        np.testing.assert_array_equal(actual, expected)


def test_trajectories_come_back(tmp_path: Path, rng: np.random.Generator) -> None:
    written = paths(rng)
    files.write_trajectories(tmp_path, written._asdict())
    for actual, expected in zip(files.read_trajectories([tmp_path]), written, strict=True):
        np.testing.assert_array_equal(actual, expected)


def test_runs_come_back_with_the_columns_in_their_order(tmp_path: Path, rng: np.random.Generator) -> None:
    """Setting, places, metrics, world; every stored metric is among them."""
    table = summarise(paths(rng)._asdict())
    setting = {"layout": "original", "planner": "cem", "lookup_spacing": 0.02, "context_size": 8}
    files.write_runs(tmp_path, setting, table, [[True, False, True], np.zeros(3)])
    actual = files.read_runs(tmp_path, ["member"])
    assert list(actual) == [*setting, *PLACES, *stored_metrics(), *files.LAYOUT_COLUMNS]
    assert actual["mean_distance"].to_numpy() == pytest.approx(table["mean_distance"].to_numpy(), abs=1e-6)
    assert run_metrics()[: len(stored_metrics())] == stored_metrics() and set(run_metrics()) < set(METRICS)


def test_layouts_come_back(tmp_path: Path) -> None:
    """Equal ones are one object: a hundred runs share theirs."""
    written = [load_world("fog"), make_world((1.0, 1.0, 0.2, "none")), load_world("fog")]
    files.write_layouts(tmp_path, written)
    actual = files.read_layouts(tmp_path)
    assert actual == written and actual[0] is actual[2]
