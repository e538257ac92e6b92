"""What completed stages hold, as types: settings, worlds, maps, exploration, trajectories. Reads and draws nothing.

Axes: M members, T recorded steps, B = M x 4 runs, H planning horizon, C context code, Y and X rows and columns of a
grid (row 0 has the smallest y). Lengths are in units (u), times in steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from affmap.view import Map

PLANNERS = {"cem": "EB", "gradient": "GB"}
"""The paper's short names: evolutionary-based and gradient-based active inference. Others keep their own."""

STAGES = ("data", "train", "map", "control")

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class Job:
    """One setting of the sweep, and the folders of its completed stages.

    There is one of each kind, or one for each of the jobs that its members were divided among, in the members' order.
    """

    context_size: int
    planner: str
    """Its kind, such as `cem` (evolutionary, EB) or `gradient` (GB)."""
    layout: str
    """Name of the layout that was flown in."""
    data: tuple[Path, ...]
    train: tuple[Path, ...]
    map: tuple[Path, ...]
    control: tuple[Path, ...]


class Circle(NamedTuple):
    """A circle of a world; lengths in u."""

    x: float
    y: float
    radius: float
    effect: str
    """A key of `affmap.env.effects.EFFECTS`."""


@dataclass(frozen=True)
class World:
    """A layout; lengths in u, the lower left corner is the origin."""

    name: str
    size: tuple[float, float]
    circles: tuple[Circle, ...]
    start_margin: float
    """Distance of the four start squares to the borders."""
    start_side: float
    """Side of a start square."""
    vehicle_radius: float

    @classmethod
    def of(cls, layout: Mapping[str, Any], vehicle: Mapping[str, Any]) -> "World":
        """The world of a layout and a vehicle, as a stage's configuration has them."""
        return cls(
            name=layout["name"],
            size=(float(layout["size"][0]), float(layout["size"][1])),
            circles=tuple(Circle(c["center"][0], c["center"][1], c["radius"], c["effect"]) for c in layout["circles"]),
            start_margin=float(layout["start_margin"]),
            start_side=float(layout["start_side"]),
            vehicle_radius=float(vehicle["radius"]),
        )

    @property
    def obstacles(self) -> tuple[Circle, ...]:
        """The circles that block the way."""
        return tuple(circle for circle in self.circles if circle.effect == "obstacle")


class Sight(NamedTuple):
    """What a layout looks like to the vehicle."""

    channels: tuple[str, ...]
    """Names of the K channels of a view."""
    map: Map
    """What views are cut from."""

    @classmethod
    def of(cls, layout: Mapping[str, Any]) -> "Sight":
        """The looks of a layout, as a stage has it."""
        channels = tuple(layout["channels"])
        circles = tuple((*c["center"], c["radius"], channels.index(c["channel"])) for c in layout["circles"])
        border = channels.index(layout["border_channel"])
        return cls(channels, Map(tuple(layout["size"]), len(channels), border, circles))


class Maps(NamedTuple):
    """Affordance maps of all members of one training."""

    codes: Floats
    """`[M, Y, X, C]` context codes at the nodes."""
    initial_codes: Floats
    """`[M, Y, X, C]`, the same before training."""
    snapshot_codes: Floats
    """`[E, M, Y, X, C]`, the same after E epochs of the training, the last one included; E is 0 where none was kept."""
    epochs: NDArray[np.integer]
    """`[E]`, numbers of those epochs."""
    x: Floats
    """`[X]` in u."""
    y: Floats
    """`[Y]` in u."""
    member: NDArray[np.integer]
    """`[M]`."""

    @property
    def untrained(self) -> "Maps":
        """The maps of the same members before training."""
        return self._replace(codes=self.initial_codes)

    @property
    def snapshots(self) -> dict[int, "Maps"]:
        """Epoch -> the maps of the same members after it."""
        return {int(e): self._replace(codes=codes) for e, codes in zip(self.epochs, self.snapshot_codes, strict=True)}

    @property
    def nodes(self) -> Floats:
        """`[Y, X, 2]` positions of the nodes, u."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)


class Exploration(NamedTuple):
    """Where the data set has been, in each of W training worlds."""

    counts: NDArray[np.integer]
    """`[W, Y, X]` recorded steps in each cell of 0.1 u."""
    free: NDArray[np.bool_]
    """`[W, Y, X]`: can the vehicle's centre be at the cell's centre?"""
    coverage: Floats
    """`[W]`, share of the free cells that were visited."""


class Trajectories(NamedTuple):
    """What control recorded; absolute positions in u."""

    position: Floats
    """`[B, T + 1, 2]`."""
    goal: Floats
    """`[B, 2]`."""
    planned_position: Floats
    """`[B, T, H, 2]` mean of the predicted positions at each step."""
    planned_std: Floats
    """`[B, T, H, 2]` standard deviation of the predicted positions (accumulated over the horizon)."""
    action: Floats
    """`[B, T, 4]` opening of the throttles during the step, 0 to 1."""
    prediction_error: Floats
    """`[B, T]` negative log-likelihood of the change of position in the step, nats."""
    touching: NDArray[np.bool_]
    """`[B, T]`: did the vehicle touch a surface at the end of the step?"""
    in_fog: NDArray[np.bool_]
    """`[B, T]`: did the vehicle overlap fog at the end of the step?"""
    reached: NDArray[np.bool_]
    """`[B, T]`: was it at the goal then?"""
    member: NDArray[np.integer]
    """`[B]`."""
    run: NDArray[np.integer]
    """`[B]`."""
