"""Affordance maps and active inference in simulated agents.

Importing it registers the environment `affmap/Vehicle-v0` with Gymnasium.
"""

from affmap.env import Circle, Layout, Vehicle, VehicleEnv

__all__ = ["Circle", "Layout", "Vehicle", "VehicleEnv"]
