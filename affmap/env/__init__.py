"""The simulated world: layouts, physics, and the vehicle as the Gymnasium environment `affmap/Vehicle-v0`."""

import gymnasium

from affmap.env.layout import Circle, Layout
from affmap.env.physics import Vehicle
from affmap.env.vehicle import VehicleEnv

__all__ = ["Circle", "Layout", "Vehicle", "VehicleEnv", "register"]


def register() -> None:
    """Make the environment known to `gymnasium.make` (also Gymnasium's plugin entry point)."""
    if "affmap/Vehicle-v0" not in gymnasium.registry:
        gymnasium.register("affmap/Vehicle-v0", entry_point="affmap.env.vehicle:VehicleEnv", max_episode_steps=200)


register()
