"""Codes in one pass of compiled code against exact look-ups by PyTorch, and each place against itself alone."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from affmap import compiled
from affmap.model.direct import DirectEncoder
from affmap.model.lookup import ExactLookup
from affmap.model.registry import Encoder, MLPSettings
from affmap.model.stack import ModelSettings, Stack
from affmap.view import VisibleLayout, view

pytest.importorskip("numba")
SEEDS = (4, 5, 6)
CIRCLES = ((1.0, 1.0, 0.4), (2.0, 0.5, 0.3), (1.6, 1.3, 0.2), (0.1, 1.9, 0.3))


def world(num_channels: int = 1, shift: float = 0.0) -> VisibleLayout:
    """Four circles and the border, in all channels in turn."""
    circles = tuple((x + shift, y, radius, n % num_channels) for n, (x, y, radius) in enumerate(CIRCLES))
    return VisibleLayout((3.0, 2.0), num_channels, num_channels - 1, circles)


def stack(context_size: int = 8, num_channels: int = 1, encoder: Encoder = "plain") -> Stack:
    """Untrained; stretched, because codes of untrained models differ little between places."""
    settings = ModelSettings(context_size=context_size, transition=MLPSettings(encoder=encoder))
    made = Stack(settings, num_channels, SEEDS)
    if made.vision is not None:
        with torch.no_grad():
            for parameter in made.vision.parameters():
                parameter *= 3
    return made.requires_grad_(False)


def places(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    """Positions `[*shape, 2]` in the arena and up to 0.5 u outside of it."""
    uniform = torch.rand(*shape, 2, generator=torch.Generator().manual_seed(seed), dtype=dtype)
    return uniform * torch.tensor([4.0, 3.0], dtype=dtype) - 0.5


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.sampled_from([1, 3, 5, 8, 11, 32, 40]),
    st.integers(1, 4),
    st.sampled_from([torch.float32, torch.float64]),
    st.integers(0, 1000),
    st.sampled_from(["plain", "centered", "channels"]),
)
def test_codes_are_those_of_pytorch(
    context_size: int, num_channels: int, dtype: torch.dtype, seed: int, encoder: Encoder
) -> None:
    """All widths of the vision model, kinds of codes, more channels than one; within rounding, and places differ."""
    whole, positions = stack(context_size, num_channels, encoder), places(3, 4, 20, seed=seed, dtype=dtype)
    codes = DirectEncoder(whole)([world(num_channels)], positions)
    with compiled.switched(False):
        expected = ExactLookup(whole, [world(num_channels)])(positions)
    assert codes is not None and codes.dtype == expected.dtype
    torch.testing.assert_close(codes, expected, atol=1e-5, rtol=0)
    assert (codes.std(dim=(1, 2)) > 1e-3).any()


@pytest.mark.parametrize("encoder", ["plain", "centered", "channels"])
def test_a_code_depends_on_nothing_else_that_is_looked_up(encoder: Encoder) -> None:
    """Each place alone and in worlds of each problem's own, bit for bit."""
    whole, positions = stack(encoder=encoder), places(3, 10)
    encoder = DirectEncoder(whole)
    worlds = [world(shift=0.05 * number) for number in range(6)]  # two problems a member
    together, apart = encoder(worlds[:1], positions), encoder(worlds, positions)
    assert together is not None and apart is not None
    for number in range(10):
        alone = encoder(worlds[:1], positions[:, number : number + 1])
        assert alone is not None and torch.equal(together[:, number : number + 1], alone)
    for problem in range(6):
        member, own = problem // 2, slice(5 * (problem % 2), 5 * (problem % 2) + 5)
        alone = DirectEncoder(whole.select([member]))([worlds[problem]], positions[member, None, own])
        assert alone is not None and torch.equal(apart[member, own], alone[0])
    assert not torch.equal(together, apart)


def test_codes_are_those_of_the_present_weights() -> None:
    """A weight changed in place, as an optimiser does it; positions of which somebody wants a gradient."""
    whole, positions = stack(), places(3, 5).requires_grad_()
    encoder = DirectEncoder(whole)
    before = encoder([world()], positions)
    assert whole.vision is not None and before is not None
    whole.vision.linear2.bias.add_(0.5)
    after = encoder([world()], positions)
    assert after is not None and not after.requires_grad and (after - before).abs().max() > 0.1
    torch.testing.assert_close(after, ExactLookup(whole, [world()])(positions), atol=1e-5, rtol=0)


def test_nowhere_is_seen_as_pytorch_sees_it() -> None:
    """A position that is not a number has the code of an empty view."""
    whole, positions = stack(), torch.full((3, 1, 2), torch.nan)
    codes = DirectEncoder(whole)([world()], positions)
    with compiled.switched(False):
        expected = ExactLookup(whole, [world()])(positions)
    assert codes is not None
    torch.testing.assert_close(codes, expected, atol=1e-5, rtol=0)


def test_what_it_cannot_do_it_leaves_to_pytorch() -> None:
    """No code to look up, other numbers than it knows, other members, or nothing compiled at all."""
    assert DirectEncoder(stack(0))([world()], places(3, 2)) is None
    assert DirectEncoder(stack())([world()], places(3, 2).bfloat16()) is None
    assert DirectEncoder(stack().double())([world()], places(3, 2)) is None
    assert DirectEncoder(stack())([world()], places(2, 2)) is None
    with compiled.switched(False):
        assert DirectEncoder(stack())([world()], places(3, 2)) is None
    assert DirectEncoder(stack())([world()], places(3, 0)) is not None


@pytest.mark.parametrize("context_size", [1, 8, 32])
@pytest.mark.parametrize("num_channels", [1, 4])
def test_codes_of_views_are_those_of_their_positions(context_size: int, num_channels: int) -> None:
    """To the last bit: the same pixels."""
    encoder, positions = DirectEncoder(stack(context_size, num_channels)), places(3, 20)
    positions = positions.clamp_min(0).minimum(torch.tensor([3.0, 2.0]))
    codes = encoder.of_views(view(world(num_channels), positions))
    expected = encoder([world(num_channels)], positions)
    assert codes is not None and expected is not None and torch.equal(codes, expected)


def test_views_are_left_to_pytorch_where_it_must_be() -> None:
    """Without a vision model, with other numbers, or without compiled loops."""
    seen = view(world(), places(3, 2))
    assert DirectEncoder(stack(0)).of_views(seen) is None
    assert DirectEncoder(stack().double()).of_views(seen) is None
    with compiled.switched(False):
        assert DirectEncoder(stack()).of_views(seen) is None
