"""Scores of agents that have flown: the ends of the scale, and runs that are published."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import affmap
from affmap.control import Protocol, RandomAgent, StraightAgent, scoring
from affmap.control.oracle import Oracle
from affmap.results import leaderboard
from affmap.settings import ConfigError

SMALL = Protocol(
    name="small",
    worlds=("original", "training_fog"),
    control={"num_steps": 50, "runs_per_member": 4, "guide": "none"},
)


def test_the_oracle_has_one_and_chance_has_zero() -> None:
    """Flown under a protocol of two worlds and four runs; an agent in a table of its own has the same rows."""
    agents = {"oracle": SMALL.oracle(), "random": RandomAgent(), "straight": StraightAgent()}
    table = affmap.score(agents, SMALL, progress=False)
    assert table.columns.tolist() == [
        *("agent", "protocol", "world", "success", "mean_distance"),
        *("score", "low", "high"),
    ]
    assert table["protocol"].eq(SMALL.digest).all()
    assert table["world"].tolist() == ["original", "training_fog", "mean"] * 3
    by_agent = table.set_index("agent")
    assert by_agent.loc["oracle", "score"].eq(1).all() and by_agent.loc["random", "score"].eq(0).all()
    straight = affmap.score(StraightAgent(), SMALL, progress=False)
    pd.testing.assert_frame_equal(straight, table[6:].reset_index(drop=True))
    assert straight.set_index("world").loc["training_fog", "score"] == 0  # right through fog


def test_published_runs_serve_under_their_own_protocol_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else oracle and random agent fly anew; damaged ones are told."""
    published = {name: SMALL.fly(RandomAgent()).assign(mean_distance=7.0) for name in ("oracle", "random")}
    monkeypatch.setattr(scoring, "reference", lambda: tmp_path)
    for name, runs in published.items():
        record = {"protocol": {"name": "small", "digest": SMALL.digest}}
        leaderboard.write(tmp_path / "scores" / name, runs, record)
    assert all(runs["mean_distance"].eq(7).all() for runs in scoring.references(SMALL))
    other = SMALL.model_copy(update={"seed": 5})
    oracle, random = scoring.references(other, progress=False)
    assert oracle["success"].mean() == 1 and random["mean_distance"].gt(1).all() and random["mean_distance"].ne(7).all()
    (tmp_path / "scores/oracle/runs.csv").write_text("")
    with pytest.raises(ConfigError, match=r"runs\.csv is not as it was written"):
        scoring.references(SMALL)


def test_agents_of_the_configuration_are_ready_to_fly() -> None:
    """Those of files of `conf/agent` that need no model."""
    assert scoring.configured("straight", SMALL) == StraightAgent()
    for name in ("oracle", "seen"):
        agent = scoring.configured(name, SMALL)
        assert isinstance(agent, Oracle) and agent.settings == SMALL.control
    assert ", as seen)" in repr(scoring.configured("seen", SMALL))
    for name in ("planner", "true_mean"):
        with pytest.raises(ConfigError, match=rf"^agent = '{name}' needs a model; name an experiment, such as exp5\.$"):
            scoring.configured(name, SMALL)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("exp1",), r"^agents = 'exp1' is not allowed; give an agent, such as affmap\.load\('exp1'\), or several"),
        (({"mine": 3},), r"^agent = 3 is not allowed; give an agent"),
        (({},), r"^score needs an agent, as in affmap\.score\(agent\)\.$"),
        ((StraightAgent(), "nine"), r"^conf/protocol/nine\.yaml does not exist; conf/protocol holds: eight_worlds\.$"),
        ((StraightAgent(), 8), r"^protocol = 8 is not allowed; give the name of a file in conf/protocol\.$"),
    ],
)
def test_a_mistake_is_told(arguments: tuple[Any, ...], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        affmap.score(*arguments)
