"""Exploration -> data set: fly at random, record sensors and actions.

Knows the environment; knows no models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from affmap.data.settings import Exploration as Exploration
from affmap.env.body import Vehicle
from affmap.env.geometry import CELL
from affmap.env.layout import Layout
from affmap.env.vehicle import VehicleEnv
from affmap.random import generator, integer
from affmap.store.files import read_arrays

DATASET = "dataset.npz"
"""File of a stage that holds a data set."""


def collect(
    layouts: Sequence[Layout],
    vehicle: Vehicle,
    exploration: Exploration,
    on_sequence: Callable[[int], None] = lambda sequence: None,
) -> dict[str, np.ndarray]:
    """Explore layouts at random (Appendix A): the arrays of a data set.

    Every sequence starts at rest at a free place drawn uniformly, and has random streams of its own. `on_sequence`
    is called with the number of each finished sequence. S sequences, layout by layout; T steps; lengths in u:

    | array | shape | meaning |
    |---|---|---|
    | `position` | `[S, T + 1, 2]` | reported positions |
    | `true_position` | `[S, T + 1, 2]` | true positions |
    | `view` | `[S, T, K, 11, 11]` bool | view before each step |
    | `action` | `[S, T, 4]` | throttles of each step, in [0, 1] |
    | `touching` | `[S, T]` bool | an obstacle or a border is touched after the step |
    """
    envs = [VehicleEnv(layout, vehicle, views=False) for layout in layouts for _ in range(exploration.num_sequences)]
    sequences = []
    for sequence, env in enumerate(envs):
        rng = generator(exploration.seed, "exploration", sequence)
        layout = env.layout
        options = {"position": free_position(layout, vehicle, rng, exploration.start == "clear")}
        observation, info = env.reset(seed=integer(exploration.seed, "world", sequence), options=options)
        record: dict[str, list[np.ndarray]] = {
            "position": [observation["position"]],
            "true_position": [info["position"]],
            "action": random_actions(exploration, rng),
            "touching": [],
        }
        for action in record["action"]:
            observation, _, _, _, info = env.step(action)
            record["position"].append(observation["position"])
            record["true_position"].append(info["position"])
            record["touching"].append(info["touching"])
        arrays = {key: np.array(values) for key, values in record.items()}
        arrays["view"] = layout.views(arrays["true_position"][:-1])  # all at once, which is much faster
        sequences.append(arrays | {"true_position": arrays["true_position"].astype(np.float32)})
        on_sequence(sequence)
    return {key: np.array([arrays[key] for arrays in sequences]) for key in sequences[0]}


def random_actions(exploration: Exploration, rng: np.random.Generator) -> list[np.ndarray]:
    """T actions `[4]`, each held for a few steps: half of them gentle, half all-or-nothing."""
    actions: list[np.ndarray] = []
    while len(actions) < exploration.num_steps:
        action = rng.uniform(size=4)
        if rng.uniform() < exploration.binary_share:
            action = action.round()
        hold = rng.integers(1, exploration.max_hold + 1)
        actions += [action.astype(np.float32)] * int(hold)
    return actions[: exploration.num_steps]


def free_position(layout: Layout, vehicle: Vehicle, rng: np.random.Generator, is_clear: bool = False) -> np.ndarray:
    """Draw a place for the vehicle, `[2]` in u, uniformly over all free places; or those outside fog, if `is_clear`.

    Raises:
        ValueError: ten thousand draws found none.
    """
    positions = rng.uniform(0, layout.size, (10_000, 2))
    free = positions[layout.is_free(positions, vehicle.radius)]
    if is_clear:
        free = free[~layout.in_fog(free, vehicle.radius)]
    if len(free) == 0:
        raise ValueError(
            f"layout {layout.name!r} has no free place{' outside fog' if is_clear else ''} for a vehicle of radius "
            f"{vehicle.radius} u; make its obstacles{' and its fog' if is_clear else ''} fewer or smaller."
        )
    return free[0]


def coverage(layout: Layout, vehicle: Vehicle, positions: np.ndarray, cell: float = CELL) -> dict[str, np.ndarray]:
    """The coverage of a layout by `positions` `[..., 2]` (u).

    Returns:
        `counts` `[Y, X]`, visits of each square of side `cell` (u); `free` `[Y, X]` bool, whether the vehicle can be
        at its centre; `coverage`, the share of free squares that were visited. Row 0 is at y = 0.
    """
    columns, rows = (round(length / cell) for length in layout.size)
    edges = [np.linspace(0, length, number + 1) for length, number in zip(layout.size, (columns, rows), strict=True)]
    x, y = positions.reshape(-1, 2).T
    counts = np.histogram2d(y, x, bins=(edges[1], edges[0]))[0].astype(np.int64)
    centers = np.stack(np.meshgrid(*[(edge[1:] + edge[:-1]) / 2 for edge in edges]), axis=-1)
    free = layout.is_free(centers, vehicle.radius)
    return {"counts": counts, "free": free, "coverage": np.array((counts[free] > 0).mean())}


def write_dataset(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a data set."""
    np.savez_compressed(folder / DATASET, allow_pickle=False, **arrays)


def read_dataset(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of the data set at `path`.

    Raises:
        ConfigError: the file is corrupted.
    """
    return read_arrays(path)
