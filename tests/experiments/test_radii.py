"""Experiment VI with circles of several radii: verdicts on tables whose shares are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.env.layout import Layout
from affmap.experiments.composing import CROWDED, EASY, HARD
from affmap.experiments.exp6_radii.claims import CLAIMS, GIVEN, LEARNER, ONE_RADIUS, PAPER, SPLIT
from affmap.results.files import Deviations
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 8, 20
SHARES = {
    **{one: {EASY: 0.9, HARD: 0.6, CROWDED: 0.2} for one in ONE_RADIUS.values()},
    PAPER: {EASY: 0.9, HARD: 0.8, CROWDED: 0.5},
    **{model: {EASY: 1.0, HARD: 1.0, CROWDED: 0.8} for model in (SPLIT, GIVEN)},
}
"""Share of successful runs of each model in each layout."""

BOUNDS = {"oracle": {HARD: 1.0, CROWDED: 1.0}, "seen": {HARD: 1.0, CROWDED: 0.8}}
"""Likewise of agents that know the physics."""

NAMES = {PAPER: "MLP", ONE_RADIUS[PAPER]: "MLP, one"}
"""Model -> its name for readers, where it has another one."""

FOG = Layout.load("layout", "training_fog")
CIRCLE = FOG.circles[0]


def deviations(uncertain: float) -> Deviations:
    """Places 0.02 u outside fog, of which each member mistakes a share for fog; a hundredth less for each member."""
    std = np.full((MEMBERS, 100, 1, 2), 0.001)
    for member in range(MEMBERS):
        std[member, : round(100 * uncertain) - member] = 1.0
    x, y = np.array([CIRCLE.x]), np.full(100, CIRCLE.y + CIRCLE.radius + 0.02)
    return Deviations(std, x, y, np.arange(MEMBERS))


def results(halo: float = 0.2, **changes: dict[str, float]) -> Any:
    """Results with these runs; a change, such as `split={HARD: 0.5}`, is of an agent's shares."""
    rows = [
        {"planner": "cem", "layout": place, LEARNER.column: model, "context_size": 8, "member": member, "run": run}
        | {"prediction_error": -(12.0 if model in (SPLIT, GIVEN) else 10.0) - 0.01 * member}
        | {"success": run < round(RUNS * share) + (member % 2 and 0 < share < 1)}
        for model, shares in SHARES.items()
        for place, share in (shares | changes.get(model, {})).items()
        for member in range(MEMBERS)
        for run in range(RUNS)
    ]
    bounds = [
        {"planner": agent, "layout": place, "member": member, "success": run < round(RUNS * share)}
        for agent, shares in BOUNDS.items()
        for place, share in (shares | changes.get(agent, {})).items()
        for member in range(MEMBERS)
        for run in range(RUNS)
    ]
    losses = [
        {LEARNER.column: m, "member": member, "validation_nll": -10.0} for m in SHARES for member in range(MEMBERS)
    ]
    return SimpleNamespace(
        name=lambda value: NAMES.get(value, value),
        runs=pd.DataFrame(rows),
        baseline_runs=pd.DataFrame(bounds),
        last_epoch=pd.DataFrame(losses),
        where=lambda values: [values[LEARNER.key]],
        deviations=lambda setting: deviations(0.6 if setting in ONE_RADIUS.values() else halo),
        map_layout=lambda setting: FOG,
        vehicle_radius=lambda setting: 0.06,
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    found = verdicts(results())
    assert {name: len(parts) for name, parts in found.items()} == {
        "VI-10": 4, "VI-11": 2, "VI-12": 2, "VI-13": 2, "VI-14": 1, "VI-15": 4, "VI-16": 1, "VI-17": 1, "VI-18": 2,
        "VI-19": 1,
    }  # fmt: skip
    assert {name: {*parts} for name, parts in found.items()} == {name: {Verdict.HOLDS} for name in found}


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({PAPER: {HARD: 0.3}}, {"VI-10": [0]}),
        ({SPLIT: {CROWDED: 0.1}}, {"VI-10": [3], "VI-11": [1], "VI-15": [2]}),
        ({GIVEN: {CROWDED: 0.6}}, {"VI-12": [1]}),
        ({GIVEN: {HARD: 0.5}}, {"VI-12": [0], "VI-16": [0]}),
        ({SPLIT: {EASY: 0.4}}, {"VI-17": [0]}),
        ({"halo": 0.9}, {"VI-18": [0, 1]}),
    ],
)
def test_what_is_too_low_or_too_large_fails_its_own_parts(changes: Any, failing: dict[str, list[int]]) -> None:
    for name, parts in verdicts(results(**changes)).items():
        failed = [number for number, verdict in enumerate(parts) if verdict == Verdict.DOES_NOT_HOLD]
        assert failed == failing.get(name, []), name


def test_an_oracle_that_sees_as_much_is_no_worse() -> None:
    """The last claim, where no fields overlap unseen."""
    assert verdicts(results(seen={CROWDED: 1.0}))["VI-19"] != [Verdict.HOLDS]


def test_models_that_did_not_fly_leave_their_claims_untested() -> None:
    found = results()
    found.runs = found.runs[found.runs[LEARNER.column] == PAPER]
    found.baseline_runs = found.baseline_runs.iloc[:0]
    found.where = lambda values: []
    assert all({*parts} == {Verdict.NOT_TESTED} for name, parts in verdicts(found).items() if name != "VI-14")


def test_readers_see_their_own_names_of_models() -> None:
    """In names of parts, differences and statements."""
    parts = {claim.name: claim.test(results())[0] for claim in CLAIMS}
    assert (parts["VI-10"].name, parts["VI-10"].effect_of) == ("MLP, hard", "MLP minus MLP, one")
    assert (parts["VI-18"].name, parts["VI-18"].effect_of) == ("MLP", "MLP minus MLP, one")
    assert parts["VI-18"].statement == "The halo is smaller: MLP."
