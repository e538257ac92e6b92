"""Synthetic stage folders in the formats that the stages write, small, seeded, and with known structure.

Layouts are those of `conf/layout`; the worlds of the procedural ones are drawn here. Known structure: every claim of
the paper holds where all planners, layouts and three context sizes are there, and six members or more.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from affmap.env.layout import Circle, Layout
from affmap.results import files
from affmap.results.files import Blocks, Deviations, Maps, Trajectories
from affmap.results.halo import fog_distance
from affmap.results.setting import Setting

LAYOUTS = Path(__file__).parents[1] / "conf" / "layout"
VEHICLE = {"radius": 0.06}
NUM_RUNS = 4
HORIZON = 20
GROWTH_EPOCHS = (1, 2, 5, 10, 30, 100)
X, Y = np.arange(151) * 0.02, np.arange(101) * 0.02
KINDS = ("solid", "fog", "force_up", "force_down")

WriteStages = Callable[..., list[Setting]]
WriteGrowth = Callable[..., Setting]


class Condition(NamedTuple):
    """What an experiment's layouts are; names of files of `conf/layout`."""

    training: tuple[str, ...]
    control: str
    map: str


FOUR = ("training_obstacles", "training_fog", "training_force_up", "training_force_down")
CONDITIONS = {
    "exp1": [Condition(("original",), "original", "original")],
    "exp2": [Condition(("original",), name, name) for name in ("original", "two_obstacles", "twelve_obstacles")],
    "exp3": [Condition((name,), name, name) for name in ("original", "three_looks")],
    "exp4": [Condition(("fog",), "fog", "fog")],
    "exp5": [Condition(FOUR, name, "four_properties") for name in ("procedural_easy", "procedural_hard")],
}
FARTHER = {"two_obstacles": 0.1, "twelve_obstacles": -0.1}
"""Layout -> what its mean distances are larger by, u."""


def write_stages(
    root: Path,
    context_sizes: Sequence[int] = (0, 1, 8),
    planners: Sequence[str] | None = None,
    members: int = 6,
    epochs: int = 4,
    steps: int = 40,
    experiment: str = "exp1",
) -> list[Setting]:
    """Write every stage of a sweep of `experiment`; planners are by default those of the paper."""
    if planners is None:
        planners = ("cem", "gradient") if experiment == "exp1" else ("cem",)
    jobs = []
    for condition in CONDITIONS[experiment]:
        for planner in planners:
            for rank, size in enumerate(context_sizes):
                jobs.append(_write_job(root, condition, planner, size, rank, members, epochs, steps))
    return jobs


def write_growth(root: Path, members: int = 6, epochs: Sequence[int] = GROWTH_EPOCHS, size: int = 8) -> Setting:
    """Write the stages of the training whose maps are kept; lower obstacles look less different after each of them."""
    condition = Condition(("three_looks",), "three_looks", "three_looks")
    return _write_job(root, condition, "cem", size, 0, members, epochs[-1], 40, epochs)


def _write_job(
    root: Path,
    condition: Condition,
    planner: str,
    size: int,
    rank: int,
    members: int,
    epochs: int,
    steps: int,
    snapshots: Sequence[int] = (),
) -> Setting:
    """Write the stages of one setting that are not there yet; `rank` is the place of `size` among the context sizes."""
    collected = {
        "training_layouts": [_layout(name) for name in condition.training],
        "vehicle": VEHICLE,
        "data": {"num_sequences": 200},
    }
    trained = collected | {
        "model": {"context_size": size},
        "training": {"num_epochs": epochs, "snapshot_epochs": list(snapshots)},
        "seed": 0,
        "members": members,
    }
    painted = trained | {
        "models": "train",
        "report": {"map_spacing": 0.02, "snapshots": bool(snapshots)},
        "map_layout": _layout(condition.map),
    }
    controlled = trained | {
        "models": "train",
        "lookup": {"spacing": 0.02},
        "planner": {"kind": planner},
        "control": {"num_steps": steps},
        "control_layout": _layout(condition.control),
    }
    folders = {
        "data": _ensure(root, "data", collected, lambda folder: _coverage(folder, len(condition.training))),
        "train": _ensure(
            root, "train", trained, lambda folder: _validation(folder, condition.training, size, members, epochs)
        ),
        "predict": _ensure(
            root, "predict", painted, lambda folder: _predictions(folder, condition, size, members, epochs)
        ),
        "map": _ensure(root, "map", painted, lambda folder: _maps(folder, condition.map, size, members, snapshots)),
        "control": _ensure(
            root,
            "control",
            controlled,
            lambda folder: _control(folder, condition.control, size, rank, planner, members, steps),
        ),
    }
    values = {"model.context_size": size, "planner": planner, "control_layout": condition.control}
    return Setting(values, folders)


def with_blocks(root: Path, setting: Setting, blocks: Blocks, shares: pd.DataFrame) -> Setting:
    """The setting with the stage of the effects of blocks, written from these numbers."""
    config = {"values": {**setting.values}}
    folders = _ensure(root, "blocks", config, lambda folder: files.write_blocks(folder, blocks, shares))
    return Setting(setting.values, {**setting.folders, "blocks": folders})


def _ensure(root: Path, stage: str, config: dict[str, Any], write: Callable[[Path], None]) -> tuple[Path]:
    """The folder of a stage, named by its configuration; written where it is missing."""
    digest = hashlib.sha256(json.dumps([stage, config], sort_keys=True).encode()).hexdigest()[:12]
    folder = root / stage / digest
    if folder.exists():
        return (folder,)
    folder.mkdir(parents=True)
    provenance = {
        "stage": stage,
        "digest": digest,
        "config": config,
        "versions": {"affmap": "0.1.0", "torch": "2.13.0", "numpy": "2.4.6"},
        "git": "0123abc",
        "machine": {"cores": 2, "system": "Linux 6.1 x86_64", "python": "3.11.9"},
        "command": "affmap experiment=exp1",
        "seconds": 12.5,
        "started": "2026-11-22T11:00:00",
        "peak_memory_mib": 700.0,
    }
    (folder / "provenance.json").write_text(json.dumps(provenance))
    write(folder)
    return (folder,)


@cache
def _layout(name: str) -> dict[str, Any]:
    return yaml.safe_load((LAYOUTS / f"{name}.yaml").read_text("utf-8"))


def load_world(name: str) -> Layout:
    return Layout.model_validate(_layout(name))


def make_world(*circles: tuple[float, float, float, str], name: str = "mine") -> Layout:
    """A layout of circles: x, y, radius (u) and effect."""
    return Layout(
        name=name,
        size=(3.0, 2.0),
        channels=("solid",),
        border_channel="solid",
        start_margin=0.1,
        start_side=0.2,
        circles=tuple(Circle(center=(x, y), radius=r, effect=effect, channel="solid") for x, y, r, effect in circles),
    )


def _coverage(folder: Path, num_worlds: int) -> None:
    rng = np.random.default_rng(1)
    free = np.ones((num_worlds, 20, 30), dtype=bool)
    free[:, [0, -1]] = free[:, :, [0, -1]] = False
    counts = np.where(free, rng.geometric(0.01, size=free.shape), 0)
    counts[:, 5, 4] = 0
    share = [(visits > 0)[open_].mean() for visits, open_ in zip(counts, free, strict=True)]
    parts = zip(counts, free, np.array(share), strict=True)
    files.write_coverage(folder, [dict(zip(("counts", "free", "coverage"), part, strict=True)) for part in parts])


def _validation(folder: Path, layouts: Sequence[str], size: int, members: int, epochs: int) -> None:
    rng = np.random.default_rng([2, size, *"".join(layouts).encode()])
    epoch = np.arange(1, epochs + 1)
    final = -7.6 - 0.5 * np.sqrt(size) + rng.normal(0, 0.15, size=(members, 1))
    losses = final + 4.0 * np.exp(-epoch / 4) + rng.normal(0, 0.1, size=(members, epochs))
    rows = {
        "member": np.repeat(np.arange(members), epochs),
        "epoch": np.tile(epoch, members),
        "training_nll": losses.ravel() - 0.1,
        "validation_nll": losses.ravel(),
    }
    files.write_validation(folder, pd.DataFrame(rows))


def _predictions(folder: Path, condition: Condition, size: int, members: int, epochs: int) -> None:
    """Losses by kind of step after the first epoch and the last; fog is taken to be 0.05 u wider than it is."""
    rows = []
    for world in [*condition.training, files.EVERYWHERE]:
        fog = "fog" in "".join(condition.training if world == files.EVERYWHERE else [world])
        for kind in files.KINDS if fog else ("free", "touching"):
            level = -8.0 - 0.3 * size if kind in ("free", "touching") else 3.0 + files.KINDS.index(kind)
            for member in range(members):
                for epoch in (1, epochs):
                    now = level + 1.0 / epoch + 0.1 * member
                    rows.append((member, epoch, world, kind, 100, now + 1.0, now))
    files.write_steps(folder, pd.DataFrame(rows, columns=files.STEP_COLUMNS).drop_duplicates())
    layout = load_world(condition.map)
    nodes = np.stack(np.meshgrid(X, Y), axis=-1)
    uncertain = fog_distance(nodes, layout, VEHICLE["radius"]) <= 0.05
    std = np.where(uncertain, 0.5, 0.001)[None, ..., None] * np.ones((members, 1, 1, 2))
    files.write_deviations(folder, Deviations(std, X, Y, np.arange(members)))


def _maps(folder: Path, layout: str, size: int, members: int, snapshots: Sequence[int]) -> None:
    """Codes are the same wherever the same effects are; in a snapshot also the lower obstacles' looks count."""
    codes = np.stack([_codes(layout, size, member) for member in range(members)])
    kept = [[_codes(layout, size, member, looks=1 / epoch) for member in range(members)] for epoch in snapshots]
    untrained = np.random.default_rng(5).normal(size=codes.shape)  # codes that say nothing of the place
    maps = Maps(
        codes=codes,
        initial_codes=untrained.astype(np.float32),
        snapshot_codes=np.array(kept, np.float32).reshape(len(snapshots), *codes.shape),
        epochs=np.array(snapshots, int),
        x=X,
        y=Y,
        member=np.arange(members),
    )
    files.write_maps(folder, maps)


def _codes(layout: str, size: int, member: int, looks: float = 0.0) -> np.ndarray:
    """`[Y, X, C]`: a random mixture of what is in a view, as a CNN might compute."""
    weights = np.random.default_rng([3, size, member]).normal(size=(len(KINDS) + 1, 3, size)) * ((2,), (6,), (6,))
    weights[-1] *= looks
    return np.tanh(np.einsum("yxkm,kmc->yxc", _moments(layout), weights)).astype(np.float32)


@cache
def _moments(layout: str) -> np.ndarray:
    """`[Y, X, 5, 3]`: of each kind, and of lower obstacles, the share of the view and the first moments."""
    pixel = (np.arange(11) - 5) * 0.5 / 11
    view_x = (X[:, None] + pixel)[None, :, None, :]
    view_y = (Y[:, None] + pixel)[:, None, :, None]
    seen = np.zeros((len(KINDS) + 1, len(Y), len(X), 11, 11), dtype=bool)
    seen[0] = (view_x < 0) | (view_x > 3) | (view_y < 0) | (view_y > 2)
    for circle in _layout(layout)["circles"]:
        inside = np.hypot(view_x - circle["center"][0], view_y - circle["center"][1]) <= circle["radius"]
        kind = {"obstacle": "solid"}.get(circle["effect"], circle["effect"])
        if kind in KINDS:
            seen[KINDS.index(kind)] |= inside
        if circle["channel"] == "lower":
            seen[-1] |= inside
    scaled = pixel / pixel[-1]
    parts = [seen.mean((-2, -1)), (seen * scaled).mean((-2, -1)), (seen * scaled[:, None]).mean((-2, -1))]
    return np.stack(parts, axis=-1).transpose(1, 2, 0, 3)


def _control(folder: Path, layout: str, size: int, rank: int, planner: str, members: int, steps: int) -> None:
    rng = np.random.default_rng([4, size, planner == "cem", *layout.encode()])
    count = members * NUM_RUNS
    member, run = np.repeat(np.arange(members), NUM_RUNS), np.tile(np.arange(NUM_RUNS), members)
    corners = np.array([(0.2, 0.2), (2.8, 0.2), (0.2, 1.8), (2.8, 1.8)])
    start, goal = corners[run], corners[::-1][run]
    distance = 1.15 - 0.25 * np.sqrt(size) if planner == "cem" else 0.9 + 0.02 * size
    distance += FARTHER.get(layout, 0.0)
    reached, fog = _outcomes(layout, rank, member, run, rng)
    hard = layout == "procedural_hard"
    setting = {"layout": layout, "planner": planner, "lookup_spacing": 0.02, "context_size": size}
    table = pd.DataFrame({"member": member, "run": run})
    table[["start_x", "start_y"]], table[["goal_x", "goal_y"]] = start, goal
    table["prediction_error"] = -8.0 + 1.5 * hard - 0.6 * np.sqrt(size) + rng.normal(0, 0.3, count)
    table["mean_distance"] = distance + rng.gamma(2.0, 0.02, count)
    table["reached"] = reached
    table["steps_to_reach"] = pd.array(np.where(reached, rng.integers(steps // 2, steps, count), 0), "Int64")
    table.loc[~reached, "steps_to_reach"] = pd.NA
    table["success"] = reached & ~fog
    table["steps_touching"] = rng.poisson(40 / (1 + size), count)
    table["steps_in_fog"] = np.where(fog, 3, 0)
    table["final_spread"] = np.where(reached, 0.3, 0.01)
    files.write_runs(folder, setting, table, [~(hard & (run == 3)), np.full(count, 0.01)])
    files.write_layouts(folder, [Layout.model_validate(_flown(layout, number)) for number in range(count)])
    _trajectories(folder, table, steps)


def _outcomes(
    layout: str, rank: int, member: np.ndarray, run: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Which runs `[B]` reach the goal, and which are in fog.

    Without fog most reach it. In the world of Experiment IV all succeed with a context but the first; in Experiment V
    one more of a member's runs succeeds with each context size, and in the easy world one more than in the hard one.
    """
    if layout in ("original", "two_obstacles", "twelve_obstacles", "three_looks"):
        return rng.random(len(run)) < (0.75 if rank == 0 else 0.97), np.zeros(len(run), dtype=bool)
    if layout == "fog":
        success = (run > 0) | ((member > 0) & (rank > 0))
    else:
        success = run < (min(2 + rank, 4) if layout == "procedural_easy" else min(1 + rank, 3))
    fog = ~success & (run % 2 == 1)
    return success | fog, fog


def _flown(layout: str, number: int) -> dict[str, Any]:
    """The layout of a run: the fixed one, or one with a circle of each property at random places."""
    settings = _layout(layout)
    if "circles" in settings:
        return settings
    rng = np.random.default_rng([6, number, *layout.encode()])
    circles = [
        {"center": rng.uniform((0.7, 0.7), (2.3, 1.3)).tolist(), "radius": float(rng.uniform(0.1, 0.3)), **kind}
        for kind in ({key: p[key] for key in ("effect", "channel")} for p in settings["properties"])
    ]
    keys = ("name", "size", "channels", "border_channel", "start_margin", "start_side")
    return {key: settings[key] for key in keys} | {"circles": circles}


def _trajectories(folder: Path, table: pd.DataFrame, steps: int) -> None:
    """Bent paths from starts to goals, with the plans that foresaw them."""
    start, goal = table[["start_x", "start_y"]].to_numpy(), table[["goal_x", "goal_y"]].to_numpy()
    time = np.linspace(0, 1, steps + HORIZON + 1)[None, :, None]
    bend = np.stack([np.zeros_like(time[..., 0]), 0.25 * np.sin(4 * np.pi * time[..., 0])], axis=-1)
    path = start[:, None] + (goal - start)[:, None] * np.minimum(1, 1.6 * time) + bend  # [B, T + H + 1, 2]
    plans = np.stack([path[:, t + 1 : t + 1 + HORIZON] for t in range(steps)], axis=1)
    deviation = np.broadcast_to(0.02 * np.sqrt(np.arange(1, HORIZON + 1))[:, None], plans.shape)
    arrival = table["steps_to_reach"].fillna(steps + 1).to_numpy(int)
    paths = Trajectories(
        position=path[:, : steps + 1].astype(np.float32),
        goal=goal,
        planned_position=plans.astype(np.float32),
        planned_std=deviation.astype(np.float32),
        prediction_error=np.tile(table["prediction_error"].to_numpy()[:, None], (1, steps)),
        action=np.zeros((len(table), steps, 4), np.float32),
        touching=np.arange(steps) < table["steps_touching"].to_numpy()[:, None],
        in_fog=np.arange(steps) < table["steps_in_fog"].to_numpy()[:, None],
        reached=np.arange(1, steps + 1) >= arrival[:, None],
        member=table["member"].to_numpy(),
        run=table["run"].to_numpy(),
    )
    files.write_trajectories(folder, paths._asdict())
