"""Codes from memory are those of the vision model: against the stack itself."""

import numpy as np
import pytest
import torch
from torch import Tensor

from affmap.env.layout import Layout
from affmap.model.codes import ViewCodes
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
    codes = ViewCodes(whole)
    torch.testing.assert_close(codes(seen[:, :15]), expected[:, :15])
    torch.testing.assert_close(codes(seen.flip(1)), expected.flip(1))
    torch.testing.assert_close(codes(seen.view(3, 8, 5, 1, 11, 11)), expected.view(3, 8, 5, -1))
    assert len(encoded) == 2 and sum(encoded) == len(np.unique(seen.flatten(0, 1).numpy(), axis=0))


def test_what_was_forgotten_is_encoded_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for a single view, the same codes."""
    monkeypatch.setattr(ViewCodes, "limit", 1)
    whole = stack()
    codes = ViewCodes(whole)
    for seed in range(3):
        seen = views(5, seed)
        torch.testing.assert_close(codes(seen), whole.encode(take_apart(seen)))
