"""Experiment VIII with goals: verdicts on tables whose scores are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.config.sweep import Sweep
from affmap.experiments.exp8_goals import claims
from affmap.experiments.exp8_goals.claims import ALONE, CURIOUS, WEIGHT
from affmap.results.files import Experience
from affmap.results.statistics import Verdict

AGENTS, COMMITTEE, RUNS = 6, 2, 4
LOSSES = {0: -9.4, 10: -9.6, 100: -9.8}
"""Weight -> loss; a hundredth less for each agent."""

GOALS = {0: 20, 10: 19, 100: 5}
"""Weight -> goals per round; one more for every second agent."""


def results(losses: Any = (), goals: Any = (), distance: float = 0.4) -> Any:
    """Results of agents, in rounds of 1,000 steps."""
    losses, goals = {**LOSSES, **dict(losses)}, {**GOALS, **dict(goals)}
    members = range(AGENTS * COMMITTEE)
    rows = [{WEIGHT.column: weight, "member": member} for weight in losses for member in members]
    runs = [
        {**row, "planner": "cem", "layout": claims.WORLD, "context_size": 8, "run": run}
        | {"mean_distance": distance + 0.001 * row["member"]}
        for row in rows
        for run in range(RUNS)
    ]
    last = [{**row, "validation_nll": losses[row[WEIGHT.column]] - 0.01 * (row["member"] // COMMITTEE)} for row in rows]
    settings = [SimpleNamespace(values={WEIGHT.key: weight}, train=("folder",)) for weight in losses]

    def experience(setting: Any) -> Experience:
        counts, share = np.zeros((AGENTS, 3, 1, 1), int), np.zeros((AGENTS, 3), np.float32)
        reached = goals[setting.values[WEIGHT.key]] + np.arange(AGENTS)[:, None] % 2 + np.zeros((1, 3), int)
        return Experience(counts + 1000, np.ones((1, 1, 1), bool), share, share, np.arange(AGENTS), reached)

    return SimpleNamespace(
        settings=settings,
        runs=pd.DataFrame(runs),
        last_epoch=pd.DataFrame(last),
        where=lambda values: [each for each in settings if values == each.values],
        experience=experience,
        provenance={"folder": {"config": {"learning": {"committee": COMMITTEE}}}},
    )


def outcomes(found: Any) -> dict[str, Any]:
    """Outcomes by the numbers of their claims."""
    parts = {claim.name.removeprefix("VIII-"): claim.test(found) for claim in claims.CLAIMS}
    return {number: part.outcome for number, (part,) in parts.items()}


def test_claims_that_were_built_into_the_data_hold() -> None:
    """Effects by hand: levels are means over agents, who have half a goal more than the round number, on average."""
    found = outcomes(results())
    assert {number: outcome.verdict for number, outcome in found.items()} == dict.fromkeys(found, Verdict.HOLDS)
    assert [outcome.members for outcome in found.values()] == [AGENTS] * 6
    effects = [found[number].effect for number in ("46", "47", "48", "49", "50", "51")]
    np.testing.assert_allclose(effects, [-9.425, 0.4055, -0.4, -15, 19.5 - 0.9 * 20.5, -0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({"losses": {ALONE: -9.1}}, {"46"}),
        ({"distance": 0.5}, {"47"}),
        ({"losses": {CURIOUS: -9.2, 100: -9.1}}, {"48", "51"}),
        ({"goals": {CURIOUS: 25, 100: 30}}, {"49"}),
        ({"goals": {CURIOUS: 15}}, {"50"}),
    ],
)
def test_scores_on_the_wrong_side_fail_their_own_claims(changes: Any, failing: set[str]) -> None:
    found = outcomes(results(**changes))
    assert {number for number, outcome in found.items() if outcome.verdict == Verdict.DOES_NOT_HOLD} == failing


def test_claims_about_weights_that_did_not_learn_are_not_tested() -> None:
    found = results()
    found.runs, found.last_epoch, found.settings = found.runs.iloc[:0], found.last_epoch.iloc[:0], []
    found.where = lambda values: []
    assert {outcome.verdict for outcome in outcomes(found).values()} == {Verdict.NOT_TESTED}


def test_claims_tell_the_budget_of_the_configuration() -> None:
    """Steps by hand from the keys, and updates as many as those of Experiment VIII."""
    steps = {
        config.training.num_epochs * config.learning.round_steps
        for config in Sweep.read(["experiment=exp8_goals"]).configs
    }
    (those,) = steps
    assert f"after {those:,} steps" in claims.CLAIMS[0].statement
