"""Codes from memory are those of the vision model: against the stack itself."""

import numpy as np
import pytest
import torch
from torch import Tensor

from affmap.env.layout import Layout
from affmap.model.code_cache import CachedEncoder
from affmap.model.stack import ModelSettings, Stack
from affmap.model.windows import Windows, take_apart
from affmap.view import view

WORLD = Layout.load("layout", "original").map


def stack() -> Stack:
    made = Stack(ModelSettings.load("model", "default", context_size=3), WORLD.num_channels, (4, 5, 6))
    return made.requires_grad_(False)


def views(count: int, seed: int = 0) -> Tensor:
    """`[3, count, 1, 11, 11]`, at random places of each member's own."""
    places = torch.rand(3, count, 2, generator=torch.Generator().manual_seed(seed)) * torch.tensor(WORLD.size)
    return view(WORLD, places)


def test_each_different_view_is_encoded_only_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stack's own codes, for views that come again, in another order, and mixed with new ones; calls counted."""
    whole, seen = stack(), views(40)
    expected = whole.encode(take_apart(seen))
    encoded: list[int] = []

    def encode(windows: Windows) -> Tensor:
        encoded.append(windows.ids.numel())
        return Stack.encode(whole, windows)

    monkeypatch.setattr(whole, "encode", encode)
    codes = CachedEncoder(whole)
    torch.testing.assert_close(codes(seen[:, :15]), expected[:, :15])
    torch.testing.assert_close(codes(seen.flip(1)), expected.flip(1))
    torch.testing.assert_close(codes(seen.view(3, 8, 5, 1, 11, 11)), expected.view(3, 8, 5, -1))
    assert len(encoded) == 2 and sum(encoded) == len(np.unique(seen.flatten(0, 1).numpy(), axis=0))


def test_what_was_forgotten_is_encoded_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for a single view: the same codes, and no more is kept than one call has seen."""
    monkeypatch.setattr(CachedEncoder, "limit", 1)
    whole = stack()
    codes = CachedEncoder(whole)
    for seed in range(3):
        seen = views(5, seed)
        torch.testing.assert_close(codes(seen), whole.encode(take_apart(seen)))
        assert len(codes._numbers) <= 15


def test_codes_are_those_of_the_present_weights() -> None:
    """A weight changed in place, as an optimiser does it."""
    whole, seen = stack(), views(5)
    codes = CachedEncoder(whole)
    before = codes(seen)
    assert whole.vision is not None
    whole.vision.linear2.bias.add_(0.5)
    torch.testing.assert_close(codes(seen), whole.encode(take_apart(seen)))
    assert (codes(seen) - before).abs().max() > 0.1


def test_a_failed_call_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted while new views are encoded, or given views of another type: the next call is right."""
    whole, seen = stack(), views(9)
    codes = CachedEncoder(whole)
    codes(seen[:, :2])
    with pytest.raises(TypeError, match=r"must be torch\.bool"):
        codes(seen.byte())

    def interrupt(windows: Windows) -> Tensor:
        raise KeyboardInterrupt

    monkeypatch.setattr(whole, "encode", interrupt)
    with pytest.raises(KeyboardInterrupt):
        codes(seen)
    monkeypatch.undo()
    torch.testing.assert_close(codes(seen), whole.encode(take_apart(seen)))


def test_as_many_views_as_members_or_an_error() -> None:
    """Two or five sets of views for three members mean nothing."""
    for count in (2, 5):
        with pytest.raises(ValueError, match=f"leading axis {count}; it must be 3"):
            CachedEncoder(stack())(torch.zeros(count, 4, 1, 11, 11, dtype=torch.bool))
