"""Look-ups: context codes of a whole stack by affordance map, by view, and by plain PyTorch, one member at a time."""

import pandas as pd
import torch
from measure import Contender, Result, compare
from plain import PlainModel
from torch import Tensor, nn

from affmap.env.layout import Layout
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.model.stack import ModelSettings, Stack
from affmap.view import view

MEMBERS, POSITIONS = 25, 220
"""As a planner asks: 4 agents a member, about 55 candidates each."""

SPACINGS = (0.01, 0.02, 0.05)
"""u."""

WORLD = Layout.load("layout", "original").map


def results(rounds: int) -> list[Result]:
    """Looking up, and painting a map beforehand."""
    stack = make_stack(MEMBERS)
    positions = draw(0)
    painted, known = AffordanceMap.paint(stack, [WORLD], 0.02), ExactLookup(stack, [WORLD])
    plain = [PlainModel(stack, member).vision for member in range(MEMBERS)]
    check(known, plain, positions)
    contenders = [
        Contender("affordance map", lambda: painted(positions), MEMBERS * POSITIONS),
        Contender("exact, views known", lambda: known(positions), MEMBERS * POSITIONS),
        Contender("exact, views new", lambda: ExactLookup(stack, [WORLD])(positions), MEMBERS * POSITIONS),
        Contender("plain PyTorch", lambda: plain_lookup(plain, positions), MEMBERS * POSITIONS),
    ]
    found = compare(f"look-up, {MEMBERS} x {POSITIONS} positions", "position", contenders, rounds=rounds)
    for spacing in SPACINGS:
        found += paint(spacing, rounds if spacing > min(SPACINGS) else min(rounds, 3))
    return found


def paint(spacing: float, rounds: int) -> list[Result]:
    """An affordance map of nodes so far apart (u)."""
    stack = make_stack(MEMBERS)
    plain = PlainModel(stack).vision
    rows = nodes(AffordanceMap.paint(stack, [WORLD], spacing))
    contenders = [
        Contender(f"stack of {MEMBERS}", lambda: AffordanceMap.paint(stack, [WORLD], spacing), MEMBERS),
        Contender("plain PyTorch", lambda: plain_paint(plain, rows), 1),
    ]
    return compare(f"painting a map, {spacing:g} u", "member and world", contenders, rounds=rounds)


def maps() -> pd.DataFrame:
    """Sizes of affordance maps: spacing (u), nodes, mebibytes (a member and world)."""
    stack = make_stack(1)
    rows = []
    for spacing in SPACINGS:
        codes = AffordanceMap.paint(stack, [WORLD], spacing).codes
        rows.append((spacing, codes[0, ..., 0].numel(), codes.nbytes / 2**20))
    return pd.DataFrame(rows, columns=["spacing", "nodes", "mebibytes"])


def make_stack(members: int) -> Stack:
    """An untrained stack."""
    return Stack(ModelSettings.load("model", "default"), WORLD.num_channels, range(members))


def draw(seed: int) -> Tensor:
    """Positions all over the arena, `[M, P, 2]` in u."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(MEMBERS, POSITIONS, 2, generator=generator) * torch.tensor(WORLD.size)


def nodes(painted: AffordanceMap) -> list[Tensor]:
    """A map's nodes in u: for each of its rows `[X, 2]`."""
    rows, columns = painted.codes.shape[1:3]
    x, y = (torch.linspace(0, length, num) for length, num in zip(WORLD.size, (columns, rows), strict=True))
    return [torch.stack([x, row.expand_as(x)], dim=-1) for row in y]


@torch.no_grad()
def plain_lookup(models: list[nn.Sequential], positions: Tensor) -> Tensor:
    """Codes of each member's own views."""
    return torch.stack([m(view(WORLD, own).float()) for m, own in zip(models, positions, strict=True)])


@torch.no_grad()
def plain_paint(model: nn.Sequential, rows: list[Tensor]) -> Tensor:
    """Codes at all nodes, a row of them at a time."""
    return torch.stack([model(view(WORLD, row).float()) for row in rows])


def check(lookup: ExactLookup, plain: list[nn.Sequential], positions: Tensor) -> None:
    """Make sure that both look up the same.

    Raises:
        RuntimeError: a code differs.
    """
    error = (lookup(positions) - plain_lookup(plain, positions)).abs().max().item()
    if error > 1e-4:
        raise RuntimeError(
            f"Codes of the stack and of plain models with its weights differ by {error:g}: "
            "they do different work, and comparing their times means nothing."
        )
