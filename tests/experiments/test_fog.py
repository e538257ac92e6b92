"""Experiment IX: verdicts on tables whose scores are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.experiments.exp9.claims import CLAIMS, DARK, LIT, MODEL, PAPER, STEPS
from affmap.results.files import Trajectories
from affmap.results.setting import LAYOUT
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 6, 20
GOOD = {(model, layout): (1.0, 0.05, -8.0) for model in ("gru", "gatel0rd") for layout in (LIT, DARK)}
BAD = {(PAPER, layout): (0.0, 1.0, -8.0) for layout in (LIT, DARK)}


def flights(error: float) -> Trajectories:
    """A run of each member, always in fog, whose belief is off by a length, a thousandth more for each member."""
    shape = MEMBERS, STEPS + 5
    plans = np.zeros((*shape, 1, 2))
    plans[..., 0] = error + 0.001 * np.arange(MEMBERS)[:, None, None]
    empty: Any = dict.fromkeys(
        ("goal", "planned_std", "action", "prediction_error", "touching", "reached"), np.empty(0)
    )
    place, inside = np.zeros((MEMBERS, STEPS + 6, 2)), np.ones(shape, bool)
    return Trajectories(
        position=place, planned_position=plans, in_fog=inside, member=np.arange(MEMBERS), run=np.zeros(MEMBERS), **empty
    )


def results(changes: Any = ()) -> Any:
    """Results of models with some share of arrivals, error of the belief (u), and loss outside fog (nats)."""
    scores = {**GOOD, **BAD, **dict(changes)}
    runs, steps, settings = [], [], []
    for (model, layout), (share, _, loss) in scores.items():
        settings.append(SimpleNamespace(values={MODEL.key: model, LAYOUT.key: layout}))
        runs += [
            {"planner": "cem", "layout": layout, MODEL.column: model, "context_size": 8, "member": member, "run": run}
            | {"reached": run < RUNS * share}
            for member in range(MEMBERS)
            for run in range(RUNS)
        ]
        rows = [("free", 90, loss), ("touching", 10, loss), ("inside", 50, 3.0)]
        steps += [
            {MODEL.column: model, "member": member, "epoch": epoch, "world": world, "kind": kind, "steps": number}
            | {"mean": mean + 0.001 * member + (epoch < 50)}
            for member in range(MEMBERS)
            for epoch in (10, 50)
            for world in (layout, "everywhere")
            for kind, number, mean in rows
        ]
    return SimpleNamespace(
        runs=pd.DataFrame(runs),
        steps=pd.DataFrame(steps),
        name=lambda value: value,
        where=lambda values: [each for each in settings if values.items() <= each.values.items()],
        trajectories=lambda setting: flights(scores[setting.values[MODEL.key], setting.values[LAYOUT.key]][1]),
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    found = verdicts(results())
    assert {name: len(parts) for name, parts in found.items()} == {
        "IX-1": 2, "IX-2": 1, "IX-3": 2, "IX-4": 2, "IX-5": 2, "IX-6": 2, "IX-7": 4, "IX-8": 4,
    }  # fmt: skip
    assert {name: {*parts} for name, parts in found.items()} == {name: {Verdict.HOLDS} for name in found}


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({("gru", LIT): (0.5, 0.05, -8.0)}, {"IX-1": [0]}),
        ({("gatel0rd", DARK): (0.5, 0.05, -8.0)}, {"IX-5": [1]}),
        ({(PAPER, LIT): (0.5, 1.0, -8.0)}, {"IX-2": [0]}),
        ({("gru", LIT): (1.0, 0.3, -8.0)}, {"IX-3": [0]}),
        ({("gru", DARK): (1.0, 0.3, -8.0)}, {"IX-6": [0]}),
        ({("gatel0rd", LIT): (1.0, 0.05, -7.8)}, {"IX-4": [1]}),
        ({(PAPER, DARK): (0.0, 0.01, -8.0)}, {"IX-7": [2, 3]}),
        ({("gru", LIT): (0.0, 0.05, -8.0), (PAPER, LIT): (0.05, 1.0, -8.0)}, {"IX-1": [0], "IX-8": [0]}),
    ],
)
def test_scores_on_the_wrong_side_fail_their_own_parts(changes: Any, failing: dict[str, list[int]]) -> None:
    for name, parts in verdicts(results(changes)).items():
        failed = [number for number, verdict in enumerate(parts) if verdict == Verdict.DOES_NOT_HOLD]
        assert failed == failing.get(name, []), name


def test_models_that_were_not_flown_are_not_tested() -> None:
    """A sweep of the perceptron alone, in one layout."""
    found = results()
    found.runs = found.runs[(found.runs[MODEL.column] == PAPER) & (found.runs["layout"] == LIT)]
    found.steps = found.steps.iloc[:0]
    found.where = lambda values: []
    expected = {name: Verdict.NOT_TESTED for name in verdicts(results()) if name != "IX-2"} | {"IX-2": Verdict.HOLDS}
    assert {name: parts[0] for name, parts in verdicts(found).items()} == expected
