"""Taking views apart loses nothing and finds no window twice: against cutting every window out, one by one."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.env.layout import Layout
from affmap.model.windows import take_apart
from affmap.view import view


def random_views(*shape: int, share: float = 0.5, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, 11, 11, generator=torch.Generator().manual_seed(seed)) < share


def windows_by_hand(views: np.ndarray) -> np.ndarray:
    """`[..., K, 11, 11]` -> `[..., 16, K, 5, 5]`, row by row."""
    found = [views[..., y : y + 5, x : x + 5] for y in (0, 2, 4, 6) for x in (0, 2, 4, 6)]
    return np.stack(found, axis=-4)


def windows_put_together(views: torch.Tensor) -> np.ndarray:
    """The same, from what `take_apart` returns: nine overlapping patches make a window."""
    ids, patch_ids, patches = take_apart(views)
    assert ids.dtype == patch_ids.dtype == torch.int64 and patches.dtype == torch.float32
    nine = patches[patch_ids].numpy().reshape(len(patch_ids), 3, 3, -1, 3, 3)  # [U, y, x, K, 3, 3]
    whole = np.full((len(patch_ids), nine.shape[3], 5, 5), np.nan)
    for y in range(3):
        for x in range(3):
            before = whole[..., y : y + 3, x : x + 3]
            assert (np.isnan(before) | (before == nine[:, y, x])).all()  # where patches overlap, they agree
            whole[..., y : y + 3, x : x + 3] = nine[:, y, x]
    return whole[ids.numpy()]


def real_views() -> torch.Tensor:
    """`[500, 1, 11, 11]`, at random places of Experiment I's world."""
    layout = Layout.load("layout", "original")
    positions = torch.rand(500, 2, generator=torch.Generator().manual_seed(0)) * torch.tensor(layout.size)
    return view(layout.map, positions)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.integers(1, 4),
    st.lists(st.integers(1, 3), max_size=3),
    st.sampled_from([0.0, 0.03, 0.5, 1.0]),
    st.integers(0, 10_000),
)
def test_every_window_can_be_put_together_again(channels: int, leading: list[int], share: float, seed: int) -> None:
    """Brute force, for any leading shape and number of channels."""
    views = random_views(*leading, channels, share=share, seed=seed)
    np.testing.assert_array_equal(windows_put_together(views), windows_by_hand(views.numpy()))
    assert take_apart(views).ids.shape == (*leading, 16)


def test_every_window_of_the_real_world_can_be_put_together_again() -> None:
    """Brute force; and there are few of them, which is the point."""
    views = real_views()
    np.testing.assert_array_equal(windows_put_together(views), windows_by_hand(views.numpy()))
    assert len(take_apart(views).patch_ids) < 700
    assert len(take_apart(views).patches) < 100


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_what_is_called_distinct_is_distinct_and_occurs(channels: int) -> None:
    """NumPy's `unique` over whole windows and whole patches."""
    for views in (random_views(30, channels, share=0.02), random_views(4, channels), real_views()):
        ids, patch_ids, patches = take_apart(views)
        by_hand = windows_by_hand(views.numpy())
        windows = np.unique(by_hand.reshape(-1, *by_hand.shape[-3:]), axis=0)
        assert len(patch_ids) == len(windows) and set(ids.flatten().tolist()) == set(range(len(windows)))
        cut = np.concatenate([windows[..., y : y + 3, x : x + 3] for y in range(3) for x in range(3)])
        expected = np.unique(cut.reshape(len(cut), -1), axis=0)
        assert len(patches) == len(expected) == len(torch.unique(patches, dim=0))
        assert set(patch_ids.flatten().tolist()) == set(range(len(patches)))


def test_select_keeps_the_windows_of_some_views() -> None:
    """Taking the same views apart alone."""
    views = random_views(1, 5, 6, 2)
    some = take_apart(views).select((slice(None), torch.tensor([4, 1]), slice(2, 5)))
    alone = take_apart(views[:, [4, 1], 2:5])
    for one, other in ((some, alone),):
        first = one.patches[one.patch_ids[one.ids]]
        torch.testing.assert_close(first, other.patches[other.patch_ids[other.ids]], rtol=0, atol=0)


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int8, torch.float32])
def test_only_booleans_are_taken(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match=rf"dtype {dtype}; they must be torch.bool"):
        take_apart(random_views(2, 1).to(dtype))
