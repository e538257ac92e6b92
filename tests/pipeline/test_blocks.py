"""Effects of blocks, each alone: models whose weights are set by hand, and blocks that are given one channel each."""

import numpy as np
import pytest
import torch
from stage_files import make_world

from affmap.env.body import Vehicle
from affmap.env.layout import Circle
from affmap.model.effects import Effects
from affmap.model.registry import EffectsSettings
from affmap.model.settings import ModelSettings
from affmap.model.stack import Stack
from affmap.pipeline.blocks import blocks_alone, shares

VEHICLE = Vehicle.load("vehicle", "default")
SCALE = 4.0


def made(kind: str = "additive", channels: int = 4) -> Stack:
    """Two members with two blocks of two units."""
    transition = EffectsSettings.load("model/transition", kind)
    settings = ModelSettings.load("model", "default", context_size=4, transition=transition)
    return Stack(settings, channels, (3, 4)).requires_grad_(False)


def set_by_hand(stack: Stack) -> Effects:
    """Blocks without weights: each hidden unit is 1 (to rounding) whatever the motion, and nothing comes of it yet."""
    effects = stack.transition
    assert isinstance(effects, Effects)
    for weight in (effects.block_weight, effects.effect_weight):
        weight.zero_()
    effects.block_bias.fill_(20.0)
    return effects


@pytest.mark.parametrize("kind", ["additive", "split"])
def test_a_block_that_adds_a_constant_force_and_one_that_adds_noise(kind: str) -> None:
    """By hand: in proportion to the first unit of the first block 0.02 u/step along x and -0.01 along y, whatever the
    motion; in proportion to the second unit of the second block a deviation of 0.3 u/step along x and 0.4 along y."""
    stack = made(kind)
    effects = set_by_hand(stack)
    effects.effect_weight[:, 0, 0] = SCALE * torch.tensor([0.02, -0.01, 0.0, 0.0])
    effects.effect_weight[:, 3, 0] = SCALE * torch.tensor([0.0, 0.0, 0.3, 0.4])
    codes = torch.tensor([[1.0, 0.9, 0.9, 1.0], [-0.5, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]]).expand(2, -1, -1)
    alone = blocks_alone(stack, codes, VEHICLE)
    force = torch.tensor([[0.02, -0.01], [-0.01, 0.005], [0.0, 0.0]])
    noise = np.sqrt((0.3**2 + 0.4**2) / 2) * torch.tensor([1.0, 0.5, 0.0])
    for member in range(2):
        torch.testing.assert_close(alone.change[:, member], torch.stack([force, torch.zeros(3, 2)]))
        torch.testing.assert_close(alone.deviation[:, member], torch.stack([torch.zeros(3), noise.float()]))
    assert alone.spread.abs().max() < 1e-4, "it does not depend on motion"
    power = torch.stack([force.square().sum(1), 2 * noise.float().square()])
    torch.testing.assert_close(alone.power, power[:, None].expand(-1, 2, -1))


def test_a_change_that_depends_on_motion_is_spread_around_its_mean() -> None:
    """By hand: minus a small part of the last motion, as friction: over all directions its mean is 0; top speed of two
    throttles in four of 16 motions, of one throttle, which is less by the square root of 2, in four others."""
    stack = made()
    effects = set_by_hand(stack)
    effects.block_bias.zero_()
    small = 1e-3
    for axis in range(2):
        effects.block_weight[:, 1, axis, axis] = small  # a tanh of small numbers is linear
        effects.effect_weight[:, 2, axis, axis] = -0.5 / small
    codes = torch.tensor([[1.0, 1.0, 1.0, 1.0]]).expand(2, -1, -1)
    alone = blocks_alone(stack, codes, VEHICLE)
    spread = 0.5 * VEHICLE.top_speed * np.sqrt(4 / 16 + 4 / 16 / 2)
    assert alone.change.abs().max() < 1e-5 and alone.spread[0].max() == 0 and alone.deviation.max() == 0
    np.testing.assert_allclose(alone.spread[1], spread, rtol=1e-3)


def test_blocks_that_see_one_channel_each_have_all_of_its_effects() -> None:
    """Two circles that no view shows together, in a channel each: whatever the weights, the block of the channel does
    all where the circle acts, but where the border can be seen; beside an obstacle means up to 0.04 u from its rim."""
    stack = made("split_channels", channels=2)
    world = make_world((1.0, 1.0, 0.2, "obstacle"), (2.0, 1.0, 0.3, "fog"), (1.5, 1.0, 0.1, "none"))
    circles = [
        Circle(center=circle.center, radius=circle.radius, effect=circle.effect, channel=channel)
        for circle, channel in zip(world.circles, ("solid", "fog"), strict=False)
    ]
    world = world.model_copy(update={"channels": ("solid", "fog"), "circles": tuple(circles)})
    table = shares(stack, [world, world], VEHICLE, spacing=0.05)
    assert table.columns.tolist() == ["member", "effect", "block", "share"]
    expected = {("obstacle", 1): 1.0, ("obstacle", 2): 0.0, ("fog", 1): 0.0, ("fog", 2): 1.0}
    for member in (3, 4):
        own = table[table["member"] == member].set_index(["effect", "block"])["share"]
        assert own.to_dict() == pytest.approx(expected, abs=1e-6)


def test_properties_without_a_node_have_no_shares() -> None:
    """The nodes of a map are the corners of the arena."""
    world = make_world((1.5, 1.0, 0.2, "obstacle"))
    table = shares(made(channels=1), [world], VEHICLE, spacing=10.0)
    assert len(table) == 2 * 2 and table["share"].isna().all()
    assert shares(made(channels=1), [make_world()], VEHICLE, spacing=0.5).empty
