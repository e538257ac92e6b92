"""Evaluation protocols: the same runs for every agent, and a digest of all that they depend on."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import affmap
from affmap.control import Decision, Observation, Oracle, Protocol, RandomAgent, StraightAgent
from affmap.control.oracle import HalfOracle
from affmap.control.pretrained import reference
from affmap.results import leaderboard, metrics
from affmap.settings import ConfigError

CHANNELS = ("solid", "fog", "force_up", "force_down")
SMALL = {
    "name": "small",
    "worlds": ["original", "procedural_hard"],
    "planner": {"num_iterations": 2},
    "control": {"num_steps": 12, "runs_per_member": 4, "guide": "none"},
}


@pytest.fixture(scope="module")
def small() -> Protocol:
    """Two worlds of four runs."""
    return Protocol(**SMALL)


@pytest.fixture(scope="module")
def planner() -> affmap.CEMPlanner:
    return affmap.CEMPlanner(num_iterations=1, num_candidates=10, num_elites=3, horizon=3)


def places(runs: pd.DataFrame) -> pd.DataFrame:
    """World and number of each run, and where it begins and ends."""
    return runs[["world", *metrics.PLACES]].drop(columns="member")


def test_everybody_has_the_same_runs(small: Protocol, planner: affmap.CEMPlanner) -> None:
    """Whatever the number of members, with an oracle and a controller that learns nothing; members in equal parts."""
    one, two, four = (small.fly(affmap.load("exp5", members=range(members), planner=planner)) for members in (1, 2, 4))
    for other in (two, four, small.fly(small.oracle()), small.fly(StraightAgent())):
        pd.testing.assert_frame_equal(places(other), places(one), check_exact=True)
    assert one["member"].eq(0).all() and four["member"].tolist() == [0, 1, 2, 3] * 2
    assert two["member"].tolist() == [0, 0, 1, 1] * 2
    # A member flies its runs as it does alone: the first two of two members are those of one.
    pd.testing.assert_frame_equal(two[two["run"] < 2], one[one["run"] < 2], atol=1e-5)
    assert one.groupby("world")["start_x"].nunique().eq(4).all()


def test_a_random_controller_has_the_same_noise_whoever_flies_before(small: Protocol) -> None:
    """Run for run, with the generators of the run's number: against the controller on its own, run by run."""
    table = small.fly(RandomAgent())
    again = small.fly(RandomAgent())
    pd.testing.assert_frame_equal(table, again, check_exact=True)
    other = Protocol(**SMALL, seed=1001).fly(RandomAgent())
    assert (other["start_x"] != table["start_x"]).all()


class Recorded:
    """A controller that notes what it sees first in each world, and does nothing."""

    def __init__(self) -> None:
        self.views: list[torch.Tensor] = []

    def initial(self, num_problems: int) -> bool:
        return True

    def act(self, observation: Observation, state: bool, generators: Any) -> tuple[Decision, bool]:
        if state:
            self.views.append(observation.view)
        return Decision.without_prediction(torch.zeros(len(observation.view), 4)), False


def test_a_controller_sees_the_channels_of_the_protocol_in_every_world() -> None:
    """Though the file of `original` has one only."""
    eye = Recorded()
    Protocol(**SMALL).fly(eye)
    assert [view.shape for view in eye.views] == [(4, len(CHANNELS), 11, 11)] * 2
    assert eye.views[0][:, 0].any() and not eye.views[0][:, 1:].any()


def test_an_agent_flies_where_it_has_learned_to_see_all_that_is_painted(
    small: Protocol, planner: affmap.CEMPlanner
) -> None:
    """The agent of one channel in the world of obstacles, as in the same world of its own file; not in the other."""
    agent = affmap.load("exp1", planner=planner)
    table = small.fly(agent)
    assert table["world"].tolist() == ["original"] * 4
    half = HalfOracle(agent, [affmap.Layout.load("layout", "original")], affmap.Vehicle(), true_mean=True)
    assert small.fly(half)["world"].tolist() == ["original"] * 4
    alone = Protocol(**{**SMALL, "worlds": ["original"]}, channels=("solid",)).fly(agent)
    pd.testing.assert_frame_equal(alone, table, check_exact=True)


def test_the_digest_is_that_of_what_is_flown(own_conf: Path) -> None:
    """Another number in a layout, in the vehicle or in the settings of control is another one; a comment is not."""
    before = Protocol.load("protocol", "eight_worlds").digest
    assert before == Protocol().digest == PINNED

    def digest_with(file: str, old: str, new: str) -> str:
        path = own_conf / file
        text = path.read_text("utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), "utf-8")
        changed = Protocol.load("protocol", "eight_worlds").digest
        path.write_text(text, "utf-8")
        return changed

    assert digest_with("layout/trap.yaml", "# Experiment VII", "# Experiment 7") == before
    changed = {
        digest_with("layout/original.yaml", "radius: 0.2", "radius: 0.21"),
        digest_with("layout/trap.yaml", "shift: 0.1 ", "shift: 0.11 "),
        digest_with("vehicle/default.yaml", "mass: 0.1", "mass: 0.11"),
        digest_with("control/default.yaml", "beta: 1.0", "beta: 2.0"),
        digest_with("planner/cem.yaml", "horizon: 20", "horizon: 21"),
        digest_with("protocol/eight_worlds.yaml", "seed: 1000", "seed: 1001"),
        before,
    }
    assert len(changed) == 7


PINNED = "107b264ecd56825a"
"""Every published score has it: with another one, all of them must be flown anew."""


def test_the_oracle_knows_the_way_and_the_reference_its_digest() -> None:
    """The guided one; published runs are those of the protocol, of 100 runs in each of eight worlds."""
    protocol = Protocol()
    assert isinstance(protocol.oracle(), Oracle) and protocol.oracle().settings.guide == "time_to_go"
    assert (len(protocol.worlds), protocol.num_runs) == (8, 100)
    folders = [path for path in (reference() / "scores").iterdir() if path.is_dir()]
    assert {leaderboard.ORACLE, leaderboard.RANDOM} <= {path.name for path in folders}
    for folder in folders:
        record, runs = leaderboard.read(folder)
        assert record["protocol"] == {"name": protocol.name, "digest": protocol.digest}
        assert runs.groupby("world").size().eq(100).all()


def test_published_runs_are_those_that_are_flown_now() -> None:
    """The agent that acts at random, in its first world: all that is published of it."""
    protocol = Protocol()
    _, published = leaderboard.read(reference() / "scores" / leaderboard.RANDOM)
    first = Protocol(worlds=protocol.worlds[:1]).fly(RandomAgent())
    columns = ["world", "member", "run", *metrics.stored_metrics()]
    expected = published[published["world"] == "original"][columns]
    pd.testing.assert_frame_equal(first[columns], expected, check_dtype=False, rtol=1e-5)


class Blind:
    """No agent of this project: it is not asked for members."""

    def initial(self, num_problems: int) -> None:
        self.number = num_problems

    def act(self, observation: Observation, state: None, generators: Any) -> tuple[Decision, None]:
        assert len(observation.position) == self.number == len(generators)
        return Decision.without_prediction(torch.ones(self.number, 4)), None


def test_any_controller_flies_all_runs_and_its_vehicle_is_that_of_the_protocol(small: Protocol) -> None:
    runs = small.fly(Blind())
    assert len(runs) == 8 and (runs["member"] == 0).all()
    heavy = Protocol(**SMALL, vehicle={"mass": 0.2})
    assert heavy.vehicle.mass == 0.2 and np.isfinite(heavy.fly(Blind())["mean_distance"]).all()
    with pytest.warns(UserWarning, match=r"another vehicle, .* mass = 0\.2 instead of 0\.1"):
        heavy.fly(affmap.load("exp1"))


def test_a_mistake_is_told(small: Protocol) -> None:
    with pytest.raises(ConfigError, match=r"^the agent has 3 members, and the 4 runs in each world of 'small' cannot"):
        small.fly(affmap.load("exp1", members=range(3)))
    with pytest.raises(ConfigError, match=r"see the channels \['fog', 'border'\], and every world of 'small'"):
        small.fly(affmap.load("exp4"))
    for changes, told in (
        ({"worlds": ["original", "original"]}, r"worlds = .* is not allowed: it names 'original' twice; leave one"),
        ({"worlds": ["fog"]}, r"channel = 'border' is not one of channels"),
        ({"worlds": ["mars"]}, r"conf/layout/mars\.yaml does not exist"),
        ({"worlds": []}, r"worlds = "),
        ({"planner": "pid"}, r"conf/planner/pid\.yaml does not exist"),
        ({"control": {"num_steps": 0}}, r"control\.num_steps = 0 is not allowed"),
        ({"vehicle": "boat"}, r"conf/vehicle/boat\.yaml does not exist"),
    ):
        with pytest.raises(ConfigError, match=told):
            Protocol(**{**SMALL, **changes})
    with pytest.raises(ConfigError, match=r"^conf/protocol/nine\.yaml does not exist"):
        Protocol.load("protocol", "nine")
