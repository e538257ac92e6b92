"""Taking views apart loses nothing and finds nothing twice: against cutting every window out, one by one."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from affmap.env.layout import Layout
from affmap.model.windows import Windows, distinct, take_apart
from affmap.view import view

pytestmark = pytest.mark.usefixtures("loops")


def random_views(*shape: int, share: float = 0.5, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, 11, 11, generator=torch.Generator().manual_seed(seed)) < share


def windows_by_hand(views: np.ndarray) -> np.ndarray:
    """`[..., K, 11, 11]` -> `[..., 16, K, 5, 5]`, row by row."""
    found = [views[..., y : y + 5, x : x + 5] for y in (0, 2, 4, 6) for x in (0, 2, 4, 6)]
    return np.stack(found, axis=-4)


def windows_put_together(views: torch.Tensor) -> np.ndarray:
    """The same, from what `take_apart` returns: nine overlapping patches make a window."""
    return together(take_apart(views))


def together(windows: Windows) -> np.ndarray:
    ids, window_ids, patch_ids, patches = windows
    assert ids.dtype == window_ids.dtype == patch_ids.dtype == torch.int64 and patches.dtype == torch.float32
    nine = patches[patch_ids].numpy().reshape(len(patch_ids), 3, 3, -1, 3, 3)  # [U, y, x, K, 3, 3]
    whole = np.full((len(patch_ids), nine.shape[3], 5, 5), np.nan)
    for y in range(3):
        for x in range(3):
            before = whole[..., y : y + 3, x : x + 3]
            assert (np.isnan(before) | (before == nine[:, y, x])).all()  # where patches overlap, they agree
            whole[..., y : y + 3, x : x + 3] = nine[:, y, x]
    return whole[window_ids.numpy()][ids.numpy()]


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
    assert take_apart(views).ids.shape == tuple(leading)


def test_every_window_of_the_real_world_can_be_put_together_again() -> None:
    """Brute force; and there are few of them, which is the point."""
    views = real_views()
    np.testing.assert_array_equal(windows_put_together(views), windows_by_hand(views.numpy()))
    found = take_apart(views)
    assert len(found.window_ids) < 400 and len(found.patch_ids) < 700 and len(found.patches) < 100


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_what_is_called_distinct_is_distinct_and_occurs(channels: int) -> None:
    """NumPy's `unique` over whole views, windows and patches."""
    for views in (random_views(30, channels, share=0.02), random_views(4, channels), real_views()):
        ids, window_ids, patch_ids, patches = take_apart(views)
        by_hand = windows_by_hand(views.numpy())
        pictures = np.unique(views.numpy(), axis=0)
        assert len(window_ids) == len(pictures) and set(ids.tolist()) == set(range(len(pictures)))
        windows = np.unique(by_hand.reshape(-1, *by_hand.shape[-3:]), axis=0)
        assert len(patch_ids) == len(windows) and set(window_ids.flatten().tolist()) == set(range(len(windows)))
        cut = np.concatenate([windows[..., y : y + 3, x : x + 3] for y in range(3) for x in range(3)])
        expected = np.unique(cut.reshape(len(cut), -1), axis=0)
        assert len(patches) == len(expected) == len(torch.unique(patches, dim=0))
        assert set(patch_ids.flatten().tolist()) == set(range(len(patches)))


def test_select_keeps_some_views_and_what_they_are_made_of() -> None:
    """Taking the same views apart alone, numbers and all."""
    views = real_views().view(1, 50, 10, 1, 11, 11)
    some = take_apart(views).select((slice(None), torch.tensor([4, 1]), slice(2, 5)))
    alone = take_apart(views[:, [4, 1], 2:5])
    np.testing.assert_array_equal(together(some), windows_by_hand(views[:, [4, 1], 2:5].numpy()))
    assert some.window_ids.shape == alone.window_ids.shape and some.patch_ids.shape == alone.patch_ids.shape
    assert some.window_ids.unique().tolist() == list(range(len(some.patch_ids)))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 60), st.integers(1, 121), st.integers(1, 6), st.integers(0, 10_000))
def test_distinct_rows(rows: int, pixels: int, kinds: int, seed: int) -> None:
    """NumPy's `unique`, for rows longer and shorter than what a number holds; each kind is found where it stands."""
    generator = torch.Generator().manual_seed(seed)
    few = torch.rand(kinds, pixels, generator=generator) < 0.5
    many = few[torch.randint(kinds, (rows,), generator=generator)]
    first, ids = distinct(many)
    assert len(first) == len(np.unique(many.numpy(), axis=0)) and len(ids) == rows
    assert (many[first][ids] == many).all()


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int8, torch.float32])
def test_only_booleans_are_taken(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match=rf"dtype {dtype}; they must be torch.bool"):
        take_apart(random_views(2, 1).to(dtype))
