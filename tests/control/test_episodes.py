"""Goal-directed runs against members alone, replays of the environment, torch.distributions and sums by hand."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
from torch.distributions import Normal

from affmap.control.agent import Agent, ControlSettings, Decision, Observation
from affmap.control.episodes import Runs, control, summarise
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import load
from affmap.env.vehicle import VehicleEnv
from affmap.model.lookup import LookupSettings, make_lookup
from affmap.model.stack import ModelSettings, Stack
from affmap.planning.cem import CEMPlanner
from affmap.planning.gradient import GradientPlanner
from affmap.planning.planner import Generators, Planner
from affmap.random import generator, integer

FOG = {"center": [0.3, 0.3], "radius": 0.15, "effect": "fog", "channel": "solid"}
LAYOUT = Layout.load("layout", "original", circles=[FOG, *Layout.load("layout", "original").model_dump()["circles"]])
VEHICLE = Vehicle.load("vehicle", "default")
SETTINGS = ControlSettings.load("control", "default", num_steps=12, runs_per_member=5, goal_radius=2.9)
T, R, H = SETTINGS.num_steps, SETTINGS.runs_per_member, 3
SEEDS = (4, 5)
PLANNERS: dict[str, Planner] = {
    "cem": CEMPlanner.load("planner", "cem", horizon=H, num_candidates=8, num_iterations=2),
    "gradient": GradientPlanner.load("planner", "gradient", horizon=H, num_iterations=4, learning_rate=0.05),
}


class Recorder(Agent):
    """An agent that remembers what it saw and decided."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.seen: list[Observation] = []
        self.decisions: list[Decision] = []

    def act(self, observation: Observation, state: Any, generators: Generators) -> tuple[Decision, Any]:
        decision, state = super().act(observation, state, generators)
        self.seen.append(observation)
        self.decisions.append(decision)
        return decision, state


def make_agent(seeds: Sequence[int], context_size: int, kind: str, device: str = "cpu") -> Recorder:
    model = Stack(ModelSettings.load("model", "default", context_size=context_size), LAYOUT.map.num_channels, seeds)
    lookup = make_lookup(LookupSettings.load("lookup", "map", spacing=0.1), model.to(device), [LAYOUT.map])
    return Recorder(model, lookup, PLANNERS[kind], SETTINGS.model_copy(update={"device": device}))


@cache
def fly(seeds: Sequence[int] = SEEDS, context_size: int = 3, kind: str = "cem") -> tuple[Recorder, Runs]:
    agent = make_agent(seeds, context_size, kind)
    return agent, control(agent, [LAYOUT], VEHICLE, SETTINGS, agent.seeds)


def replay(runs: Runs, b: int) -> tuple[VehicleEnv, list[tuple]]:
    """Run `b` again, in an environment of its own, from what was recorded: the environment and its steps."""
    env = VehicleEnv(LAYOUT, VEHICLE, SETTINGS.goal_radius)
    member, run = int(runs.trajectories["member"][b]), int(runs.trajectories["run"][b])
    env.reset(seed=integer(member, "start and goal", run), options={"corner": run % 4})
    return env, [env.step(action) for action in runs.trajectories["action"][b]]


everything = pytest.mark.parametrize(
    ("context_size", "kind"), [(0, "cem"), (3, "cem"), (0, "gradient"), (3, "gradient")]
)


@everything
def test_members_together_are_each_alone(context_size: int, kind: str) -> None:
    """Rows and trajectories of a stack of 4 and 5 are those of 4 alone and 5 alone, to float rounding."""
    together = fly(SEEDS, context_size, kind)[1]
    alone = [fly((seed,), context_size, kind)[1] for seed in SEEDS]
    tables = pd.concat([runs.table for runs in alone], ignore_index=True)
    pd.testing.assert_frame_equal(together.table, tables, atol=1e-3, rtol=1e-3)
    for key, values in together.trajectories.items():
        parts = np.concatenate([runs.trajectories[key] for runs in alone])
        assert values.dtype == parts.dtype
        np.testing.assert_allclose(values.astype(float), parts.astype(float), atol=1e-3, err_msg=key)
    error = together.table["prediction_error"]
    assert (error[:R].to_numpy() != error[R:].to_numpy()).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU that PyTorch can use")
@everything
def test_a_gpu_does_what_the_cpu_does(context_size: int, kind: str) -> None:
    """The first decisions, which nothing else depends on yet, and the form of everything."""
    agent = make_agent(SEEDS, context_size, kind, "cuda")
    runs = control(agent, [LAYOUT], VEHICLE, SETTINGS.model_copy(update={"device": "cuda"}), SEEDS)
    reference = fly(SEEDS, context_size, kind)[1]
    assert list(runs.table.columns) == list(reference.table.columns)
    for key, values in runs.trajectories.items():
        assert values.shape == reference.trajectories[key].shape and values.dtype == reference.trajectories[key].dtype
    first, expected = (each.trajectories["planned_position"][:, 0] for each in (runs, reference))
    np.testing.assert_allclose(first, expected, atol=1e-3)


@everything
def test_same_seeds_same_results(context_size: int, kind: str) -> None:
    """Bit for bit, whatever torch's and NumPy's global generators do."""
    first = fly(SEEDS, context_size, kind)[1]
    torch.rand(3), np.random.default_rng().random()
    second = control(make_agent(SEEDS, context_size, kind), [LAYOUT], VEHICLE, SETTINGS, SEEDS)
    pd.testing.assert_frame_equal(first.table, second.table, check_exact=True)
    for key, values in first.trajectories.items():
        np.testing.assert_array_equal(values, second.trajectories[key], err_msg=key)


def test_shapes_and_order_are_those_promised() -> None:
    """The docstring of `Runs`; member-major."""
    agent, runs = fly()
    b = len(SEEDS) * R
    shapes = {key: values.shape for key, values in runs.trajectories.items()}
    assert shapes == {
        "position": (b, T + 1, 2),
        "goal": (b, 2),
        "action": (b, T, 4),
        "planned_position": (b, T, H, 2),
        "planned_std": (b, T, H, 2),
        "prediction_error": (b, T),
        "touching": (b, T),
        "in_fog": (b, T),
        "reached": (b, T),
        "member": (b,),
        "run": (b,),
    }
    assert runs.table["member"].tolist() == [4] * R + [5] * R
    assert runs.table["run"].tolist() == [*range(R)] * 2
    assert len(agent.decisions) == T


def test_runs_start_in_their_corner_and_end_in_the_opposite_one() -> None:
    """Section 4.2, in the layout's squares; run 4 begins where run 0 did, but elsewhere in the square."""
    runs = fly()[1]
    for _, row in runs.table.iterrows():
        for point, corner in (
            ((row["start_x"], row["start_y"]), row["run"] % 4),
            ((row["goal_x"], row["goal_y"]), 3 - row["run"] % 4),
        ):
            low, high = LAYOUT.corner(corner)
            assert ((low <= np.array(point) + 1e-6) & (np.array(point) <= high + 1e-6)).all()
    starts = runs.table[["start_x", "start_y", "goal_x", "goal_y"]].round(4)
    assert not starts.duplicated().any()
    assert (starts.nunique() == len(starts)).all()


def test_starts_and_goals_are_the_same_for_all_planners_and_context_sizes() -> None:
    """Bit for bit; what comes of them is not."""
    columns = ["member", "run", "start_x", "start_y", "goal_x", "goal_y"]
    first = fly()[1].table
    for context_size, kind in ((0, "cem"), (0, "gradient"), (3, "gradient")):
        other = fly(SEEDS, context_size, kind)[1].table
        pd.testing.assert_frame_equal(other[columns], first[columns], check_exact=True)
        assert (other["mean_distance"] != first["mean_distance"]).all()


@everything
def test_what_is_recorded_is_what_happened(context_size: int, kind: str) -> None:
    """Every run replayed alone: positions, contact, fog and arrival; the mean distance is minus the mean reward."""
    agent, runs = fly(SEEDS, context_size, kind)
    assert ((runs.trajectories["action"] >= 0) & (runs.trajectories["action"] <= 1)).all()
    assert runs.trajectories["touching"].any()
    for b in range(len(runs.table)):
        env, steps = replay(runs, b)
        infos, rewards = [step[4] for step in steps], [step[1] for step in steps]
        np.testing.assert_allclose(
            runs.trajectories["position"][b, 1:], [info["position"] for info in infos], atol=1e-6
        )
        np.testing.assert_array_equal(runs.trajectories["goal"][b], env.goal)
        for key in ("touching", "in_fog", "reached"):
            assert runs.trajectories[key][b].tolist() == [info[key] for info in infos]
        assert runs.table["mean_distance"][b] == pytest.approx(-np.mean(rewards), abs=1e-6)
        for t in range(1, T):
            for key in ("position", "delta", "view", "goal"):
                np.testing.assert_array_equal(getattr(agent.seen[t], key)[b].numpy(), steps[t - 1][0][key])


@everything
def test_prediction_errors_are_those_of_torch_distributions(context_size: int, kind: str) -> None:
    """The change of the reported position in the next step, under what was expected of it before."""
    agent, runs = fly(SEEDS, context_size, kind)
    expected = np.empty((len(runs.table), T))
    for b in range(len(runs.table)):
        _, steps = replay(runs, b)
        for t in range(T):
            delta = agent.decisions[t].delta
            density = Normal(delta.mean[b], delta.log_std[b].exp())
            expected[b, t] = -density.log_prob(torch.from_numpy(steps[t][0]["delta"])).sum().item()
    np.testing.assert_allclose(runs.trajectories["prediction_error"], expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(runs.table["prediction_error"], expected.mean(axis=1), rtol=1e-4)
    assert runs.trajectories["in_fog"].any() and not runs.trajectories["in_fog"].all()


@everything
def test_actions_and_plans_are_those_decided(context_size: int, kind: str) -> None:
    """Step by step, as deviations; the first planned position is the first action's."""
    agent, runs = fly(SEEDS, context_size, kind)
    for t, decision in enumerate(agent.decisions):
        np.testing.assert_array_equal(runs.trajectories["action"][:, t], decision.action)
        np.testing.assert_array_equal(runs.trajectories["planned_position"][:, t], decision.path.mean)
        np.testing.assert_allclose(runs.trajectories["planned_std"][:, t], decision.path.log_std.exp())
    assert np.ptp(runs.trajectories["action"][:, :, 0]) > 0.1


def test_steps_are_reported_as_they_are_done() -> None:
    """For whoever shows the progress."""
    steps: list[int] = []
    control(make_agent((4,), 0, "cem"), [LAYOUT], VEHICLE, SETTINGS, (4,), steps.append)
    assert steps == [*range(1, T + 1)]


def test_summaries_worked_out_by_hand() -> None:
    """Three runs of four steps: one arrives at once, one later and leaves again, one never.

    The last quarter of five positions are the last two: they are half their distance from their mean.
    """
    position = np.zeros((3, 5, 2))
    position[0, :, 0] = [9, 0, 0, 0, 0]  # the start does not count
    position[1, :, 1] = [9, 4, 3, 2, 3]
    position[2] = [[7, 8], [3, 4], [6, 8], [3, 4], [0, 0]]
    reached = np.array([[1, 1, 1, 1], [0, 0, 1, 0], [0, 0, 0, 0]], bool)
    trajectories = {
        "position": position,
        "goal": np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
        "prediction_error": np.array([[1.0, 2, 3, 6], [-8, -8, -8, -4], [0, 0, 0, 0]]),
        "reached": reached,
        "touching": np.array([[0, 0, 0, 0], [1, 0, 1, 1], [1, 1, 1, 1]], bool),
        "in_fog": np.array([[0, 1, 0, 0], [0, 0, 0, 0], [1, 1, 0, 0]], bool),
        "member": np.array([4, 4, 5]),
        "run": np.array([0, 1, 0]),
        "action": np.zeros((3, 4, 4)),
        "planned_position": np.zeros((3, 4, 20, 2)),
        "planned_std": np.zeros((3, 4, 20, 2)),
    }
    expected = pd.DataFrame(
        {
            "member": [4, 4, 5],
            "run": [0, 1, 0],
            "start_x": [9.0, 0.0, 7.0],
            "start_y": [0.0, 9.0, 8.0],
            "goal_x": [0.0, 0.0, 0.0],
            "goal_y": [0.0, 1.0, 0.0],
            "prediction_error": [3.0, -7.0, 0.0],
            "mean_distance": [0.0, 2.0, 5.0],
            "reached": [True, True, False],
            "steps_to_reach": pd.array([1, 3, None], dtype="Int64"),
            "success": [False, True, False],
            "steps_touching": [0, 3, 4],
            "steps_in_fog": [1, 0, 2],
            "final_spread": [0.0, 0.5, 2.5],
        }
    )
    pd.testing.assert_frame_equal(summarise(trajectories), expected)


def test_the_table_is_the_summary_of_the_trajectories() -> None:
    """And reached and steps to reach say what the replayed runs say; some arrive, some do not."""
    runs = fly(SEEDS, 0, "gradient")[1]
    pd.testing.assert_frame_equal(runs.table, summarise(runs.trajectories))
    assert runs.table["reached"].nunique() == 2 and (runs.table["steps_to_reach"] > 1).any()
    for b, row in runs.table.iterrows():
        arrivals = [t + 1 for t, step in enumerate(replay(runs, int(b))[1]) if step[4]["reached"]]
        assert row["reached"] == bool(arrivals)
        assert (row["steps_to_reach"] == arrivals[0]) if arrivals else pd.isna(row["steps_to_reach"])


def test_each_run_in_a_world_of_its_own_is_the_run_alone_in_that_world() -> None:
    """Two members with two runs in four worlds, against one member's run in one world; walls and views are its own."""
    six = [circle.model_dump() for circle in Layout.load("layout", "original").circles]
    shifts = (0.0, 0.1, 0.2, 0.3)
    layouts = [
        Layout.load(
            "layout", "original", circles=[{**c, "center": (c["center"][0], c["center"][1] + s / 2)} for c in six]
        )
        for s in shifts
    ]
    settings = SETTINGS.model_copy(update={"runs_per_member": 2})
    model = Stack(ModelSettings.load("model", "default", context_size=3), 1, SEEDS)
    for kind in ("map", "exact"):
        lookup = make_lookup(LookupSettings.load("lookup", kind), model, [layout.map for layout in layouts])
        together = control(Agent(model, lookup, PLANNERS["cem"], settings), layouts, VEHICLE, settings, SEEDS)
        for number, (seed, run) in enumerate((seed, run) for seed in SEEDS for run in range(2)):
            one = model.select([SEEDS.index(seed)])
            alone_lookup = make_lookup(LookupSettings.load("lookup", kind), one, [layouts[number].map])
            agent = Agent(one, alone_lookup, PLANNERS["cem"], settings)
            alone = control(agent, [layouts[number]], VEHICLE, settings, one.seeds)
            for key in ("position", "prediction_error", "planned_position"):
                found, expected = together.trajectories[key][number], alone.trajectories[key][run]
                np.testing.assert_allclose(found, expected, atol=2e-3, err_msg=f"{kind} {key}")


DOORS = [load("doors").draw(generator(0, "doors test", number)) for number in range(4)]  # type: ignore[union-attr]


@pytest.mark.parametrize("kind", ["map", "exact"])
def test_doors_open_for_each_run_by_itself(kind: str) -> None:
    """Two members with two runs each, of which some start at a key: against the run alone; views, codes and bits."""
    model = Stack(ModelSettings.load("model", "default", context_size=3), 3, SEEDS)
    settings = SETTINGS.model_copy(update={"runs_per_member": 2})
    keys = np.array([next(each.center for each in world.circles if each.effect == "key") for world in DOORS])
    starts = np.where(np.array([True, False, False, True])[:, None], keys, keys + np.array([0.0, 0.4]))
    lookups = LookupSettings.load("lookup", kind)
    together = Recorder(model, make_lookup(lookups, model, [each.map for each in DOORS]), PLANNERS["cem"], settings)
    runs = control(together, DOORS, VEHICLE, settings, SEEDS, starts=starts)
    for number, layout in enumerate(DOORS):
        path = runs.trajectories["position"][number].astype(float)
        np.testing.assert_array_equal([each.view[number] for each in together.seen], layout.views(path)[:-1])
        assert layout.are_open(path)[0] == (number in (0, 3))
        one = model.select([number // 2])
        alone = Agent(one, make_lookup(lookups, one, [layout.map]), PLANNERS["cem"], settings)
        own = settings.model_copy(update={"runs_per_member": 2})
        flown = control(alone, [layout], VEHICLE, own, one.seeds, starts=starts[[number, number]])
        for key in ("position", "prediction_error", "planned_position"):
            found, expected = runs.trajectories[key][number], flown.trajectories[key][number % 2]
            np.testing.assert_allclose(found, expected, atol=2e-3, err_msg=key)


def test_what_is_imagined_at_an_opened_door_is_what_is_imagined_without_one() -> None:
    """After a visit of the key, decisions are those of an agent that has never known of the door."""
    layout = DOORS[0]
    key = next(each.center for each in layout.circles if each.effect == "key")
    model = Stack(ModelSettings.load("model", "default", context_size=3), 3, SEEDS)
    flown = []
    for world in (layout, layout.opened):
        for start in (key, np.add(key, [0.0, 0.4])):
            lookup = make_lookup(LookupSettings.load("lookup", "map"), model, [world.map])
            agent = Agent(model, lookup, PLANNERS["cem"], SETTINGS)
            starts = np.tile(np.array(start, float), (len(SEEDS) * R, 1))
            flown.append(control(agent, [world], VEHICLE, SETTINGS, SEEDS, starts=starts).trajectories)
    for name in ("position", "planned_position", "action"):
        np.testing.assert_allclose(flown[0][name], flown[2][name], atol=1e-4)
    assert not np.isnan(flown[1]["position"]).any()
