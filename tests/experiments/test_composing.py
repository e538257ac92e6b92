"""Experiment VI: verdicts on tables whose shares are known by construction, and steps where properties overlap."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.env.layout import Circle, Layout
from affmap.experiments.composing import CROWDED, EASY, HARD
from affmap.experiments.exp6.claims import ADDITIVE, CLAIMS, GIVEN, HYPER, MODEL, PAPER, SPLIT
from affmap.experiments.exp6.overlap import error_by_properties, num_properties
from affmap.results.files import Trajectories
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 8, 20
SHARES = {
    PAPER: {EASY: 0.8, HARD: 0.6, CROWDED: 0.3},
    HYPER: {EASY: 0.9, HARD: 0.8, CROWDED: 0.4},
    ADDITIVE: {EASY: 0.9, HARD: 0.8, CROWDED: 0.4},
    SPLIT: {EASY: 1.0, HARD: 1.0, CROWDED: 0.8},
    GIVEN: {EASY: 1.0, HARD: 1.0, CROWDED: 0.8},
}
"""Share of successful runs of each model in each layout; the oracle has 1.0 and, in crowded worlds, 0.8."""

ERRORS = {SPLIT: -12.0, GIVEN: -12.0}
"""Prediction error of each run, nats; else -10."""


NAMES = {PAPER: "MLP", GIVEN: "given"}
"""Model -> its name for readers, where it has another one."""


def layout(*circles: tuple[float, float, str]) -> Layout:
    """Circles of 0.3 u, by their centre and effect, in the channels of Experiment V."""
    channels = {"obstacle": "solid"}
    made = [
        Circle(center=(x, y), radius=0.3, effect=effect, channel=channels.get(effect, effect))
        for x, y, effect in circles
    ]
    return Layout.load("layout", "four_properties", circles=made)


WORLD = layout((1.0, 1.0, "fog"), (1.2, 1.0, "force_up"), (2.0, 1.0, "obstacle"), (1.2, 1.0, "force_up"))
RADIUS = 0.06


def test_properties_are_counted_once_each_and_obstacles_from_where_they_matter() -> None:
    """By hand: fog alone, fog and a pull, a pull twice, nothing, and up to 0.1 u from an obstacle."""
    places = np.array([[0.8, 1.0], [1.1, 1.0], [1.45, 1.0], [0.3, 0.3], [2.0, 1.45], [2.0, 1.47]])
    assert num_properties(places, WORLD, RADIUS).tolist() == [1, 2, 1, 0, 1, 0]


def paths(errors: dict[int, float]) -> Trajectories:
    """A run of each of two members with four steps, of which two begin in one property and one in two of them."""
    position = np.tile([[0.3, 0.3], [0.8, 1.0], [1.1, 1.0], [1.45, 1.0], [0.3, 0.3]], (2, 1, 1))
    error = np.array([[0.0, 1.0, errors[0], 3.0], [9.0, 1.0, errors[1], 1.0]])
    empty = np.zeros((2, 4), bool)
    return Trajectories(
        position, np.zeros((2, 2)), np.zeros((2, 4, 1, 2)), np.zeros((2, 4, 1, 2)), np.zeros((2, 4, 4)), error,
        empty, empty, empty, np.array([200, 201]), np.array([0, 0]),
    )  # fmt: skip


def results(errors: dict[int, float] | None = None, **changes: dict[str, float]) -> Any:
    """Results with these runs; a change, such as `split={HARD: 0.5}`, is of a model's shares."""
    rows, losses = [], []
    for model, shares in SHARES.items():
        for place, share in (shares | changes.get(model, {})).items():
            rows += [
                {"planner": "cem", "layout": place, MODEL.column: model, "context_size": 8, "member": member}
                | {"run": run, "prediction_error": ERRORS.get(model, -10.0) - 0.01 * member}
                | {"success": run < round(RUNS * share) + (member % 2 and 0 < share < 1)}
                for member in range(MEMBERS)
                for run in range(RUNS)
            ]
        losses += [{MODEL.column: model, "member": member, "validation_nll": -10.0} for member in range(MEMBERS)]
    oracle = [
        {"planner": "oracle", "layout": place, "member": 200, "success": run < 10 * share}
        for place, share in {EASY: 1.0, HARD: 1.0, CROWDED: 0.8}.items()
        for run in range(10)
    ]
    by_model = {SPLIT: paths(errors or {0: 2.0, 1: 2.0}), PAPER: paths({0: 50.0, 1: 70.0})}
    return SimpleNamespace(
        name=lambda value: NAMES.get(value, value),
        runs=pd.DataFrame(rows),
        baseline_runs=pd.DataFrame(oracle),
        last_epoch=pd.DataFrame(losses),
        where=lambda values: [values[MODEL.key]],
        trajectories=lambda setting: by_model[setting],
        run_layouts=lambda setting: [WORLD],
        vehicle_radius=lambda setting: RADIUS,
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_errors_are_those_of_steps_that_begin_where_one_or_several_properties_act() -> None:
    """Means by hand; steps that begin where nothing acts count for neither."""
    table = error_by_properties(results({0: 2.0, 1: 5.0}), SPLIT)  # type: ignore[arg-type]
    assert table.loc[200].to_dict() == {"one": 2.0, "several": 2.0}
    assert table.loc[201].to_dict() == {"one": 1.0, "several": 5.0}


def test_claims_that_were_built_into_the_data_hold() -> None:
    """All but VI-5, whose two members are too few."""
    found = verdicts(results())
    assert found.pop("VI-5") == [Verdict.NOT_DECIDED]
    assert {name: {*parts} for name, parts in found.items()} == {name: {Verdict.HOLDS} for name in found}
    notes = [part.outcome.note for part in CLAIMS[0].test(results())]
    assert (
        notes[0] == "1.00 of the way from MLP to the oracle (composition index)" and "composition index" not in notes[1]
    )


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({SPLIT: {HARD: 0.5}}, {"VI-1": [0], "VI-2": [0], "VI-7": [0], "VI-8": [0], "VI-9": [0]}),
        ({SPLIT: {CROWDED: 0.2}}, {"VI-1": [2], "VI-2": [1], "VI-8": [2], "VI-9": [2]}),
        ({SPLIT: {EASY: 0.4}}, {"VI-6": [0]}),
        ({GIVEN: {HARD: 0.5}}, {"VI-7": [0]}),
    ],
)
def test_a_share_that_is_too_low_fails_its_own_parts(
    changes: dict[str, dict[str, float]], failing: dict[str, list[int]]
) -> None:
    found = verdicts(results(**changes))
    for name, parts in found.items():
        failed = [number for number, verdict in enumerate(parts) if verdict == Verdict.DOES_NOT_HOLD]
        assert failed == failing.get(name, []), name


def test_readers_see_their_own_names_of_models() -> None:
    """Of a model that has another one, in differences, statements and notes."""
    parts = {claim.name: claim.test(results())[0] for claim in CLAIMS}
    assert parts["VI-1"].effect_of == "split minus MLP" and parts["VI-7"].effect_of == "split minus given"
    assert parts["VI-1"].statement == "In hard worlds more runs succeed with split than with MLP."
    assert parts["VI-5"].effect_of == "cost with split minus cost with MLP" and "MLP: " in parts["VI-4"].outcome.note


def test_a_member_with_a_high_validation_loss_is_an_outlier() -> None:
    found = results()
    losses = found.last_epoch
    losses.loc[(losses[MODEL.column] == SPLIT) & (losses["member"] == 3), "validation_nll"] = 50.0
    (part,) = CLAIMS[3].test(found)
    assert part.outcome.verdict != Verdict.HOLDS and part.outcome.effect == 1 - 1 / MEMBERS
    assert "to 50.00 nats" in part.outcome.note


def test_models_that_did_not_fly_leave_their_claims_untested() -> None:
    found = results()
    found.runs = found.runs[found.runs[MODEL.column] == PAPER]
    found.baseline_runs = found.baseline_runs.iloc[:0]
    left = verdicts(found)
    for name in ("VI-1", "VI-2", "VI-3", "VI-6", "VI-7", "VI-8", "VI-9"):
        assert {*left[name]} == {Verdict.NOT_TESTED}, name
