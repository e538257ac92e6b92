"""Simulation: steps of our environment beside Gymnasium's LunarLander, and what a step of control is spent on.

Both are rigid bodies in the same Box2D. Ours also cuts out a view at each step; LunarLander also resolves its legs'
joints and particles. New episodes are begun whenever one ends, as everybody must.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import pandas as pd
from measure import Contender, Result, compare

import affmap  # noqa: F401  # registers the environment
from affmap.control.agent import Agent, ControlSettings
from affmap.control.episodes import control
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.env.physics import Physics
from affmap.env.vehicle import VehicleEnv
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import ModelSettings, Stack
from affmap.planning.cem import CEMPlanner

STEPS = 1000
"""Of a call."""

NUM_ENVS = 8
"""Environments of a vector."""

OURS, PEER = "affmap/Vehicle-v0", "LunarLander-v3"
LAYOUT = Layout.load("layout", "original")
VEHICLE = Vehicle.load("vehicle", "default")


def results(rounds: int) -> list[Result]:
    """One environment, and a vector of them."""
    single = [
        Contender(OURS, stepper(gymnasium.make(OURS)), STEPS),
        Contender("Physics alone", physics_stepper(), STEPS),
        Contender("VehicleEnv, unwrapped", stepper(VehicleEnv(LAYOUT, VEHICLE)), STEPS),
        Contender(PEER, stepper(gymnasium.make(PEER)), STEPS),
    ]
    vectors = [Contender(name, vector_stepper(name), STEPS) for name in (OURS, PEER)]
    return [
        *compare("simulation, one environment", "step", single, rounds=rounds),
        *compare(f"simulation, vector of {NUM_ENVS}", "step", vectors, rounds=rounds),
    ]


def stepper(env: gymnasium.Env[Any, Any]) -> Callable[[], None]:
    """A call makes `STEPS` steps with actions drawn beforehand."""
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(STEPS)]

    def run() -> None:
        env.reset()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return run


def physics_stepper() -> Callable[[], None]:
    """A call makes `STEPS` steps of the bodies alone."""
    actions = np.random.default_rng(0).uniform(size=(STEPS, 4))

    def run() -> None:
        physics = Physics(LAYOUT, VEHICLE, np.array([0.2, 0.2]))
        for action in actions:
            physics.step(action)

    return run


def vector_stepper(name: str) -> Callable[[], None]:
    """A call makes `STEPS` steps, all environments of a vector counted."""
    envs = gymnasium.make_vec(name, num_envs=NUM_ENVS)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(STEPS // NUM_ENVS)]

    def run() -> None:
        envs.reset(seed=0)
        for action in actions:
            envs.step(action)

    return run


def control_step(members: int = 25, num_steps: int = 20) -> pd.DataFrame:
    """What a step of control is spent on: an untrained stack, four agents a member, one of them in each corner.

    Columns: part, milliseconds (of a step of all agents together), share.
    """
    settings = ControlSettings.load("control", "default", num_steps=num_steps)
    stack = Stack(ModelSettings.load("model", "default"), len(LAYOUT.channels), range(members))
    painted = AffordanceMap.paint(stack, [LAYOUT.map], spacing=0.02)
    agent = Agent(stack, painted, CEMPlanner.load("planner", "cem"), settings)
    seconds: defaultdict[str, float] = defaultdict(float)
    ends: list[float] = []

    def on_step(step: int) -> None:
        if step == 1:  # the first one warmed up
            seconds.clear()
        ends.append(time.perf_counter())

    with clocked(Agent, "act", seconds), clocked(VehicleEnv, "step", seconds), clocked(Physics, "step", seconds):
        control(agent, [LAYOUT], VEHICLE, settings, agent.seeds, on_step)
    total, steps = ends[-1] - ends[0], num_steps - 1
    planning, env, physics = (seconds[name] for name in ("Agent.act", "VehicleEnv.step", "Physics.step"))
    parts = {
        "planning": planning,
        "Box2D": physics,
        "environments without Box2D": env - physics,
        "views and records": total - planning - env,
    }
    rows = [(part, 1000 * spent / steps, spent / total) for part, spent in parts.items()]
    return pd.DataFrame(rows, columns=["part", "milliseconds", "share"])


@contextmanager
def clocked(owner: type, name: str, seconds: defaultdict[str, float]) -> Iterator[None]:
    """Add up in `seconds` the time spent in a method."""
    method = getattr(owner, name)

    def run(*arguments: Any) -> Any:
        start = time.perf_counter()
        result = method(*arguments)
        seconds[f"{owner.__name__}.{name}"] += time.perf_counter() - start
        return result

    with patch.object(owner, name, run):
        yield
