"""Experiment VIII: verdicts on tables whose scores are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.config.sweep import Sweep
from affmap.experiments.exp8 import claims as exp8
from affmap.experiments.exp8_fog import claims as exp8_fog
from affmap.experiments.exp8_worlds import claims as exp8_worlds
from affmap.experiments.online import DEVIATION, DISAGREEMENT, INFORMATION, OFFLINE, RANDOM, Online
from affmap.learning.settings import OfflineLearning
from affmap.results.files import Experience
from affmap.results.setting import LEARNING
from affmap.results.statistics import Verdict

AGENTS, COMMITTEE, RUNS = 6, 2, 20
LOSSES = {OFFLINE: -9.0, RANDOM: -9.0, **dict.fromkeys((DEVIATION, DISAGREEMENT, INFORMATION), -9.5)}
"""Kind of learning -> loss; a hundredth less for each agent."""

FOG = {RANDOM: 0.07, DEVIATION: 0.2, DISAGREEMENT: 0.05, INFORMATION: 0.01}
"""Kind of learning -> share of steps in fog."""


def results(reached: float = 1.0, losses: Any = (), fog: Any = (), worse: str = "") -> Any:
    """Results of agents that reach the goal in this share of the runs in the moved world, and else always.

    In hard worlds offline models and random agents succeed in 80 % of the runs. One kind may stay 0.1 u farther away,
    and never succeed where others always do.
    """
    losses, fog = {**LOSSES, **dict(losses)}, {**FOG, **dict(fog)}
    members = range(AGENTS * COMMITTEE)
    always = (exp8.HOME, exp8_worlds.EASY, exp8_worlds.HARD)
    shares = {**dict.fromkeys(always, 1.0), exp8.MOVED: reached, exp8_fog.WORLD: reached}

    def chance(kind: str, layout: str) -> float:
        """Share of the runs that succeed, of those that arrive."""
        if kind == worse and layout in always:
            return 0.0
        return 0.8 if layout == exp8_worlds.HARD and kind in (OFFLINE, RANDOM) else 1.0

    runs = [
        {"planner": "cem", "layout": layout, LEARNING.column: kind, "context_size": 8, "member": member, "run": run}
        | {"reached": run < RUNS * share, "mean_distance": 0.4 + 0.001 * member + 0.1 * (kind == worse)}
        | {"success": run < RUNS * share * chance(kind, layout)}
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


def verdicts(found: Any) -> dict[str, Verdict]:
    """Verdicts by the numbers of their claims."""
    claims = (*exp8.CLAIMS, *exp8_fog.CLAIMS, *exp8_worlds.CLAIMS)
    return {claim.name.removeprefix("VIII-"): only(claim.test(found)).outcome.verdict for claim in claims}


def only(parts: Any) -> Any:
    (part,) = parts
    return part


def test_claims_that_were_built_into_the_data_hold() -> None:
    assert verdicts(results()) == {str(number): Verdict.HOLDS for number in (*range(10, 28), *range(35, 46))}


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({"losses": {RANDOM: -8.5}}, {"12", "37"}),
        ({"losses": {INFORMATION: -8.5}}, {"11", "16", "23", "25", "36", "39"}),
        ({"losses": {DISAGREEMENT: -8.5}}, {"10", "15", "22", "24", "35", "38"}),
        ({"losses": {OFFLINE: -9.8}}, {"10", "11", "12", "24", "25", "35", "36", "37"}),
        ({"reached": 0.9}, {"17", "18", "26", "27"}),
        ({"worse": INFORMATION}, {"14", "41", "43", "45"}),
        ({"worse": DISAGREEMENT}, {"13", "40", "42", "44"}),
        ({"fog": {DISAGREEMENT: 0.2}}, {"19"}),
        ({"fog": {INFORMATION: 0.2}}, {"20"}),
        ({"fog": {DEVIATION: 0.13}}, {"21"}),
    ],
)
def test_scores_on_the_wrong_side_fail_their_own_claims(changes: Any, failing: set[str]) -> None:
    found = verdicts(results(**changes))
    assert {name for name, verdict in found.items() if verdict == Verdict.DOES_NOT_HOLD} == failing


def test_an_agent_is_one_member_of_a_test() -> None:
    """Means of pairs by hand; six agents of two models."""
    online = Online(results())
    distances = online.scores(RANDOM, "mean_distance", exp8.HOME)
    np.testing.assert_allclose(distances, 0.4 + 0.001 * (2 * np.arange(6) + 0.5))
    outcomes = [only(claim.test(results())).outcome for claim in exp8.CLAIMS]
    assert {outcome.members for outcome in outcomes} == {AGENTS}
    assert all("2 models" in outcome.note for outcome in outcomes)


def test_kinds_that_did_not_learn_leave_their_claims_untested() -> None:
    found = results()
    found.runs, found.last_epoch = (
        table[table[LEARNING.column] == OFFLINE] for table in (found.runs, found.last_epoch)
    )
    found.where = lambda values: []
    assert {*verdicts(found).values()} == {Verdict.NOT_TESTED}


@pytest.mark.parametrize(("name", "room"), [("exp8", exp8), ("exp8_fog", exp8_fog), ("exp8_worlds", exp8_worlds)])
def test_claims_tell_the_budgets_of_the_configuration(name: str, room: Any) -> None:
    """Steps and updates, counted by hand from the keys; all models make as many updates."""
    configs = {config.learning.kind: config for config in Sweep.read([f"experiment={name}"]).configs}
    offline = configs.pop(OFFLINE)
    data, training = offline.data, offline.training
    sequences = len(offline.training_layouts) * (data.num_sequences - data.num_validation)
    updates = training.num_epochs * sequences // training.batch_size * (data.num_steps // training.chunk_length)
    for config in configs.values():
        assert not isinstance(config.learning, OfflineLearning)
        steps = config.training.num_epochs * config.learning.round_steps
        assert updates == config.training.num_epochs * config.learning.updates
        assert f"after {steps:,} steps" in room.AS_GOOD
    assert f"offline from {sequences * data.num_steps:,} with" in room.AS_GOOD
