"""The simulated world: layouts, physics, and the vehicle as Gymnasium environments; each is imported on first use."""

from typing import TYPE_CHECKING

from affmap.lazy import on_first_use

if TYPE_CHECKING:
    from affmap.env.layout import Circle, Layout
    from affmap.env.physics import Vehicle
    from affmap.env.procedural import Procedural
    from affmap.env.registration import register
    from affmap.env.vehicle import VehicleEnv

__all__ = ["Circle", "Layout", "Procedural", "Vehicle", "VehicleEnv", "register"]

__getattr__, __dir__ = on_first_use(
    __name__,
    {
        "Circle": "affmap.env.layout",
        "Layout": "affmap.env.layout",
        "Procedural": "affmap.env.procedural",
        "Vehicle": "affmap.env.physics",
        "VehicleEnv": "affmap.env.vehicle",
        "register": "affmap.env.registration",
    },
)
