"""The table of an evaluation: row by row against flights, and random worlds against a stage of control's."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from commands import jobs

import affmap
from affmap.control.agent import Agent
from affmap.control.oracle import HalfOracle, Oracle
from affmap.control.random import RandomAgent
from affmap.pipeline.control import make_runs
from affmap.pipeline.stage import TRAIN
from affmap.results import files, metrics
from affmap.settings import ConfigError
from affmap.store.attempt import Attempt

RANDOM = RandomAgent(kind="random")
LAYOUTS = ["original", affmap.Layout.load("layout", "two_obstacles")]


@pytest.fixture(scope="module")
def agents() -> dict[str, Agent]:
    """Of two members without a context, and of another one with one."""
    return {
        "blind": affmap.load("exp1", context_size=0, members=(0, 3)),
        "seeing": affmap.load("exp1", context_size=1, members=(5,)),
    }


def test_a_row_is_a_run_of_a_flight(agents: dict[str, Agent]) -> None:
    """Agents, then layouts, then member-major runs, each as `fly` has it."""
    table = affmap.evaluate({**agents, "random": RANDOM}, LAYOUTS, runs=2, steps=3)
    rest = table.set_index(["agent", "context_size", "layout"])
    expected = [
        (name, size, layout, affmap.fly(agent, layout, runs=2, steps=3).table)
        for name, size, agent in (
            ("blind", 0, agents["blind"]),
            ("seeing", 1, agents["seeing"]),
            ("random", None, RANDOM),
        )
        for layout in ("original", "two_obstacles")
    ]
    for (name, size, layout, flown), (_, rows) in zip(expected, rest.groupby(level=[0, 2], sort=False), strict=True):
        assert {*rows.index} == {(name, pd.NA if size is None else size, layout)}
        pd.testing.assert_frame_equal(rows.reset_index(drop=True), flown, check_exact=True)
    assert list(table.columns) == ["agent", "context_size", "layout", *metrics.PLACES, *metrics.run_metrics()]
    assert len(table) == (2 + 1 + 1) * 2 * 2


def test_a_registered_metric_is_in_the_tables_of_flights_and_evaluations(
    agents: dict[str, Agent], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last column of both, by the function itself; also of runs that were flown before."""
    earlier = affmap.fly(agents["blind"], "original", runs=2, steps=3)

    def effort(paths: files.Trajectories) -> Any:
        return paths.action.sum(axis=2).mean(axis=1)

    monkeypatch.setitem(metrics.METRICS, "effort", metrics.Metric("effort", "throttles", "open throttles", effort))
    flown = affmap.fly(agents["blind"], "original", runs=2, steps=3)
    expected = flown.trajectories["action"].sum(axis=2).mean(axis=1).tolist()
    for table in (flown.table, earlier.table, affmap.evaluate(agents["blind"], "original", runs=2, steps=3)):
        assert table.columns[-1] == "effort" and table["effort"].tolist() == expected


def test_one_agent_and_one_layout_need_no_names(agents: dict[str, Agent]) -> None:
    """An agent has the name of its planner, another controller its own; an oracle's context size is its model's."""
    table = affmap.evaluate(agents["seeing"], "original", runs=1, steps=1)
    assert table[["agent", "context_size", "layout", "member"]].to_numpy().tolist() == [["cem", 1, "original", 5]]
    layout, vehicle = affmap.Layout.load("layout", "original"), affmap.Vehicle.load("vehicle", "default")
    half = HalfOracle(agents["seeing"], [layout], vehicle, true_mean=True)
    table = affmap.evaluate({"half": half}, layout.plain, runs=1, steps=1)
    assert table[["agent", "context_size"]].to_numpy().tolist() == [["half", 1]]
    assert affmap.evaluate(RANDOM, "original", runs=1, steps=1)["agent"].tolist() == ["random"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Agent, Path]:
    """A toy agent of two members, and the folder of its store."""
    folder = tmp_path_factory.mktemp("trained")
    agent = affmap.train(
        "four_properties",
        context_size=1,
        members=2,
        epochs=2,
        data={"num_sequences": 4, "num_validation": 1, "num_steps": 20},
        lookup={"spacing": 0.25},
        planner={"num_iterations": 3},
        folder=folder / "store",
        progress=False,
    )
    return agent, folder


SAME = [*metrics.PLACES, *metrics.stored_metrics()]
"""Columns of the stage of control that evaluations have, too."""


def swept(folder: Path, output: Path, *settings: str) -> pd.DataFrame:
    """The runs that the stage of control writes in a sweep with the toy agent."""
    (config,) = jobs(folder, "world=four_properties", "model.context_size=1", "control.runs_per_member=3", *settings)
    attempt = Attempt.begin(output)
    make_runs(config, folder / "store" / "train" / TRAIN.of(config).digest, None, attempt)
    return files.read_runs(attempt.folder, SAME)[SAME]


def test_random_worlds_are_those_of_a_sweep(trained: tuple[Agent, Path], tmp_path: Path) -> None:
    """Every run of every member in a world of its own: all that the stage of control writes of them."""
    agent, folder = trained
    written = swept(folder, tmp_path / "control", "control_layout=procedural_easy")
    rules = affmap.Procedural.load("layout", "procedural_easy")
    table = affmap.evaluate(agent, rules, runs=3, steps=3)
    pd.testing.assert_frame_equal(table[SAME], written.astype(table[SAME].dtypes), atol=1e-5)
    other = affmap.evaluate(agent, rules, runs=3, steps=3, seed=1)
    assert (other["goal_x"] != table["goal_x"]).all() and len(other) == 6


@pytest.mark.parametrize("variation", ["mass/0.4", "size/1.2", "noise/0.1", "goal/0.5", "step/16.7", "home"])
@pytest.mark.parametrize("kind", ["planner", "oracle"])
def test_variations_are_those_of_a_sweep(
    kind: str, variation: str, trained: tuple[Agent, Path], tmp_path: Path
) -> None:
    """An agent of two members, which is not told, and an oracle of one, which is; in one world, and in random ones."""
    agent, folder = trained
    layout = "procedural_easy" if variation == "size/1.2" else "four_properties"
    written = swept(folder, tmp_path / "control", f"control_layout={layout}", f"variation={variation}", f"agent={kind}")
    flying: Agent | Oracle = agent
    if kind == "oracle":
        written = written[written["member"] == 0]
        world = affmap.Layout.load("layout", "four_properties")
        flying = Oracle([world], agent.vehicle, agent.planner, agent.settings)
    table = affmap.evaluate(flying, layout, runs=3, steps=3, variation=variation)
    pd.testing.assert_frame_equal(table[SAME], written.astype(table[SAME].dtypes), atol=1e-5)


def test_a_flight_varies_as_an_evaluation_does() -> None:
    """Obstacles moved to other places for each run, with another seed than reports; starts are checked in each."""
    agent = affmap.load("exp1", context_size=0, members=(0, 3))
    task = {"runs": 2, "steps": 3, "seed": 5, "variation": "place/0.2"}
    runs = affmap.fly(agent, "original", **task)
    pd.testing.assert_frame_equal(affmap.evaluate(agent, "original", **task)[runs.table.columns], runs.table)
    assert len({*runs.layouts}) == 4
    points = np.stack(np.meshgrid(np.linspace(0.3, 2.7, 25), np.linspace(0.3, 1.7, 15)), axis=-1).reshape(-1, 2)
    free = np.array([layout.is_free(points, agent.vehicle.radius) for layout in runs.layouts])
    (only_last, *_) = points[free[:3].all(0) & ~free[3]]
    with pytest.raises(ConfigError, match=r"^starts: .* is not allowed; give a point of the arena .* of 'original'"):
        affmap.fly(agent, "original", **task, starts=only_last)
    assert affmap.fly(agent, "original", **task, starts=points[free.all(0)][0]).table["start_x"].nunique() == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (({}, "original"), r"^evaluate needs an agent and a layout, as in affmap\.evaluate\(agent, 'original'\)\.$"),
        ((RANDOM, []), r"^evaluate needs an agent and a layout"),
        ((RANDOM, ["original", "original"]), r"^two layouts have the name 'original'; give each a name of its own\.$"),
        (
            ([RANDOM], "original"),
            r"^agents = \[.*\] is not allowed; give an agent, .*, or several by their names, such as",
        ),
        (
            ("exp1", "original"),
            r"^agents = 'exp1' is not allowed; give an agent, such as affmap\.load\('exp1'\), or sev",
        ),
        ((3, "original"), r"^agent = 3 is not allowed; give an agent, such as affmap\.load\('exp1'\)\.$"),
        (({"mine": "exp1"}, "original"), r"^agent = 'exp1' is not allowed; give an agent"),
        ((RANDOM, "mars"), r"conf/layout/mars\.yaml does not exist"),
    ],
)
def test_a_mistake_is_told(arguments: tuple[Any, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        affmap.evaluate(*arguments)


def test_an_agent_that_cannot_see_a_layout_is_told(agents: dict[str, Agent]) -> None:
    with pytest.raises(ConfigError, match="'fog' has channels"):
        affmap.evaluate(agents, "fog")
    with pytest.raises(ConfigError, match=r"^runs = 0 is not allowed; give a whole number"):
        affmap.evaluate(agents, "original", runs=0)
