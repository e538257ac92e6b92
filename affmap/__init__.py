"""Affordance maps and active inference in simulated agents.

Importing it makes the environments known to Gymnasium (`affmap/Vehicle-v0` and one for each layout), whichever of the
two is imported first. All else is imported on first use.
"""

import os
from typing import TYPE_CHECKING

from affmap.env.registration import register_when_needed
from affmap.lazy import on_first_use

if TYPE_CHECKING:
    from affmap.control.agent import Agent
    from affmap.control.episodes import fly
    from affmap.control.pilot import Pilot
    from affmap.env.layout import Circle, Layout
    from affmap.env.physics import Vehicle
    from affmap.env.procedural import Procedural
    from affmap.env.vehicle import VehicleEnv
    from affmap.loading import load
    from affmap.model.lookup import AffordanceMap, ExactLookup
    from affmap.model.stack import Stack
    from affmap.model.transition import TransitionModel
    from affmap.model.world import rollout
    from affmap.planning.cem import CEMPlanner
    from affmap.planning.gradient import GradientPlanner
    from affmap.planning.objective import expected_free_energy

__all__ = [
    "AffordanceMap",
    "Agent",
    "CEMPlanner",
    "Circle",
    "ExactLookup",
    "GradientPlanner",
    "Layout",
    "Pilot",
    "Procedural",
    "Stack",
    "TransitionModel",
    "Vehicle",
    "VehicleEnv",
    "expected_free_energy",
    "fly",
    "load",
    "rollout",
]

__getattr__, __dir__ = on_first_use(
    __name__,
    {
        "AffordanceMap": "affmap.model.lookup",
        "Agent": "affmap.control.agent",
        "CEMPlanner": "affmap.planning.cem",
        "Circle": "affmap.env.layout",
        "ExactLookup": "affmap.model.lookup",
        "GradientPlanner": "affmap.planning.gradient",
        "Layout": "affmap.env.layout",
        "Pilot": "affmap.control.pilot",
        "Procedural": "affmap.env.procedural",
        "Stack": "affmap.model.stack",
        "TransitionModel": "affmap.model.transition",
        "Vehicle": "affmap.env.physics",
        "VehicleEnv": "affmap.env.vehicle",
        "expected_free_energy": "affmap.planning.objective",
        "fly": "affmap.control.episodes",
        "load": "affmap.loading",
        "rollout": "affmap.model.world",
    },
)

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it would head the output of every command
register_when_needed()
