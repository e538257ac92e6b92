"""Position -> context code: the look-up map of the paper, exact or painted beforehand as an affordance map.

Positions outside the arena are looked up at the nearest point inside it. All agents share one world, or each has its
own: then the worlds are in the order of the problems, member-major. Knows a stack and maps of worlds; knows nothing of
motion, planners or goals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, Self

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from affmap.lazy import notebook
from affmap.model.code_cache import CachedEncoder
from affmap.model.direct import DirectEncoder
from affmap.model.palette import Palette
from affmap.model.settings import LookupSettings as LookupSettings
from affmap.model.stack import Stack
from affmap.model.windows import take_apart
from affmap.settings import ConfigError
from affmap.settings.messages import counted, format_value
from affmap.view import VisibleLayout, view, views


class Lookup(Protocol):
    """Position -> context code, for a stack in one world."""

    worlds: Sequence[VisibleLayout]
    """One shared by all problems, or one for each."""

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        ...

    def elsewhere(self, stack: Stack, worlds: Sequence[VisibleLayout]) -> Lookup:
        """Make a look-up of the same kind for `stack` in another world, or in B others."""
        ...

    def merged(self, other: Self, from_other: Sequence[bool]) -> Lookup:
        """Make a look-up of B worlds of this one and of another of the same members; `from_other` `[B]` says which."""
        ...


def make_lookup(settings: LookupSettings, stack: Stack, worlds: Sequence[VisibleLayout]) -> ExactLookup | AffordanceMap:
    """Make the look-up described by `settings`, for `stack` in one world or in B, one for each problem."""
    if settings.spacing == 0:
        return ExactLookup(stack, worlds)
    return AffordanceMap.paint(stack, worlds, settings.spacing, settings.differentiable)


def _check_worlds(worlds: Any) -> None:
    """Check the worlds of a look-up.

    Raises:
        ConfigError: they are no list of visible layouts, or there is none.
    """
    if not isinstance(worlds, Sequence) or not worlds or not all(isinstance(each, VisibleLayout) for each in worlds):
        raise ConfigError(
            f"worlds = {format_value(worlds)} is not allowed; give a list of the visible parts of layouts, such as "
            "[layout.map]."
        )


def by_world(positions: Tensor, num_worlds: int) -> Tensor:
    """Group positions `[M, ..., 2]` of M members with the same number of worlds each: `[num_worlds, P, 2]`."""
    return positions.reshape(num_worlds, -1, 2)


def inside(positions: Tensor, size: Tensor) -> Tensor:
    """Points of an arena of `size` `[2]` nearest to `positions` `[..., 2]`."""
    return positions.clamp_min(0).minimum(size)


class ExactLookup:
    """Exact look-up: encodes the view at each position with the vision model.

    Attributes:
        worlds: the visible layouts: one shared by all problems, or one for each.
    """

    def __init__(self, stack: Stack, worlds: Sequence[VisibleLayout]) -> None:
        """Look up codes of `stack` in one world, or in B, one for each problem.

        Raises:
            ConfigError: the worlds are no list of visible layouts.
        """
        _check_worlds(worlds)
        self._direct, self._codes, self.worlds = DirectEncoder(stack), CachedEncoder(stack), worlds
        self._stack = stack

    def __repr__(self) -> str:
        return f"ExactLookup({counted(len(self.worlds), 'world')})"

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        positions = positions if positions.is_floating_point() else positions.float()
        codes = self._direct(self.worlds, positions)
        if codes is not None:
            return codes
        places = inside(positions, positions.new_tensor(self.worlds[0].size))
        if len(self.worlds) > 1:
            places = by_world(places, len(self.worlds))
        pictures = views(self.worlds, places)
        return self._codes(pictures.view(*positions.shape[:-1], *pictures.shape[-3:]))

    def elsewhere(self, stack: Stack, worlds: Sequence[VisibleLayout]) -> ExactLookup:
        """Make a look-up of the same kind for `stack` in another world, or in B others."""
        return ExactLookup(stack, worlds)

    def merged(self, other: Self, from_other: Sequence[bool]) -> ExactLookup:
        """Make a look-up of B worlds of this one and of another, see `Lookup.merged`."""
        return ExactLookup(self._stack, _merged(self.worlds, other.worlds, from_other))


def _merged(own: Sequence[Any], others: Sequence[Any], from_other: Sequence[bool]) -> list[Any]:
    """Items for B problems (member-major), each from one of two lists of items for equal parts of them."""
    return [
        items[problem * len(items) // len(from_other)]
        for problem, other in enumerate(from_other)
        for items in [others if other else own]
    ]


def lookup_error(lookup: Lookup, exact: ExactLookup, positions: Tensor) -> Tensor:
    """Distance between the codes of two look-ups at `positions` `[M, ..., 2]` (u): `[M, ...]`, mean over components."""
    return (lookup(positions) - exact(positions)).abs().mean(-1)


class AffordanceMap:
    """Context codes on a fine grid over the arena, interpolated bilinearly; `AffordanceMap.paint` makes one.

    Attributes:
        codes: `[M * W, Y, X, C]`, codes at the nodes in W worlds a member; row 0 is y = 0, column 0 is x = 0.
        worlds: the maps of the worlds that it was painted for: one, shared by all (W is 1), or M * W.
        differentiable: whether gradients flow through the map to the position.
        spacing: largest distance between neighbouring nodes that was asked for, u.
    """

    def __init__(
        self,
        codes: Tensor,
        worlds: Sequence[VisibleLayout],
        differentiable: bool = False,
        spacing: float | None = None,
    ) -> None:
        """Take codes `[M * W, Y, X, C]` whose outermost nodes lie on the borders of the arena.

        `spacing` is by default the distance between columns.
        """
        self.codes, self.worlds = codes, worlds
        self.differentiable = differentiable
        self.spacing = worlds[0].size[0] / (codes.shape[2] - 1) if spacing is None else spacing
        self._picture = codes.permute(0, 3, 1, 2)
        self._scale = 2 / codes.new_tensor(worlds[0].size)
        self._lower = codes.new_tensor(-1.0)

    def __repr__(self) -> str:
        number, height, width, context_size = self.codes.shape
        nodes = f"{width} x {height} nodes {self.spacing:.3g} u apart"
        return f"AffordanceMap({counted(number, 'map')} of {nodes}, C = {context_size})"

    @classmethod
    def paint(
        cls, stack: Stack, worlds: Sequence[VisibleLayout], spacing: float, differentiable: bool = False
    ) -> AffordanceMap:
        """Compute codes at nodes at most `spacing` (u) apart, by exact look-ups.

        Args:
            stack: M members.
            worlds: one world, painted for all members; or M * W, the worlds of each member's agents, member-major.
            spacing: largest distance between neighbouring nodes, u.
            differentiable: whether gradients are to flow through the map to the position.

        Raises:
            ConfigError: the worlds are no list of visible layouts.
        """
        _check_worlds(worlds)
        if len(worlds) == 1:
            return cls(_codes_at_nodes(stack, worlds[0], spacing), worlds, differentiable, spacing)
        num_members = len(stack.seeds)
        members = [stack.select([number * num_members // len(worlds)]) for number in range(len(worlds))]
        codes = [_codes_at_nodes(member, world, spacing) for member, world in zip(members, worlds, strict=True)]
        return cls(torch.cat(codes), worlds, differentiable, spacing)

    def elsewhere(self, stack: Stack, worlds: Sequence[VisibleLayout]) -> AffordanceMap:
        """Paint a map with the same spacing for `stack` in another world, or in B others."""
        return AffordanceMap.paint(stack, worlds, self.spacing, self.differentiable)

    def merged(self, other: Self, from_other: Sequence[bool]) -> AffordanceMap:
        """Make a map of B worlds of this one and of another, see `Lookup.merged`; nothing is painted."""
        codes = torch.stack(_merged([*self.codes], [*other.codes], from_other))
        worlds = _merged(self.worlds, other.worlds, from_other)
        return AffordanceMap(codes, worlds, self.differentiable, self.spacing)

    def picture(self, index: int = 0) -> np.ndarray:
        """Colours of the map at `index` of the leading axis, `[Y, X, 3]` in [0, 1]; row 0 is y = 0.

        Principal components of its codes over the whole arena: red the first, green the second, blue the third.
        """
        codes = self.codes[index].cpu().numpy()
        return Palette.fit(codes.reshape(codes.shape[0] * codes.shape[1], codes.shape[2]))(codes)

    def _repr_html_(self) -> str | None:
        return notebook.affordance_map(self)

    def __call__(self, positions: Tensor) -> Tensor:
        """Context codes at `positions` `[M, ..., 2]` (u): `[M, ..., C]`."""
        if not self.differentiable:
            positions = positions.detach()
        flat = positions.to(self.codes.dtype).flatten(1, -2)
        if len(self.codes) > len(flat):
            flat = by_world(flat, len(self.codes))
        # The arena becomes the square from -1 to 1.
        grid = torch.addcmul(self._lower, flat, self._scale)[:, None]  # [M * W, 1, P, 2]
        codes = grid_sample(self._picture, grid, padding_mode="border", align_corners=True)  # [M * W, C, 1, P]
        return codes[:, :, 0].mT.reshape(*positions.shape[:-1], codes.shape[1])


def node_axes(size: tuple[float, float], spacing: float) -> tuple[Tensor, Tensor]:
    """Coordinates `[X]` and `[Y]` (u) of the nodes of a map over an arena, at most `spacing` (u) apart."""
    # The smallest number of equal parts; the tolerance absorbs rounding of quotients that should be integers.
    parts = [max(1, math.ceil(length / spacing - 1e-6)) for length in size]
    x, y = (
        torch.linspace(0, length, num + 1, dtype=torch.float32, device="cpu")
        for length, num in zip(size, parts, strict=True)
    )
    return x, y


_NODES_AT_ONCE = 2**14  # more would take much memory where members are many


@torch.no_grad()
def _codes_at_nodes(stack: Stack, world: VisibleLayout, spacing: float) -> Tensor:
    """Codes of all members at the nodes of a grid over a world, `[M, Y, X, C]`."""
    x, y = node_axes(world.size, spacing)
    nodes = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1).to(next(stack.parameters()).device)  # [Y, X, 2]
    rows = nodes.split(max(1, _NODES_AT_ONCE // len(x)))
    return torch.cat([stack.encode(take_apart(view(world, some)[None])) for some in rows], dim=1)
