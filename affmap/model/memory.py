"""A memorised map: a small network position -> context code, learned from places where the agent itself was.

Units have bell-shaped activations around the nodes of a grid, and their outputs are linear, so that learning is least
squares: in one go from exploration, and recursively in flight. Between and beyond the places that were seen, the
network goes on smoothly. Imagined paths need that: they touch obstacles, where no agent has ever been.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from affmap.model.lookup import node_axes
from affmap.model.settings import MemorySettings as MemorySettings

_AT_ONCE = 4096  # places whose activations are in memory at a time


class Memory(NamedTuple):
    """Weights of B networks of U units, and how surely each is known."""

    weights: Tensor
    """`[B, U, C]`, from units to components of a code."""
    covariance: Tensor
    """`[B, U, U]`, of the weights of a component, the same for all."""

    def repeated(self, times: int) -> Memory:
        """Each network several times, side by side: `times` x B of them."""
        return Memory(*(part.repeat_interleave(times, 0) for part in self))


class PlaceNetwork:
    """The units over an arena, and what can be done with weights on them."""

    def __init__(self, size: tuple[float, float], settings: MemorySettings) -> None:
        """Put units on a grid over an arena of `size` (u), one row of them outside each border."""
        margin, self.settings, self.size = settings.unit_spacing, settings, size
        grown = size[0] + 2 * margin, size[1] + 2 * margin
        self._x, self._y = (axis - margin for axis in node_axes(grown, settings.unit_spacing))

    @property
    def num_units(self) -> int:
        """U, number of units."""
        return len(self._x) * len(self._y)

    def activations(self, positions: Tensor) -> Tensor:
        """Activations of all units at `positions` `[..., 2]` (u): `[..., U]`, between 0 and 1."""
        x, y = self._along(positions[..., 0], self._x), self._along(positions[..., 1], self._y)
        return (y[..., :, None] * x[..., None, :]).flatten(-2)

    def _along(self, coordinates: Tensor, centers: Tensor) -> Tensor:
        """Activations along an axis, whose product is that of a unit: `[..., number of centers]`."""
        distance = (coordinates[..., None] - centers.to(coordinates)) / self.settings.unit_width
        return (-0.5 * distance.square()).exp()

    def empty(self, num_members: int, context_size: int) -> Memory:
        """Memories of nothing, with codes of zeros."""
        return self._begun(torch.zeros(num_members, self.num_units, context_size))

    def explored(self, positions: Tensor, codes: Tensor) -> Memory:
        """Memories of M members after exploration, by ridge regression; how surely is then forgotten.

        A world may change after it was explored: so a flight trusts all weights alike when it begins.

        Args:
            positions: `[N, 2]`, where all of them were, u.
            codes: `[M, N, C]`, seen there by each.
        """
        num_members, number, size = codes.shape
        targets = codes.transpose(0, 1).flatten(1)  # [N, M * C]
        square = self.settings.ridge * torch.eye(self.num_units, dtype=torch.float64)
        product = torch.zeros(self.num_units, targets.shape[1], dtype=torch.float64)
        for places, seen in zip(positions.split(_AT_ONCE), targets.split(_AT_ONCE), strict=True):
            active = self.activations(places.double())
            square += active.mT @ active / number
            product += active.mT @ seen.double() / number
        weights = torch.linalg.solve(square, product).view(-1, num_members, size).transpose(0, 1)
        return self._begun(weights.float().contiguous())

    def _begun(self, weights: Tensor) -> Memory:
        return Memory(weights, torch.eye(self.num_units).repeat(len(weights), 1, 1))

    def recalled(self, memory: Memory, positions: Tensor) -> Tensor:
        """Codes that B networks remember at `positions` `[B, N, 2]` (u): `[B, N, C]`."""
        return self.activations(positions) @ memory.weights

    def learned(self, memory: Memory, positions: Tensor, codes: Tensor) -> Memory:
        """The memory after a step of recursive least squares.

        After any number of steps the weights are those that least change what was remembered when the flight began,
        and least miss what was seen since.

        Args:
            memory: that of B networks.
            positions: `[B, 2]`, where they are, u.
            codes: `[B, C]`, seen there.
        """
        active = self.activations(positions)[..., None]  # [B, U, 1]
        shared = memory.covariance @ active
        gain = shared / (self.settings.noise + active.mT @ shared)
        surprise = codes[:, None] - active.mT @ memory.weights  # [B, 1, C]
        covariance = torch.baddbmm(memory.covariance, gain, shared.mT, alpha=-1)
        return Memory(memory.weights + gain @ surprise, covariance)

    def painted(self, memory: Memory, spacing: float) -> Tensor:
        """Codes that B networks remember at the nodes of a map, at most `spacing` (u) apart: `[B, Y, X, C]`."""
        x, y = node_axes(self.size, spacing)
        along_x, along_y = self._along(x, self._x), self._along(y, self._y)
        weights = memory.weights.unflatten(1, (len(self._y), len(self._x)))
        columns = weights.mT @ along_x.mT  # [B, units along y, C, X], an axis at a time
        return (along_y @ columns.mT.flatten(2)).unflatten(-1, (len(x), -1))
