"""Runs along straight lines, and maps and stacks of untrained members."""

from typing import Any

import numpy as np

from affmap.control.episodes import Runs
from affmap.control.settings import ControlSettings
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap
from affmap.model.settings import ModelSettings
from affmap.model.stack import Stack
from affmap.planning.cem import CEMPlanner
from affmap.view import VisibleLayout

ORIGINAL, TWO = (Layout.load("layout", name) for name in ("original", "two_obstacles"))
VEHICLE = Vehicle.load("vehicle", "default")
PLANNER, SETTINGS = CEMPlanner.load("planner", "cem"), ControlSettings.load("control", "default")


def make_stack(context_size: int, seeds: tuple[int, ...] = (0, 1)) -> Stack:
    return Stack(ModelSettings.load("model", "default", context_size=context_size), 1, seeds)


def make_map(context_size: int = 3, worlds: tuple[VisibleLayout, ...] = (ORIGINAL.map,)) -> AffordanceMap:
    return AffordanceMap.paint(make_stack(context_size), worlds, spacing=0.25)


def make_runs(layouts: list[Layout]) -> Runs:
    """Straight runs of two steps, from (0.2, 0.2) to the right; run 1 starts 0.1 u higher, and so on."""
    count, number = len(layouts), np.arange(len(layouts))
    start = np.stack([np.full(count, 0.2), 0.2 + 0.1 * number], axis=-1)
    position = start[:, None] + np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])
    plans = position[:, :2, None] + np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]])  # [B, T, H, 2]
    never = np.zeros((count, 2), bool)
    trajectories: dict[str, Any] = {
        "position": position,
        "goal": start + np.array([2.5, 0.0]),
        "planned_position": plans,
        "planned_std": np.broadcast_to([[0.01, 0.02], [0.02, 0.04], [0.03, 0.06]], plans.shape),
        "action": np.zeros((count, 2, 4)),
        "prediction_error": np.zeros((count, 2)),
        **dict.fromkeys(("touching", "in_fog", "reached"), never),
        "member": np.zeros(count, int),
        "run": number,
    }
    return Runs(trajectories, layouts, VEHICLE)
