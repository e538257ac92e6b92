"""Affordance maps and active inference in simulated agents.

Importing it registers the environment `affmap/Vehicle-v0` with Gymnasium. What needs torch is imported on first use.
"""

from importlib import import_module
from typing import Any

from affmap.env import Circle, Layout, Vehicle, VehicleEnv

_ON_FIRST_USE = {
    "AffordanceMap": "affmap.model.lookup",
    "Agent": "affmap.control.agent",
    "CEMPlanner": "affmap.planning.cem",
    "ExactLookup": "affmap.model.lookup",
    "fly": "affmap.control.episodes",
    "GradientPlanner": "affmap.planning.gradient",
    "load": "affmap.loading",
    "Pilot": "affmap.control.pilot",
    "Stack": "affmap.model.stack",
    "expected_free_energy": "affmap.planning.objective",
    "rollout": "affmap.model.world",
    "TransitionModel": "affmap.model.transition",
}

__all__ = ["Circle", "Layout", "Vehicle", "VehicleEnv", *_ON_FIRST_USE]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'affmap' has no attribute {name!r}")
    return getattr(import_module(_ON_FIRST_USE[name]), name)
