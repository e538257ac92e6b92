"""Position -> context code: the look-up map of the paper, exact or painted beforehand as an affordance map.

Positions outside the arena are looked up at the nearest point inside it. Knows a stack and a map of the world;
knows nothing of motion, planners or goals.
"""

import math
from typing import Protocol, Self

import torch
from pydantic import NonNegativeFloat, model_validator
from torch import Tensor
from torch.nn.functional import grid_sample

from affmap.model.codes import ViewCodes
from affmap.model.stack import Stack
from affmap.model.windows import take_apart
from affmap.settings import Settings
from affmap.view import Map, view


class LookupSettings(Settings):
    """Where planners take context codes from (`conf/lookup`)."""

    spacing: NonNegativeFloat
    """Largest distance between neighbouring nodes of the affordance map, u; 0: no map, codes from the view at every
    position, as in the paper."""
    differentiable: bool
    """Whether gradients flow through the map to the position; the paper's do not."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.differentiable and self.spacing == 0:
            raise ValueError("differentiable = True needs an affordance map: lookup.spacing must be greater than 0.")
        return self

    @property
    def name(self) -> str:
        """What tells it from others, in words."""
        return f"map of {self.spacing:g} u" if self.spacing else "exact look-ups"


class Lookup(Protocol):
    """Position -> context code, for a stack in one world."""

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        ...


def make_lookup(settings: LookupSettings, stack: Stack, world: Map) -> "ExactLookup | AffordanceMap":
    """The look-up that `settings` describe, for `stack` in `world`."""
    if settings.spacing == 0:
        return ExactLookup(stack, world)
    return AffordanceMap.paint(stack, world, settings.spacing, settings.differentiable)


def inside(positions: Tensor, size: Tensor) -> Tensor:
    """The points of an arena of `size` `[2]` nearest to `positions` `[..., 2]`."""
    return positions.clamp_min(0).minimum(size)


class ExactLookup:
    """Cuts out the view at each position and takes the vision model's code of it."""

    def __init__(self, stack: Stack, world: Map) -> None:
        """Look up codes of `stack` in `world`."""
        self._codes, self._world = ViewCodes(stack), world

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        return self._codes(view(self._world, inside(positions, positions.new_tensor(self._world.size))))


def lookup_error(lookup: Lookup, exact: ExactLookup, positions: Tensor) -> Tensor:
    """Distance between the codes of two look-ups at `positions` `[M, ..., 2]` (u): `[M, ...]`, mean over components."""
    return (lookup(positions) - exact(positions)).abs().mean(-1)


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
        self._picture = codes.permute(0, 3, 1, 2)
        self._scale = 2 / codes.new_tensor(world.size)
        self._lower = codes.new_tensor(-1.0)

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
        # The arena becomes the square from -1 to 1.
        grid = torch.addcmul(self._lower, positions.flatten(1, -2), self._scale)[:, None]  # [M, 1, P, 2]
        codes = grid_sample(self._picture, grid, padding_mode="border", align_corners=True)  # [M, C, 1, P]
        return codes[:, :, 0].mT.unflatten(1, positions.shape[1:-1])
