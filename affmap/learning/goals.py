"""Goals of agents that learn online: random places, each of which is followed by another when it has been reached."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from affmap.data.collect import free_position
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.results.files import Floats


class Goals:
    """The goals of A agents in one layout."""

    def __init__(
        self, layout: Layout, vehicle: Vehicle, radius: float, generators: Sequence[np.random.Generator]
    ) -> None:
        """Draw a first goal for each of A agents, where its vehicle can be; they are reached within `radius` (u)."""
        self._layout, self._vehicle, self._radius, self._generators = layout, vehicle, radius, generators
        self.position = np.stack([self._draw(rng) for rng in generators])
        """`[A, 2]`, u."""

    def move_on(self, position: Floats) -> None:
        """Draw new goals for agents that have reached theirs at their true positions `[A, 2]` (u)."""
        near = is_reached(position, self.position, self._radius)
        new = [self._draw(rng) for rng, each in zip(self._generators, near, strict=True) if each]
        if new:
            self.position = self.position.copy()
            self.position[near] = new

    def _draw(self, rng: np.random.Generator) -> Floats:
        return free_position(self._layout, self._vehicle, rng).astype(np.float32)


def is_reached(position: Floats, goal: Floats, radius: float) -> np.ndarray:
    """Whether true positions `[..., 2]` are within `radius` of goals `[..., 2]`, all in u: `[...]`."""
    return np.asarray(np.linalg.norm(position - goal, axis=-1) < radius)
