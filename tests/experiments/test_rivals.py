"""The claims and the table of Experiment X, rivals, on runs whose distances are known by construction."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from affmap.experiments.exp10.claims import CLAIMS, CLONING, DISTILLED, LONG, OFFLINE, PPO, SAC
from affmap.experiments.exp10.figures import rivals
from affmap.experiments.exp10.pairs import AGENT, HOME, UNSEEN, paired, scores
from affmap.results.setting import ReportSettings
from affmap.results.statistics import Verdict

LAYOUTS = (HOME, *UNSEEN)
MEMBERS = {AGENT: 12, DISTILLED: 12, CLONING: 12, OFFLINE: 12, PPO: 10, SAC: 5, LONG: 5, "oracle": 12}
DISTANCES = {AGENT: 0.5, DISTILLED: 0.51, CLONING: 2.0, OFFLINE: 0.8, PPO: 1.6, SAC: 0.7, LONG: 0.9, "oracle": 0.4}


def results(*, without: tuple[str, ...] = (), **changes: float) -> Any:
    """Results with these mean distances, apart from a member's own part; a change is of a controller."""
    rng = np.random.default_rng(0)
    own = rng.normal(0, 0.1, 12)
    rows = [
        {"planner": name, "layout": layout, "context_size": 8, "member": member, "run": run, "reached": run < 3}
        | {"mean_distance": changes.get(name, DISTANCES[name]) + own[member] + rng.normal(0, 0.002)}
        for name, number in MEMBERS.items()
        if name not in without
        for layout in LAYOUTS
        for member in range(number)
        for run in range(4)
    ]
    runs = pd.DataFrame(rows)
    is_baseline = runs["planner"] == "oracle"
    settings = [SimpleNamespace(planner=name) for name in MEMBERS if name not in (*without, "oracle")]
    return SimpleNamespace(
        runs=runs[~is_baseline], baseline_runs=runs[is_baseline], settings=settings, layouts=list(LAYOUTS),
        baselines=[SimpleNamespace(planner="oracle")], names={AGENT: "agent"},
    )  # fmt: skip


def verdicts(found: Any) -> dict[str, list[Verdict]]:
    return {claim.name: [part.outcome.verdict for part in claim.test(found)] for claim in CLAIMS}


def test_claims_that_were_built_into_the_data_hold() -> None:
    """A part for each pair in each world; X-7 has two rivals."""
    found, two = verdicts(results()), {"X-6", "X-7", "X-9", "X-12", "X-13"}
    assert {name: len(parts) for name, parts in found.items()} == {
        name: 2 if name in two else 1 for name in (f"X-{number}" for number in range(5, 16))
    }
    assert {verdict for parts in found.values() for verdict in parts} == {Verdict.HOLDS}


@pytest.mark.parametrize(
    ("changes", "fails"),
    [
        ({DISTILLED: 0.54}, {"X-5", "X-6"}),
        ({CLONING: 0.4}, {"X-7", "X-14"}),
        ({PPO: 0.4}, {"X-7", "X-15"}),
        ({OFFLINE: 0.4}, {"X-11", "X-13"}),
        ({OFFLINE: 2.2}, {"X-14"}),
        ({SAC: 0.4}, {"X-10", "X-12"}),
        ({SAC: 1.8}, {"X-15"}),
        ({LONG: 0.45}, {"X-8", "X-9"}),
        ({LONG: 0.48}, {"X-9"}),
    ],
)
def test_a_rival_that_is_better_fails_its_own_claims(changes: dict[str, float], fails: set[str]) -> None:
    found = verdicts(results(**changes))
    assert {name for name, parts in found.items() if Verdict.DOES_NOT_HOLD in parts} == fails


def test_differences_are_of_the_members_that_both_have() -> None:
    """Five members of PPO with a million steps, beside the same five of the agent; a member's own part cancels."""
    found = results()
    pair = paired(found, LONG, AGENT, HOME, "mean_distance")
    assert len(pair.first) == len(pair.second) == 5
    np.testing.assert_allclose(pair.first - pair.second, 0.4, atol=0.01)
    assert len(scores(found, AGENT, HOME, "mean_distance")) == 12
    (part,) = next(claim for claim in CLAIMS if claim.name == "X-8").test(found)
    assert part.outcome.members == 5 and part.outcome.effect == pytest.approx(-0.4, abs=0.01)
    assert part.statement == "agent beside ppo million, original: the mean distance is at most 0.03 u longer."


def test_every_part_has_a_name_of_its_own() -> None:
    """That of the rival, and the layout."""
    names = [part.name for claim in CLAIMS for part in claim.test(results())]
    assert names[3:6] == ["ppo, original", "cloning, original", "ppo million, original"]
    assert all(
        len({part.name for part in parts}) == len(parts) for parts in (claim.test(results()) for claim in CLAIMS)
    )


def test_rivals_that_did_not_fly_leave_their_claims_untested() -> None:
    found = verdicts(results(without=(LONG,)))
    assert {name for name, parts in found.items() if {*parts} == {Verdict.NOT_TESTED}} == {"X-8", "X-9"}


def test_the_table_shows_every_controller_with_its_difference_and_its_members() -> None:
    """Rows: the agent, its rivals, the oracle; a difference with its interval for each but the agent."""
    settings = ReportSettings.load("report", "default", names={AGENT: "agent", LONG: "PPO 1M"})
    drawn = rivals.draw(results(), settings)
    assert drawn is not None
    axes = drawn.figure.axes
    assert [each.get_text() for each in axes[0].get_yticklabels()] == [
        "agent (12)", "distilled (12)", "cloning (12)", "td3 bc (12)", "ppo (10)", "sac (5)", "PPO 1M (5)",
        "oracle (12)",
    ]  # fmt: skip
    texts = [text.get_text() for text in axes[1].findobj(Text)]
    row = rivals.row(results(), LONG, UNSEEN[0])
    assert row.distance in texts and row.difference in texts and texts.count("75%") == 8
    assert row.difference.startswith("+0.40 [+0.") and rivals.row(results(), AGENT, HOME).difference == ""
    assert rivals.row(results(without=(LONG,)), LONG, HOME) == rivals.Row("–", "–", "–")
    assert rivals.draw(results(without=(AGENT,)), settings) is None
