"""The claims of Experiment VII about keys and doors: verdicts on shares and paths that are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.env.layout import Layout
from affmap.experiments.exp7.claims import GUIDED
from affmap.experiments.exp7_doors.claims import CLAIMS, GREEDY, opened_before_passing
from affmap.experiments.exp7_doors.figures.doors import caption
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 8, 4
LAYOUT = Layout.load("layout", "training_doors", name="doors")
KEY, DOOR, GOAL = [1.875, 1.0], [1.5, 0.5], [0.2, 0.2]


def path(*places: list[float]) -> np.ndarray:
    return np.array(places, float)


@pytest.mark.parametrize(
    ("places", "answer"),
    [
        ([[2.5, 1.0], KEY, DOOR, GOAL], True),
        ([[2.5, 1.0], DOOR, KEY, GOAL], False),
        ([[2.5, 1.0], DOOR, GOAL], False),
        ([[2.5, 1.0], KEY, [1.5, 1.0], GOAL], False),
        ([KEY, [1.5, 0.8], [1.5, 0.1]], True),
    ],
)
def test_a_key_comes_before_a_door(places: list[list[float]], answer: bool) -> None:
    """In order; too late; never; no door on the way; in a step that is longer than the door."""
    assert opened_before_passing(path(*places), LAYOUT) is answer


def results(greedy: float = 0.0, guided: float = 1.0, late: int = 0) -> Any:
    """Results with these shares of successful runs; so many runs with the map pass the door before they see the key."""
    shares = dict.fromkeys(GREEDY, greedy) | {GUIDED: guided}
    rows = [
        {"planner": "cem", "layout": "doors", "lookahead": agent, "context_size": 8, "member": member, "run": run}
        | {"success": run < RUNS * share, "steps_to_reach": 3.0}
        for agent, share in shares.items()
        for member in range(MEMBERS)
        for run in range(RUNS)
    ]
    number = MEMBERS * RUNS
    ways = [path([2.5, 1.0], DOOR, KEY, GOAL)] * late + [path([2.5, 1.0], KEY, DOOR, GOAL)] * (number - late)
    paths = SimpleNamespace(
        position=np.stack(ways),
        reached=np.arange(number)[:, None] % RUNS < RUNS * guided,
        goal=np.tile(GOAL, (number, 1)),
        member=np.repeat(np.arange(MEMBERS), RUNS),
    )
    return SimpleNamespace(
        name=str,
        runs=pd.DataFrame(rows),
        where=lambda values: ["the map"],
        trajectories=lambda setting: paths,
        run_layouts=lambda setting: [LAYOUT] * number,
        vehicle=lambda setting: SimpleNamespace(radius=0.06, top_speed=0.23),
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    holds = Verdict.HOLDS
    assert verdicts(results()) == {"VII-6": [holds, holds], "VII-7": [holds], "VII-8": [holds]}


@pytest.mark.parametrize(
    ("changes", "failing"),
    [({"greedy": 0.5}, "VII-6"), ({"guided": 0.75}, "VII-7"), ({"late": MEMBERS * RUNS}, "VII-8")],
)
def test_each_claim_can_fail(changes: dict[str, Any], failing: str) -> None:
    found = verdicts(results(**changes))
    assert {name for name, parts in found.items() if Verdict.HOLDS not in parts} == {failing}
    assert set(found[failing]) == {Verdict.DOES_NOT_HOLD}


def test_a_single_run_that_passes_a_closed_door_is_not_held_for_none() -> None:
    assert verdicts(results(late=1))["VII-8"] != [Verdict.HOLDS]


def test_nothing_flown_is_not_tested() -> None:
    found = results()
    found.runs, found.where = found.runs.iloc[:0], lambda values: []
    assert {verdict for parts in verdicts(found).values() for verdict in parts} == {Verdict.NOT_TESTED}


def test_the_figure_of_doors_says_only_the_way_that_it_shows() -> None:
    """A way to a key, one to none, and no way, as untrained members imagine it."""
    to_key, elsewhere, nowhere = caption(300, True, True), caption(300, True, False), caption(300, False, False)
    assert "mauve line) leads to a key" in to_key and "mauve line) leads to no key" in elsewhere
    assert "mauve" not in nowhere and "knows no way" in nowhere
