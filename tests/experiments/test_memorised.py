"""Experiment IX, a memorised map: verdicts on tables whose scores are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.config.sweep import Sweep
from affmap.experiments.exp9_map.claims import (
    CLAIMS,
    EMPTY,
    EXPLORED,
    MEMORY,
    MOVED,
    OUTDATED,
    REPAIRED,
    STEPS,
    VIEWS,
    WORLDS,
    Memories,
)
from affmap.results.files import Recall
from affmap.results.setting import LAYOUT
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 6, 4
GOOD = {VIEWS: (0.5, 1.0), EXPLORED: (0.5, 1.0), OUTDATED: (0.8, 0.5), REPAIRED: (0.52, 1.0), EMPTY: (0.9, 1.0)}


def recall(left: float) -> Recall:
    """A run of each member; some of the first error, which grows with the member, is left after 50 steps."""
    errors = np.ones((MEMBERS, STEPS + 10)) * (1 + np.arange(MEMBERS))[:, None]
    errors[:, 1:] *= 0.9
    errors[:, STEPS] = left * errors[:, 0]
    empty: Any = dict.fromkeys(("true", "at_first", "at_last", "best", "x", "y"), np.empty(0))
    return Recall(error=errors, earlier=np.array(STEPS), member=np.arange(MEMBERS), **empty)


def results(changes: Any = (), left: float = 0.3) -> Any:
    """Results of memories with some mean distance (u) and share of arrivals in each layout."""
    scores = {(memory, layout): score for memory, score in GOOD.items() for layout in WORLDS} | dict(changes)
    settings = [SimpleNamespace(values={MEMORY.key: memory, LAYOUT.key: layout}) for memory, layout in scores]
    runs = [
        {"planner": "cem", "layout": layout, MEMORY.column: memory, "context_size": 8, "member": member, "run": run}
        | {"mean_distance": distance + 0.001 * member, "reached": run < RUNS * share}
        for (memory, layout), (distance, share) in scores.items()
        for member in range(MEMBERS)
        for run in range(RUNS)
    ]
    return SimpleNamespace(
        runs=pd.DataFrame(runs),
        name=lambda value: value,
        where=lambda values: [each for each in settings if values.items() <= each.values.items()],
        recall=lambda setting: recall(left),
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    found = verdicts(results())
    parts = {"IX-9": 4, "IX-10": 1, "IX-11": 1, "IX-12": 1, "IX-13": 1, "IX-14": 4}
    assert {name: len(each) for name, each in found.items()} == parts
    assert {verdict for each in found.values() for verdict in each} == {Verdict.HOLDS}


@pytest.mark.parametrize(
    ("changes", "left", "failing"),
    [
        ({(EXPLORED, "two_obstacles"): (0.6, 1.0)}, 0.3, {"IX-9": [1]}),
        ({(OUTDATED, MOVED): (0.4, 1.0)}, 0.3, {"IX-10": [0], "IX-12": [0]}),
        ({(OUTDATED, "original"): (0.4, 1.0)}, 0.3, {}),
        ({(REPAIRED, MOVED): (0.56, 1.0)}, 0.3, {"IX-11": [0]}),
        ({}, 0.6, {"IX-13": [0]}),
        ({(EMPTY, "original"): (0.5, 0.75)}, 0.3, {"IX-14": [0]}),
    ],
)
def test_scores_on_the_wrong_side_fail_their_own_parts(
    changes: Any, left: float, failing: dict[str, list[int]]
) -> None:
    for name, parts in verdicts(results(changes, left)).items():
        failed = [number for number, verdict in enumerate(parts) if verdict == Verdict.DOES_NOT_HOLD]
        assert failed == failing.get(name, []), name


def test_memories_that_were_not_flown_are_not_tested() -> None:
    found = results()
    found.runs = found.runs[found.runs[MEMORY.column] == VIEWS]
    found.where = lambda values: []
    assert {verdict for parts in verdicts(found).values() for verdict in parts} == {Verdict.NOT_TESTED}


def test_the_error_that_is_left_is_that_of_the_member_after_the_earlier_flight() -> None:
    np.testing.assert_allclose(Memories(results(left=0.3)).left(REPAIRED, MOVED), np.full(MEMBERS, 0.3))


def test_the_steps_of_the_claims_are_those_of_the_configuration() -> None:
    jobs = [job for job in Sweep.read(["experiment=exp9_map"]).configs if job.control_layout.name == MOVED]
    assert [job.memory.early_steps for job in jobs if job.memory.kind == "network"] == [0, 0, STEPS, 0]
