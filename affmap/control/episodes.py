"""Goal-directed runs and their tables: every member flies from every corner to the opposite one (Section 4.2).

All runs proceed side by side, one vehicle environment each. Knows controllers and environments.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from affmap.control import arguments
from affmap.control.agent import Agent, ControlSettings, check_channels, prediction_error, seeds_of
from affmap.control.controller import Controller, Decision, Observation
from affmap.control.oracle import Oracle
from affmap.control.variation import AnyVariation, make_tasks
from affmap.control.variation import load as load_variation
from affmap.env.body import AnyVehicle, Vehicle
from affmap.env.layout import Layout
from affmap.env.procedural import AnyLayout, first_layout
from affmap.env.vehicle import VehicleEnv
from affmap.lazy import notebook
from affmap.progress import reported, silent
from affmap.random import generator, integer
from affmap.results import metrics
from affmap.results.files import Trajectories
from affmap.settings.messages import counted
from affmap.threads import limited
from affmap.view import VisibleLayout, views


@dataclass(frozen=True, repr=False, eq=False)
class Runs:
    """Results of B runs: their `table` of metrics, their `trajectories`, their `layouts` and the `vehicle`."""

    trajectories: dict[str, np.ndarray]
    """`position [B, T + 1, 2]` (true), `goal [B, 2]`, `action [B, T, 4]`, `planned_position` and `planned_std`
    `[B, T, H, 2]` (u), `prediction_error [B, T]` (nats), `touching`, `in_fog`, `reached [B, T]`, `member [B]`,
    `run [B]`. Values that a controller does not predict are NaN."""
    layouts: list[Layout]
    """`[B]`, in which the runs took place."""
    vehicle: Vehicle
    """Physical constants of the vehicle that flew."""

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row a run; columns as `summarise` explains."""
        return summarise(self.trajectories)

    def _repr_html_(self) -> str | None:
        return notebook.runs(self)

    def __repr__(self) -> str:
        num_runs, num_steps = self.trajectories["reached"].shape
        runs, members = counted(num_runs, "run"), counted(self.table["member"].nunique(), "member")
        reached, distance = self.table["reached"].sum(), self.table["mean_distance"].mean()
        goals = f"{reached} reached the goal, mean distance {distance:.2f} u"
        return f"Runs({runs} of {members}, {counted(num_steps, 'step')}, {goals})"


def control(
    controller: Controller,
    layouts: Sequence[Layout],
    vehicle: Vehicle,
    settings: ControlSettings,
    seeds: Sequence[int],
    on_step: Callable[[int], None] = lambda step: None,
    *,
    starts: np.ndarray | None = None,
    goals: np.ndarray | None = None,
    seed: int = 0,
) -> Runs:
    """Let every member fly all its runs, in one world or, with B `layouts` (member-major), each in its own.

    Start, goal and all randomness of a run depend on the member's seed, the number of the run and `seed` only, so that
    agents, planners, look-ups and context sizes are compared on the same starts and goals.

    Args:
        controller: steers the B vehicles of all members side by side.
        layouts: the world, or B of them.
        vehicle: its physical constants.
        settings: numbers of runs and steps, and the radius of the goal.
        seeds: of the M members; those of an `Agent` are its own, `agent.seeds`.
        on_step: called with the number of steps done.
        starts: where the B runs start, `[B, 2]` in u; by default a random place in a corner, for each run the next.
        goals: where they should end, `[B, 2]` in u; by default a random place in the opposite corner, or as far
            from the start as the settings say.
        seed: of other starts, goals and random numbers than those of reports, which have 0.
    """
    pairs = [(member, run) for member in seeds for run in range(settings.runs_per_member)]
    streams = arguments.streams(seeds, settings.runs_per_member, seed)
    layouts_of_runs = [layouts[0]] * len(pairs) if len(layouts) == 1 else layouts
    have_doors = any(layout.opened is not layout for layout in layouts)
    envs = [VehicleEnv(layout, vehicle, settings.goal_radius, views=False) for layout in layouts_of_runs]

    def worlds() -> list[VisibleLayout]:
        """Visible layouts as they are now: one for all, or, since doors open for each run by itself, one for each."""
        return [env.layout.map for env in envs] if have_doors else [layout.map for layout in layouts]

    generators = [generator(member, "planner", *keys) for member, *keys in streams]
    options: list[dict[str, Any]] = [{"corner": run % 4} for _, run in pairs]
    if settings.goal_distance is not None and goals is None:
        options = [{**each, "distance": settings.goal_distance} for each in options]
    for key, points in (("position", starts), ("goal", goals)):
        options = [{**each, key: points[b]} for b, each in enumerate(options)] if points is not None else options
    begun = [
        env.reset(seed=integer(member, "start and goal", *keys), options=each)
        for env, (member, *keys), each in zip(envs, streams, options, strict=True)
    ]
    positions = [np.stack([info["position"] for _, info in begun])]
    observation = _batch([start for start, _ in begun], views(worlds(), positions[-1]), settings.device)
    record: defaultdict[str, list[np.ndarray]] = defaultdict(list)
    state = controller.initial(len(pairs))
    for step in range(settings.num_steps):
        decision, state = controller.act(observation, state, generators)
        results = [env.step(action) for env, action in zip(envs, decision.action.cpu().numpy(), strict=True)]
        infos = [result[4] for result in results]
        positions.append(np.stack([info["position"] for info in infos]))
        observation = _batch([result[0] for result in results], views(worlds(), positions[-1]), settings.device)
        _note(record, decision, observation, infos)
        on_step(step + 1)
    trajectories = {key: np.stack(parts, axis=1) for key, parts in record.items()}
    trajectories["position"] = np.stack(positions, axis=1).astype(np.float32)
    trajectories["goal"] = np.stack([env.goal for env in envs])
    trajectories["member"], trajectories["run"] = np.array(pairs).T
    return Runs(trajectories, list(layouts_of_runs), vehicle)


def fly(
    controller: Controller,
    layout: AnyLayout,
    *,
    runs: int | None = None,
    steps: int | None = None,
    starts: ArrayLike | None = None,
    goals: ArrayLike | None = None,
    seed: int = 0,
    vehicle: AnyVehicle | None = None,
    variation: AnyVariation | None = None,
    progress: bool = True,
    threads: int = 1,
) -> Runs:
    """Let every member of an agent fly all its runs in any layout.

    Args:
        controller: an agent made by `affmap.load` or `affmap.train`, for instance. Any other controller flies the runs
            of member 0, with the settings of `conf/control/default.yaml`; `control` takes other ones.
        layout: the world, or its keys and values, or the name of a file in `conf/layout`; for rules of worlds, the
            first member's first world.
        runs: R, runs of each member; by default as many as there are `starts` or `goals`, else those of the agent's
            settings.
        steps: T, length of the runs; by default that of the agent's settings.
        starts: where each member's runs start, `[R, 2]` in u, or where all of them do, `[2]`; or those of all members,
            `[B, 2]` (member-major). By default a random place in a corner, for each run in the next one.
        goals: where they should end, likewise. By default a random place in the opposite corner.
        seed: of starts, goals and all other random numbers; 0 gives the runs of reports.
        vehicle: the physics; by default that which the agent was trained in, else that of `conf/vehicle/default.yaml`.
        variation: what is other than at home, a factor and its value as in sweeps, such as `mass/0.2`; the factors are
            those of `affmap.control.variation.FACTORS`. Agents are not told, only those that know the physics. By
            default nothing.
        progress: whether a terminal shows the number of steps done.
        threads: of PyTorch, during the flight.

    Returns:
        The runs: a `table` with a row for each, their `trajectories`, and their `layouts`; see `affmap.control.Runs`.

    Raises:
        ConfigError: it is no agent, or was trained with other channels; there is no such file; a number is not allowed;
            there are no threads; a start or a goal is outside of the arena or in an obstacle; an obstacle stands in a
            corner where runs start; or there is no such variation, or the layout cannot have it.

    Warns:
        UserWarning: the vehicle is another than the agent was trained with.
    """
    seeds = seeds_of(arguments.agent(controller))
    first, physics = first_layout(layout, seeds[0]), arguments.vehicle(controller, vehicle)
    settings = arguments.settings(controller, arguments.num_runs(runs, starts, goals), steps)
    shape, seed = (len(seeds), settings.runs_per_member), arguments.whole("seed", seed)
    streams = arguments.streams(seeds, settings.runs_per_member, seed)
    varied = load_variation(variation)
    tasks = make_tasks(varied, [first], physics, settings, streams)
    show, layouts = reported if progress else silent, [task.layout for task in tasks]
    _, physics, settings = tasks[0]
    with (
        limited(threads),
        show(f"flight in {first.name}", settings.num_steps, "steps", on_terminal_only=True) as update,
    ):
        return control(
            bring(controller, *layouts, vehicle=physics if varied else None),
            layouts,
            physics,
            settings,
            seeds,
            update,
            starts=arguments.places("starts", starts, shape, layouts, physics.radius),
            goals=arguments.places("goals", goals, shape, layouts),
            seed=seed,
        )


def bring(controller: Controller, *layouts: Layout, vehicle: Vehicle | None = None) -> Controller:
    """Bring a controller into a layout, or into those of B vehicles (member-major).

    Agents with a look-up or knowledge of the world are copied, others returned. One that knows the physics is told of
    another `vehicle`.

    Raises:
        ConfigError: an `Agent` was trained with other channels.
    """
    if isinstance(controller, Oracle):
        return controller.elsewhere(layouts, vehicle)
    if isinstance(controller, Agent):
        for layout in layouts:
            check_channels(controller, layout)
        return controller.elsewhere([layout.map for layout in layouts])
    return controller


def _note(
    record: defaultdict[str, list[np.ndarray]], decision: Decision, after: Observation, infos: list[dict]
) -> None:
    """Record decisions and their outcomes."""
    values = {
        "action": decision.action,
        "planned_position": decision.path.mean,
        "planned_std": decision.path.log_std.exp(),
        "prediction_error": prediction_error(decision, after.delta),
    }
    for key, value in values.items():
        record[key].append(value.cpu().numpy())
    for key in ("touching", "in_fog", "reached"):
        record[key].append(np.array([info[key] for info in infos]))


def _batch(observations: Sequence[dict[str, np.ndarray]], pictures: np.ndarray, device: str) -> Observation:
    """Observations of B environments, and their views `[B, K, 11, 11]`, as tensors."""
    return Observation.of([{**each, "view": view} for each, view in zip(observations, pictures, strict=True)], device)


def summarise(trajectories: dict[str, np.ndarray]) -> pd.DataFrame:
    """Summarise runs in a table, one row per run.

    Columns: member, run; start_x, start_y, goal_x, goal_y (u); all metrics of runs (`affmap.results.metrics`), those of
    users (`affmap.register_metric`) last. Ours are: prediction_error (nats, mean over steps of the negative
    log-likelihood of the change of position; NaN where nothing was predicted); mean_distance (u, between true position
    and goal, mean over the steps' ends); reached; steps_to_reach (empty where not reached); success (reached, and never
    in fog; Experiment IV); steps_touching; steps_in_fog; final_spread (u, largest distance of the positions of the last
    quarter from their mean: less than the vehicle's diameter if it is stuck).

    Raises:
        ConfigError: a metric of a user has another number of values, or its module cannot be imported.
    """
    return metrics.table(Trajectories(**trajectories), metrics.run_metrics())
