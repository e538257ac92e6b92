"""The stage `blocks`: the effects of the blocks of codes, each alone, place by place and property by property.

Effects depend on motion and action. So all are means over 16 of these: eight directions of thrust, each from rest and
at its top speed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from affmap.config.root import Config
from affmap.env.body import MAX_SPEED, THROTTLES, Vehicle
from affmap.env.geometry import Mask, affected, beside, circle_distance, reachable
from affmap.env.layout import Layout
from affmap.model.effects import Effects
from affmap.model.lookup import AffordanceMap
from affmap.model.stack import Stack
from affmap.pipeline.train import trained
from affmap.results.files import Blocks, Floats, write_blocks
from affmap.store.attempt import Attempt


def make_blocks(config: Config, train: Path, attempt: Attempt) -> None:
    """Write the effects of blocks: of the first member on the map, and of all members by property."""
    stack, spacing = trained(config, train), config.report.map_spacing
    codes, nodes = _painted(stack.select([0]), config.map_layout, spacing)
    alone = blocks_alone(stack.select([0]), codes.flatten(1, 2), config.vehicle)
    change, spread, deviation = (part[:, 0].unflatten(1, nodes.shape[:2]).numpy() for part in alone)
    blocks = Blocks(change, spread, deviation, x=nodes[0, :, 0], y=nodes[:, 0, 1])
    write_blocks(attempt.folder, blocks, shares(stack, config.training_layouts, config.vehicle, spacing))


class Alone(NamedTuple):
    """Effects of blocks, each alone, over motions and actions; u/step."""

    change: Tensor
    """`[B, M, P, 2]`, mean change of the mean."""
    spread: Tensor
    """`[B, M, P]`, deviation of the change from its mean."""
    deviation: Tensor
    """`[B, M, P]`, added deviation of a coordinate, root of the mean square."""

    @property
    def power(self) -> Tensor:
        """`[B, M, P]`, mean square of the change and of the added deviation, both coordinates together."""
        return self.change.square().sum(-1) + self.spread.square() + 2 * self.deviation.square()


@torch.inference_mode()
def blocks_alone(stack: Stack, codes: Tensor, vehicle: Vehicle) -> Alone:
    """Effects of each of the B blocks of codes `[M, P, C]`, the others being 0, over motions and actions."""
    model, each = _model(stack), []
    shape = codes.shape[:2]
    deltas, actions = (codes.new_tensor(part)[:, None, None].expand(-1, *shape, -1) for part in _motions(vehicle))
    for block in range(model.num_blocks):
        sums = codes.new_zeros(4, *shape)  # of the change (x, y), of its square, and of the variance
        for delta, action in zip(deltas, actions, strict=True):
            change, deviation = model.alone(block, codes, delta, action)
            sums += torch.stack([*change.unbind(-1), change.square().sum(-1), deviation.square().mean(-1)])
        *mean, square, variance = sums / len(deltas)
        spread = (square - mean[0].square() - mean[1].square()).clamp_min(0).sqrt()
        each.append((torch.stack(mean, dim=-1), spread, variance.sqrt()))
    return Alone(*(torch.stack(parts) for parts in zip(*each, strict=True)))


def _motions(vehicle: Vehicle) -> tuple[Floats, Floats]:
    """Last changes of position `[16, 2]` (u/step) and actions `[16, 4]`.

    Thrust of one throttle or of two neighbours; from rest, and at the speed at which damping balances it.
    """
    one = np.eye(len(THROTTLES))
    actions = np.concatenate([one, one + np.roll(one, 1, axis=1)])
    top = actions @ THROTTLES / np.sqrt(2) * min(vehicle.top_speed, MAX_SPEED)  # that of two neighbours
    return np.concatenate([np.zeros_like(top), top]), np.concatenate([actions, actions])


def shares(stack: Stack, layouts: Sequence[Layout], vehicle: Vehicle, spacing: float) -> pd.DataFrame:
    """Share of each block in what all blocks do, where circles of each effect act in some layouts.

    That is the mean square of changes and added deviations. Returns a table as `write_blocks` takes it; shares are NaN
    where no node of a map is such a place.
    """
    effects = list(dict.fromkeys(effect for layout in layouts for effect in layout.effects if effect != "none"))
    power = np.zeros((len(stack.seeds), len(effects), _model(stack).num_blocks))
    for layout in layouts:
        codes, nodes = _painted(stack, layout, spacing)
        for effect in {*effects} & {*layout.effects}:
            places = codes[:, torch.as_tensor(_acts(effect, layout, nodes, vehicle.radius))]
            power[:, effects.index(effect)] += blocks_alone(stack, places, vehicle).power.sum(-1).T.numpy()
    blocks = range(1, power.shape[-1] + 1)
    index = pd.MultiIndex.from_product([stack.seeds, effects, blocks], names=["member", "effect", "block"])
    table = pd.Series(power.ravel(), index, name="share")
    return (table / table.groupby(["member", "effect"]).transform("sum")).reset_index()


def _model(stack: Stack) -> Effects:
    """The transition models, which have blocks because the stage is theirs alone."""
    assert isinstance(stack.transition, Effects)
    return stack.transition


def _acts(effect: str, layout: Layout, nodes: Floats, radius: float) -> Mask:
    """Where circles of an effect act on a vehicle, `[Y, X]`; obstacles do where it is beside them."""
    acts = [
        beside(circle_distance(nodes, circle), radius)
        if effect == "obstacle"
        else affected(nodes, layout, circle, radius)
        for circle in layout.circles
        if circle.effect == effect
    ]
    mask: Mask = reachable(nodes, layout, radius) & np.any(acts, axis=0)
    return mask


def _painted(stack: Stack, layout: Layout, spacing: float) -> tuple[Tensor, Floats]:
    """Codes at the nodes of a layout's map, `[M, Y, X, C]`, and their positions, `[Y, X, 2]` in u."""
    codes = AffordanceMap.paint(stack, [layout.map], spacing).codes
    x, y = (np.linspace(0, side, num) for side, num in zip(layout.size, (codes.shape[2], codes.shape[1]), strict=True))
    return codes, np.stack(np.meshgrid(x, y), axis=-1)
