"""Distinct rows by a hash table against PyTorch's way, number by number."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap import compiled
from affmap.model.windows import distinct


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, 300), st.integers(1, 200), st.integers(1, 60), st.integers(0, 10_000))
def test_kinds_and_their_order_are_pytorch_s(rows: int, pixels: int, kinds: int, seed: int) -> None:
    """Rows shorter and longer than a word, many of a kind or all different; views that are not contiguous."""
    generator = torch.Generator().manual_seed(seed)
    few = torch.rand(pixels, kinds, generator=generator) < 0.5
    many = few[:, torch.randint(kinds, (rows,), generator=generator)].T
    first, ids = distinct(many)
    with compiled.switched(False):
        expected_first, expected_ids = distinct(many)
    assert torch.equal(ids, expected_ids) and ids.dtype == expected_ids.dtype and first.dtype == expected_first.dtype
    assert torch.equal(many[first], many[expected_first])
