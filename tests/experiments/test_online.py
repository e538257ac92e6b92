"""Experiment VIII: verdicts on tables whose scores are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.experiments.exp8 import claims as exp8
from affmap.experiments.exp8_fog import claims as exp8_fog
from affmap.experiments.online import OFFLINE, ONLINE, RANDOM, Online
from affmap.results.files import Experience
from affmap.results.setting import LEARNING
from affmap.results.statistics import Verdict

AGENTS, COMMITTEE, RUNS = 6, 2, 20
LOSSES = {OFFLINE: -9.0, RANDOM: -9.0, **dict.fromkeys(("deviation", "disagreement", "divergence"), -9.5)}
"""Kind of learning -> loss; a hundredth less for each agent."""

FOG = {RANDOM: 0.07, "deviation": 0.7, "disagreement": 0.05, "divergence": 0.01}
"""Kind of learning -> share of steps in fog."""


def results(reached: float = 1.0, losses: Any = (), fog: Any = ()) -> Any:
    """Results of agents that reach the goal in this share of the runs in the moved world, and else always."""
    losses, fog = {**LOSSES, **dict(losses)}, {**FOG, **dict(fog)}
    members = range(AGENTS * COMMITTEE)
    shares = {exp8.HOME: 1.0, exp8.MOVED: reached, exp8_fog.WORLD: reached}
    runs = [
        {"planner": "cem", "layout": layout, LEARNING.column: kind, "context_size": 8, "member": member, "run": run}
        | {"reached": run < RUNS * share, "success": run < RUNS * share, "mean_distance": 0.4 + 0.001 * member}
        for kind in losses
        for layout, share in shares.items()
        for member in members
        for run in range(RUNS)
    ]
    last = [
        {LEARNING.column: kind, "member": member, "validation_nll": loss - 0.01 * (member // COMMITTEE)}
        for kind, loss in losses.items()
        for member in members
    ]
    settings = [SimpleNamespace(values={LEARNING.key: kind}, train=(kind,)) for kind in losses]
    ones = np.ones((AGENTS, 3), np.float32)

    def experience(setting: Any) -> Experience | None:
        kind = setting.train[0]
        share = ones * fog.get(kind, 0) - 0.001 * np.arange(AGENTS)[:, None]
        return None if kind == OFFLINE else Experience(np.empty(0), np.empty(0), ones, share, np.arange(AGENTS))

    config = {"learning": {"committee": COMMITTEE}}
    return SimpleNamespace(
        settings=settings,
        runs=pd.DataFrame(runs),
        last_epoch=pd.DataFrame(last),
        where=lambda values: [each for each in settings if values[LEARNING.key] == each.train[0]],
        experience=experience,
        provenance={kind: {"config": {} if kind == OFFLINE else config} for kind in losses},
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    claims = (*exp8.CLAIMS, *exp8_fog.CLAIMS)
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in claims}


def test_claims_that_were_built_into_the_data_hold() -> None:
    found = verdicts(results())
    assert {name: len(parts) for name, parts in found.items()} == {
        "VIII-1": 4, "VIII-2": 4, "VIII-3": 3, "VIII-4": 4, "VIII-5": 2, "VIII-6": 1, "VIII-7": 2, "VIII-8": 2,
        "VIII-9": 4,
    }  # fmt: skip
    assert {name: {*parts} for name, parts in found.items()} == {name: {Verdict.HOLDS} for name in found}


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({"losses": {RANDOM: -8.5}}, {"VIII-1": [0]}),
        ({"losses": {"divergence": -8.5}}, {"VIII-1": [3], "VIII-3": [2], "VIII-7": [1], "VIII-8": [1]}),
        ({"losses": {OFFLINE: -9.8}}, {"VIII-1": [0, 1, 2, 3], "VIII-8": [0, 1]}),
        ({"reached": 0.9}, {"VIII-4": [0, 1, 2, 3], "VIII-9": [0, 1, 2, 3]}),
        ({"fog": {"disagreement": 0.2}}, {"VIII-5": [0]}),
        ({"fog": {"deviation": 0.3}}, {"VIII-6": [0]}),
    ],
)
def test_scores_on_the_wrong_side_fail_their_own_parts(changes: Any, failing: dict[str, list[int]]) -> None:
    for name, parts in verdicts(results(**changes)).items():
        failed = [number for number, verdict in enumerate(parts) if verdict == Verdict.DOES_NOT_HOLD]
        assert failed == failing.get(name, []), name


def test_an_agent_is_one_member_of_a_test() -> None:
    """Means of pairs by hand; six agents of two models."""
    online = Online(results())
    distances = online.scores(RANDOM, "mean_distance", exp8.HOME)
    np.testing.assert_allclose(distances, 0.4 + 0.001 * (2 * np.arange(6) + 0.5))
    outcomes = [part.outcome for claim in exp8.CLAIMS for part in claim.test(results())]
    assert {outcome.members for outcome in outcomes} == {AGENTS}
    assert all("2 models" in outcome.note for outcome in outcomes)


def test_kinds_that_did_not_learn_leave_their_claims_untested() -> None:
    found = results()
    found.runs, found.last_epoch = (
        table[table[LEARNING.column] == OFFLINE] for table in (found.runs, found.last_epoch)
    )
    found.where = lambda values: []
    assert all({*parts} == {Verdict.NOT_TESTED} for parts in verdicts(found).values())
    assert set(ONLINE) == {RANDOM, "deviation", "disagreement", "divergence"}
