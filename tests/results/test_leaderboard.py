"""Scores by hand, and the folder of an agent's runs."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from affmap.results import leaderboard, manifest
from affmap.results.leaderboard import scores
from affmap.results.metrics import stored_metrics
from affmap.settings import ConfigError
from affmap.store.provenance import PROVENANCE

STEPS = 100


def make_runs(**worlds: list[int | None]) -> pd.DataFrame:
    """Runs that reach the goal at a step, or never."""
    rows = [(world, run, step) for world, steps in worlds.items() for run, step in enumerate(steps)]
    table = pd.DataFrame(rows, columns=["world", "run", "steps_to_reach"])
    reached = table["steps_to_reach"].notna()
    filled = dict.fromkeys(stored_metrics(), 0) | {"mean_distance": table["run"] + 1.0, "reached": reached}
    filled |= {"success": reached, "steps_to_reach": table["steps_to_reach"].astype("Int64")}
    return table.assign(member=0, **filled)


ORACLE = make_runs(a=[20, 20], b=[40, 60])
RANDOM = make_runs(a=[None, None], b=[None, 100])


def test_a_score_is_the_share_of_steps_left_between_chance_and_oracle() -> None:
    """By hand: gains 0.5 and 0 of 0.8; gains 0.7 and 0.5 of 0.5, which is faster than the oracle."""
    table = scores(make_runs(a=[50, None], b=[30, 50]), ORACLE, RANDOM, STEPS)
    assert table.columns.tolist() == ["world", "success", "mean_distance", "score", "low", "high"]
    assert table["world"].tolist() == ["a", "b", leaderboard.MEAN]
    np.testing.assert_allclose(table["score"], [0.25 / 0.8, 0.6 / 0.5, (0.25 / 0.8 + 0.6 / 0.5) / 2])
    np.testing.assert_allclose(table["success"], [0.5, 1.0, 0.75])
    np.testing.assert_allclose(table["mean_distance"], [1.5, 1.5, 1.5])
    assert (table["low"] <= table["score"]).all() and (table["score"] <= table["high"]).all()


def test_the_oracle_has_one_and_chance_has_zero() -> None:
    """Exactly, in each world and on average, whatever the rounding."""
    oracle = make_runs(a=[21, 33, 47], b=[40, 60, 71], c=[7, 9, None])
    random = make_runs(a=[None, 97, None], b=[None, 100, 31], c=[None, None, None])
    assert scores(oracle, oracle, random, STEPS)["score"].eq(1).all()
    assert scores(random, oracle, random, STEPS)["score"].eq(0).all()


def test_a_run_through_fog_counts_as_one_that_never_arrives() -> None:
    """It reaches the goal, and is no success."""
    foggy = make_runs(a=[20, 20], b=[40, 60]).assign(success=False)
    table = scores(foggy, ORACLE, RANDOM, STEPS)
    assert table["score"].tolist()[:2] == [0, 0] and table["success"].eq(0).all()


def test_a_world_that_was_not_flown_in_is_empty_and_so_is_the_mean() -> None:
    table = scores(make_runs(a=[20, 20]), ORACLE, RANDOM, STEPS).set_index("world")
    assert table.loc["a", "score"] == 1 and table.loc[["b", leaderboard.MEAN]].isna().all(axis=None)


def test_a_world_in_which_the_oracle_is_no_better_than_chance_does_not_count() -> None:
    """It has no score, and the mean is that of the others."""
    stuck = make_runs(a=[20, 20], b=[None, 100])
    table = scores(make_runs(a=[50, None], b=[30, 50]), stuck, RANDOM, STEPS).set_index("world")
    assert table.loc["b", ["score", "low", "high"]].isna().all() and table.loc["b", "success"] == 1
    assert table.loc[leaderboard.MEAN, "score"] == table.loc["a", "score"] == 0.25 / 0.8
    assert table.loc[leaderboard.MEAN, "low"] == table.loc["a", "low"]


def test_the_interval_is_over_runs_and_narrower_with_more_of_them() -> None:
    """That of a mean of two values: half of them 0 and half of them 1, on the scale of the oracle."""
    few, many = (
        scores(
            make_runs(a=[20, None] * number),
            make_runs(a=[20] * (2 * number)),
            make_runs(a=[None] * (2 * number)),
            STEPS,
        ).loc[0]
        for number in (10, 50)
    )
    assert few["score"] == pytest.approx(0.5) and many["score"] == pytest.approx(0.5)
    # A binomial interval of 100 runs: 0.5 plus or minus 1.96 times 0.05.
    assert many["low"] == pytest.approx(0.4, abs=0.02) and many["high"] == pytest.approx(0.6, abs=0.02)
    assert few["high"] - few["low"] > 1.9 * (many["high"] - many["low"])


def test_runs_come_back_as_they_were_written(tmp_path: Path) -> None:
    """With the same scores; the file of the agent is beside them, and all of it in the manifest."""
    (tmp_path / "mine.py").write_text("x = 1\n")
    runs, record = make_runs(a=[50, None], b=[30, 50]), {"agent": "mine", "protocol": {"name": "p", "digest": "d"}}
    folder = tmp_path / "row"
    leaderboard.write(folder, runs.assign(start_x=0.1), record, [tmp_path / "mine.py"])
    found, read = leaderboard.read(folder)
    assert found["agent"] == "mine" and {*found["files"]} == {"mine.py", "runs.csv"}
    pd.testing.assert_frame_equal(scores(read, ORACLE, RANDOM, STEPS), scores(runs, ORACLE, RANDOM, STEPS))
    leaderboard.check_folder(folder)
    leaderboard.write(folder, make_runs(a=[20, 20]), record)
    assert {path.name for path in folder.iterdir()} == {"runs.csv", PROVENANCE}
    assert len(leaderboard.read(folder)[1]) == 2
    assert {path.name for path in tmp_path.iterdir()} == {"row", "mine.py"}


def test_damaged_runs_are_told(tmp_path: Path) -> None:
    folder = tmp_path / "row"
    with pytest.raises(ConfigError, match=r"row holds no report\. Restore it, or let affmap-score write it anew\.$"):
        leaderboard.read(folder)
    leaderboard.write(folder, make_runs(a=[50, None]), {"protocol": {}})
    (folder / "runs.csv").write_text("world\n")
    with pytest.raises(ConfigError, match=r"runs\.csv is not as it was written\. Restore it"):
        leaderboard.read(folder)


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    """Files of a user, another report, and a file in its place; a new or an empty folder serves as an earlier one."""
    leaderboard.check_folder(tmp_path / "new")
    leaderboard.check_folder(tmp_path)
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ConfigError, match=r"cannot hold the runs of an agent: .* Name another folder\.$"):
        leaderboard.check_folder(tmp_path)
    with pytest.raises(ConfigError, match=r"thesis\.tex is a file"):
        leaderboard.check_folder(tmp_path / "thesis.tex" / "row")
    (tmp_path / "thesis.tex").unlink()
    manifest.save(tmp_path, {"title": "another"}, {})
    with pytest.raises(ConfigError, match=r"holds other results\. Name another folder\.$"):
        leaderboard.check_folder(tmp_path)
    assert json.loads((tmp_path / PROVENANCE).read_text())["title"] == "another"
