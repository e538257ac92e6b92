"""Synthetic stage folders in the formats that the stages write, small, seeded, and with known structure."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from affmap.report.tables import Circle, Job, World

CENTERS = [(0.75, 0.5), (0.75, 1.5), (1.5, 0.5), (1.5, 1.5), (2.25, 0.5), (2.25, 1.5)]
LAYOUT = {
    "name": "original",
    "size": [3.0, 2.0],
    "channels": ["solid"],
    "border_channel": "solid",
    "circles": [{"center": list(c), "radius": 0.2, "effect": "obstacle", "channel": "solid"} for c in CENTERS],
    "start_margin": 0.1,
    "start_side": 0.2,
}
NUM_RUNS = 4
HORIZON = 20


WriteStages = Callable[..., list[Job]]


@pytest.fixture(scope="session")
def write_stages() -> WriteStages:
    """Write every stage of a sweep; see `_write_stages` for the arguments."""
    return _write_stages


@pytest.fixture
def world() -> World:
    """The world of Experiment I."""
    return World("original", (3.0, 2.0), tuple(Circle(x, y, 0.2, "obstacle") for x, y in CENTERS), 0.1, 0.2, 0.06)


def _write_stages(
    root: Path,
    context_sizes: Sequence[int] = (0, 1, 8),
    planners: Sequence[str] = ("cem", "gradient"),
    members: int = 6,
    epochs: int = 4,
    steps: int = 40,
) -> list[Job]:
    """Write every stage of a sweep. Losses and errors fall with the context size; with a context, EB beats GB."""
    jobs = []
    data = _stage(root, "data", "d0", {"layout": LAYOUT, "sequences": 200})
    rng = np.random.default_rng(1)
    free = np.ones((20, 30), dtype=bool)
    free[[0, -1]] = free[:, [0, -1]] = False
    counts = np.where(free, rng.geometric(0.01, size=free.shape), 0)
    counts[5, 4] = 0
    np.savez(data / "coverage.npz", counts=counts, free=free, coverage=(counts > 0)[free].mean())
    for size in context_sizes:
        config = {
            "layout": LAYOUT,
            "vehicle": {"radius": 0.06},
            "model": {"context_size": size},
            "members": members,
            "training": {"epochs": epochs},
        }
        train, maps = _stage(root, "train", f"t{size}", config), _stage(root, "map", f"m{size}", config)
        _validation(size, members, epochs).to_csv(train / "validation.csv", index=False)
        x, y = np.arange(151) * 0.02, np.arange(101) * 0.02
        codes = np.stack([_codes(x, y, size, member) for member in range(members)])
        untrained = np.random.default_rng(5).normal(size=codes.shape)  # codes that say nothing of the place
        np.savez(maps / "maps.npz", codes=codes, initial_codes=untrained, x=x, y=y, member=np.arange(members))
        for planner in planners:
            control = _stage(root, "control", f"c{size}{planner}", config | {"planner": {"kind": planner}})
            _control(control, size, planner, members, steps)
            jobs.append(Job(size, planner, data, train, maps, control))
    return jobs


def _stage(root: Path, stage: str, digest: str, config: dict[str, Any]) -> Path:
    folder = root / f"{stage}-{digest}"
    folder.mkdir(parents=True)
    provenance = {
        "stage": stage,
        "digest": digest,
        "config": config,
        "versions": {"affmap": "0.1.0", "torch": "2.13.0", "numpy": "2.4.6"},
        "git": "0123abc",
        "machine": {"cores": 2, "system": "Linux 6.1 x86_64", "python": "3.11.9"},
        "command": "affmap +experiment=exp1",
        "seconds": 12.5,
        "started": "2026-11-22T11:00:00",
        "peak_memory_mib": 700.0,
    }
    (folder / "provenance.json").write_text(json.dumps(provenance))
    return folder


def _validation(size: int, members: int, epochs: int) -> pd.DataFrame:
    rng = np.random.default_rng([2, size])
    epoch = np.arange(1, epochs + 1)
    final = -7.6 - 0.5 * np.sqrt(size) + rng.normal(0, 0.15, size=(members, 1))
    losses = final + 4.0 * np.exp(-epoch / 4) + rng.normal(0, 0.1, size=(members, epochs))
    rows = {
        "member": np.repeat(np.arange(members), epochs),
        "epoch": np.tile(epoch, members),
        "training_nll": losses.ravel() - 0.1,
        "validation_nll": losses.ravel(),
    }
    return pd.DataFrame(rows)


def _codes(x: np.ndarray, y: np.ndarray, size: int, member: int) -> np.ndarray:
    """`[Y, X, C]`: a random mixture of the occupied area of a view and of its first moments, as a CNN might compute."""
    pixel = (np.arange(11) - 5) * 0.5 / 11
    view_x = (x[:, None] + pixel)[None, :, None, :]
    view_y = (y[:, None] + pixel)[:, None, :, None]
    solid = (view_x < 0) | (view_x > 3) | (view_y < 0) | (view_y > 2)  # [Y, X, 11, 11]
    for center_x, center_y in CENTERS:
        solid = solid | ((view_x - center_x) ** 2 + (view_y - center_y) ** 2 <= 0.04)
    scaled = pixel / pixel[-1]
    moments = [solid.mean((-2, -1)), (solid * scaled).mean((-2, -1)), (solid * scaled[:, None]).mean((-2, -1))]
    weights = np.random.default_rng([3, size, member]).normal(size=(3, size)) * ((2,), (6,), (6,))
    return np.tanh(np.stack(moments, axis=-1) @ weights).astype(np.float32)


def _control(folder: Path, size: int, planner: str, members: int, steps: int) -> None:
    rng = np.random.default_rng([4, size, planner == "cem"])
    count = members * NUM_RUNS
    member, run = np.repeat(np.arange(members), NUM_RUNS), np.tile(np.arange(NUM_RUNS), members)
    corners = np.array([(0.2, 0.2), (2.8, 0.2), (0.2, 1.8), (2.8, 1.8)])
    start, goal = corners[run], corners[::-1][run]
    time = np.linspace(0, 1, steps + HORIZON + 1)[None, :, None]
    bend = np.stack([np.zeros_like(time[..., 0]), 0.25 * np.sin(4 * np.pi * time[..., 0])], axis=-1)
    path = start[:, None] + (goal - start)[:, None] * np.minimum(1, 1.6 * time) + bend  # [B, T + H + 1, 2]
    plans = np.stack([path[:, t + 1 : t + 1 + HORIZON] for t in range(steps)], axis=1)
    deviation = np.broadcast_to(0.02 * np.sqrt(np.arange(1, HORIZON + 1))[:, None], plans.shape)
    np.savez(
        folder / "trajectories.npz",
        position=path[:, : steps + 1].astype(np.float32),
        goal=goal,
        planned_position=plans.astype(np.float32),
        planned_std=deviation.astype(np.float32),
        action=np.zeros((count, steps, 4), np.float32),
        member=member,
        run=run,
    )
    evolutionary = planner == "cem"
    distance = 1.15 - 0.25 * np.sqrt(size) if evolutionary else 0.9 + 0.02 * size
    reached = rng.random(count) < (0.75 if size == 0 else 0.97)
    table = pd.DataFrame(
        {"experiment": "exp1", "layout": "original", "planner": planner, "lookup_spacing": 0.01}, range(count)
    )
    table = table.assign(context_size=size, member=member, run=run)
    table[["start_x", "start_y"]], table[["goal_x", "goal_y"]] = start, goal
    table["prediction_error"] = -8.0 - 0.6 * np.sqrt(size) + rng.normal(0, 0.3, count)
    table["mean_distance"] = distance + rng.gamma(2.0, 0.06, count)
    table["reached"] = reached
    table["steps_to_reach"] = pd.array(np.where(reached, rng.integers(30, 120, count), 0), "Int64")
    table.loc[~reached, "steps_to_reach"] = pd.NA
    table["steps_touching"] = rng.poisson(40 / (1 + size), count)
    table["steps_in_fog"] = 0
    table["lookup_error"] = 0.01
    table.to_csv(folder / "runs.csv", index=False)
