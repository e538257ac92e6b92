"""Transition models made of effects: their equations written down for one member, and what follows from them."""

import math

import pytest
import torch
from torch import Tensor

from affmap.gaussian import Gaussian
from affmap.model.effects import Effects
from affmap.model.registry import EffectsSettings
from affmap.model.stack import ModelSettings, Stack

SCALE = 4.0


def model(context_size: int = 5, in_turn: bool = False, members: int = 3) -> Effects:
    """Blocks of two units; the last one has one unit."""
    generators = [torch.Generator().manual_seed(seed) for seed in range(members)]
    return Effects(generators, context_size, SCALE, units=4, block_size=2, in_turn=in_turn).requires_grad_(False)


def inputs(context_size: int = 5, num: int = 6) -> tuple[Tensor, Tensor, Tensor]:
    """Code, delta and action of three members."""
    generator = torch.Generator().manual_seed(1)
    code = torch.rand(3, num, context_size, generator=generator) * 2 - 1
    delta = torch.randn(3, num, 2, generator=generator) * 0.1
    return code, delta, torch.rand(3, num, 4, generator=generator)


def by_hand(effects: Effects, member: int, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation in u/step for one problem of one member, unit by unit."""
    own = {name: weight[member] for name, weight in effects.named_parameters()}
    x = torch.cat([SCALE * delta, action])
    hidden = torch.tanh(x @ own["free_hidden.weight"] + own["free_hidden.bias"])
    out = hidden @ own["free_output.weight"] + own["free_output.bias"]
    free, variance = out[:2], (2 * out[2:]).exp()
    motion, total = free, free
    for block in reversed(range(math.ceil(len(code) / 2))):
        start = motion if effects.in_turn else free
        h = torch.tanh(torch.cat([x, start]) @ own["block_weight"][block] + own["block_bias"][block])
        effect = torch.zeros(4)
        for unit in range(2 * block, min(2 * block + 2, len(code))):
            effect = effect + code[unit] * (h @ own["effect_weight"][unit])
        motion, total, variance = motion + effect[:2], total + effect[:2], variance + effect[2:] ** 2
    return total / SCALE, variance.sqrt() / SCALE


@pytest.mark.parametrize("in_turn", [False, True])
@pytest.mark.parametrize("context_size", [0, 1, 5, 8])
def test_a_step_is_the_equations_of_its_docstring(context_size: int, in_turn: bool) -> None:
    """Unit by unit, block by block, for each problem of each member alone."""
    effects, (code, delta, action) = model(context_size, in_turn), inputs(context_size)
    carry, (mean, log_std) = effects.step()(effects.initial(6), code, delta, action)
    assert carry == ()
    for member in range(3):
        for problem in range(6):
            own = code[member, problem], delta[member, problem], action[member, problem]
            expected = by_hand(effects, member, *own)
            torch.testing.assert_close((mean[member, problem], log_std[member, problem].exp()), expected)


def changes(effects: Effects, code: Tensor, delta: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """What a code changes: the mean, and the variance."""
    step = effects.step()
    with_code, without = (step((), each, delta, action)[1] for each in (code, torch.zeros_like(code)))
    return with_code.mean - without.mean, (2 * with_code.log_std).exp() - (2 * without.log_std).exp()


def test_additive_effects_of_blocks_add_up_and_act_alone_as_in_turn() -> None:
    """Codes of single blocks, and of all: changes of means and variances are sums. With a single block the order does
    not matter, and `split` predicts the same."""
    (code, delta, action), effects, in_turn = inputs(), model(), model(in_turn=True)
    parts = []
    for block in range(3):
        single = torch.zeros_like(code)
        single[..., 2 * block : 2 * block + 2] = code[..., 2 * block : 2 * block + 2]
        parts.append(changes(effects, single, delta, action))
        torch.testing.assert_close(changes(in_turn, single, delta, action), parts[-1])
    whole = changes(effects, code, delta, action)
    torch.testing.assert_close(whole, tuple(sum(part) for part in zip(*parts, strict=True)))
    assert not torch.allclose(changes(in_turn, code, delta, action)[0], whole[0], rtol=1e-2)
    assert (whole[1] > 0).all(), "a variance only grows"


@pytest.mark.parametrize("in_turn", [False, True])
def test_a_block_alone_does_what_a_code_of_that_block_alone_changes(in_turn: bool) -> None:
    """Steps with all other code 0, less free motion: the change, and the variance; so those of all add up if added."""
    (code, delta, action), effects = inputs(), model(in_turn=in_turn)
    assert effects.num_blocks == 3
    parts = []
    for block in range(3):
        single = torch.zeros_like(code)
        single[..., 2 * block : 2 * block + 2] = code[..., 2 * block : 2 * block + 2]
        change, deviation = effects.alone(block, code, delta, action)
        parts.append((change, deviation.square()))
        torch.testing.assert_close(parts[-1], changes(effects, single, delta, action))
    whole = tuple(sum(part) for part in zip(*parts, strict=True))
    if not in_turn:
        torch.testing.assert_close(whole, changes(effects, code, delta, action))


def test_an_effect_is_linear_in_its_block() -> None:
    """Half the code: half the change of the mean, and a quarter of the added variance."""
    code, delta, action = inputs(context_size=2)
    effects = model(context_size=2)
    mean, variance = changes(effects, code, delta, action)
    torch.testing.assert_close(changes(effects, code / 2, delta, action), (mean / 2, variance / 4))


@pytest.mark.parametrize("in_turn", [False, True])
def test_unrolling_is_step_after_step_and_a_member_is_itself_alone(in_turn: bool) -> None:
    """`step` at each time, and a stack of the last seed only."""
    together = model(in_turn=in_turn)
    alone = Effects([torch.Generator().manual_seed(2)], 5, SCALE, units=4, block_size=2, in_turn=in_turn)
    code, delta, action = (part.unflatten(1, (2, 3)) for part in inputs())
    _, unrolled = together.unroll((), code, delta, action)
    for t in range(3):
        _, expected = together.step()((), code[:, :, t], delta[:, :, t], action[:, :, t])
        torch.testing.assert_close(Gaussian(*(part[:, :, t] for part in unrolled)), expected)
    _, single = alone.unroll((), code[2:], delta[2:], action[2:])
    torch.testing.assert_close(single.mean[0], unrolled.mean[2])
    torch.testing.assert_close(single.log_std[0], unrolled.log_std[2])


@pytest.mark.parametrize("kind", ["additive", "split"])
def test_the_configuration_makes_models_of_nearly_as_many_weights_as_the_papers(kind: str) -> None:
    """580 weights of the perceptron at C = 8, within 20 %; codes are centered."""
    settings = ModelSettings(transition=EffectsSettings.load("model/transition", kind))
    stack = Stack(settings, 4, [0])
    assert isinstance(stack.transition, Effects) and stack.transition.in_turn == (kind == "split")
    num_weights = sum(parameter.numel() for parameter in stack.transition.parameters())
    assert num_weights == 636 and abs(num_weights - 580) < 0.2 * 580
    assert stack.vision is not None and stack.vision.encoder == "centered"
