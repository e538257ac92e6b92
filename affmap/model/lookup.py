"""Position -> context code: the look-up map of the paper, exact or painted beforehand as an affordance map.

Positions outside the arena are looked up at the nearest point inside it. Knows a stack and a map of the world;
knows nothing of motion, planners or goals.
"""

import math
from typing import Literal, Protocol

import torch
from pydantic import PositiveFloat
from torch import Tensor
from torch.nn.functional import embedding

from affmap.model.stack import Stack
from affmap.model.windows import take_apart
from affmap.settings import Settings
from affmap.view import Map, view


class ExactSettings(Settings):
    """Planners look at every position itself (`conf/lookup/exact.yaml`)."""

    kind: Literal["exact"]


class MapSettings(Settings):
    """Planners look at an affordance map (`conf/lookup/map.yaml`)."""

    kind: Literal["map"]
    spacing: PositiveFloat
    """Largest distance between neighbouring nodes, u."""
    differentiable: bool
    """Whether gradients flow through the look-up to the position; the paper's do not."""


class Lookup(Protocol):
    """Position -> context code, for a stack in one world."""

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        ...


def make_lookup(settings: ExactSettings | MapSettings, stack: Stack, world: Map) -> Lookup:
    """The look-up that `settings` describe, for `stack` in `world`."""
    if isinstance(settings, ExactSettings):
        return ExactLookup(stack, world)
    return AffordanceMap.paint(stack, world, settings.spacing, settings.differentiable)


def inside(positions: Tensor, size: Tensor) -> Tensor:
    """The points of an arena of `size` `[2]` nearest to `positions` `[..., 2]`."""
    return positions.clamp_min(0).minimum(size)


class ExactLookup:
    """Cuts out the view at each position and runs the vision model on it."""

    def __init__(self, stack: Stack, world: Map) -> None:
        """Look up codes of `stack` in `world`."""
        self._stack, self._world = stack, world

    @torch.no_grad()
    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        return self._stack.encode(
            take_apart(view(self._world, inside(positions, positions.new_tensor(self._world.size))))
        )


class AffordanceMap:
    """Context codes on a fine grid over the arena, interpolated bilinearly.

    Attributes:
        codes: `[M, Y, X, C]`, codes at the nodes; row 0 is y = 0, column 0 is x = 0.
        world: the map of the world that it was painted for.
    """

    def __init__(self, codes: Tensor, world: Map, differentiable: bool = False) -> None:
        """Take codes `[M, Y, X, C]` whose outermost nodes lie on the borders of the arena."""
        self.codes, self.world = codes, world
        self._differentiable = differentiable
        num_members, rows, columns, _ = codes.shape
        self._flat = codes.flatten(0, 2)
        self._first = torch.arange(num_members, device=codes.device) * rows * columns
        last = codes.new_tensor([columns - 1, rows - 1])
        self._size = codes.new_tensor(world.size)
        self._nodes_per_unit = last / self._size
        self._last_cell = last - 1

    @classmethod
    @torch.no_grad()
    def paint(cls, stack: Stack, world: Map, spacing: float, differentiable: bool = False) -> "AffordanceMap":
        """Compute the codes of all members at nodes at most `spacing` (u) apart, by exact look-ups."""
        # As many equal parts as it takes, whatever rounding made of a quotient that should be a whole number.
        parts = [max(1, math.ceil(length / spacing - 1e-6)) for length in world.size]
        x, y = (torch.linspace(0, length, num + 1) for length, num in zip(world.size, parts, strict=True))
        device = next(stack.parameters()).device
        rows = []
        for row in y:  # a row at a time bounds the memory
            positions = torch.stack([x, row.expand_as(x)], dim=-1).to(device)
            rows.append(stack.encode(take_apart(view(world, positions)[None])))
        return cls(torch.stack(rows, dim=1), world, differentiable)

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        if not self._differentiable:
            positions = positions.detach()
        columns = self.codes.shape[2]
        place = inside(positions, self._size) * self._nodes_per_unit
        cell = place.detach().floor().minimum(self._last_cell)
        x, y = (place - cell).unsqueeze(-2).unbind(-1)  # [M, ..., 1] each, in [0, 1]
        column, row = cell.long().unbind(-1)
        node = self._first.view(-1, *[1] * (row.ndim - 1)) + row * columns + column
        # embedding gathers rows several times faster than indexing does.
        lower, right, upper, opposite = (embedding(node + i, self._flat) for i in (0, 1, columns, columns + 1))
        return torch.lerp(torch.lerp(lower, right, x), torch.lerp(upper, opposite, x), y)
