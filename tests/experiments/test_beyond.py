"""The claims of Experiment VII: verdicts on tables whose shares are known by construction."""

from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from affmap.experiments.exp7.claims import CLAIMS, DEAD_ENDS, EASY, GREEDY, GUIDED, HARD
from affmap.results.statistics import Verdict

MEMBERS, RUNS = 8, 20
SHARES = {
    **{(agent, layout): 0.05 for agent in GREEDY for layout in DEAD_ENDS},
    **{(GUIDED, layout): 1.0 for layout in DEAD_ENDS},
    **{(agent, EASY): 0.9 for agent in (*GREEDY, GUIDED)},
    **{(agent, HARD): 0.6 for agent in GREEDY},
    (GUIDED, HARD): 0.8,
}
"""Share of successful runs of each agent in each layout."""


def results(**changes: float) -> Any:
    """Results with these runs and no recorded paths; a change, such as `trap=0.5`, is of the agent with the map."""
    shares = {pair: changes.get(pair[1], share) if pair[0] == GUIDED else share for pair, share in SHARES.items()}
    rows = [
        {"planner": "cem", "layout": layout, "lookahead": agent, "context_size": 8, "member": member, "run": run}
        | {"success": run < round(RUNS * share) + (member % 2 and 0 < share < 1)}
        for (agent, layout), share in shares.items()
        for member in range(MEMBERS)
        for run in range(RUNS)
    ]
    return SimpleNamespace(
        runs=pd.DataFrame(rows), where=lambda values: [], name=lambda value: value.removeprefix("procedural_")
    )


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    """Nine parts of three layouts and three horizons, three of three layouts twice, and one of two layouts each."""
    found = verdicts(results())
    assert {name: len(parts) for name, parts in found.items()} == {
        "VII-1": 9,
        "VII-2": 3,
        "VII-3": 3,
        "VII-4": 1,
        "VII-5": 1,
    }
    assert {verdict for parts in found.values() for verdict in parts} == {Verdict.HOLDS}


@pytest.mark.parametrize(
    ("changes", "claim", "part"),
    [
        ({"spiral": 0.9}, "VII-2", 2),
        ({"rooms": 0.0}, "VII-3", 1),
        ({EASY: 0.8}, "VII-4", 0),
        ({HARD: 0.4}, "VII-5", 0),
    ],
)
def test_a_share_that_is_too_low_fails_its_own_part(changes: dict[str, float], claim: str, part: int) -> None:
    assert verdicts(results(**changes))[claim][part] == Verdict.DOES_NOT_HOLD


def test_greedy_agents_that_arrive_are_not_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SHARES, (GREEDY[1], "rooms"), 0.5)
    parts = dict(zip([part.name for part in CLAIMS[0].test(results())], verdicts(results())["VII-1"], strict=True))
    assert {name for name, verdict in parts.items() if verdict != Verdict.HOLDS} == {"rooms, 40"}


def test_agents_that_did_not_fly_leave_their_claims_untested() -> None:
    found = results()
    found.runs = found.runs[found.runs["lookahead"] == GREEDY[0]]
    left = verdicts(found)
    assert left["VII-1"].count(Verdict.HOLDS) == 3
    assert {*left["VII-2"], *left["VII-3"], *left["VII-4"], *left["VII-5"]} == {Verdict.NOT_TESTED}


def test_readers_see_their_own_names_of_layouts() -> None:
    parts = {claim.name: claim.test(results())[0] for claim in CLAIMS}
    assert parts["VII-5"].name == "hard, 20"
    assert parts["VII-5"].statement == "hard: more runs succeed than with a horizon of 20 steps."
