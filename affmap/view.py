"""Local views of a layout: the one function by which both environment and look-up see it (leaf).

It works on NumPy arrays and on torch tensors alike, and knows neither physics nor models. On the CPU views are cut out
in compiled code, elsewhere (and without numba) by the array's own library; all pixels are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from array_api_compat import array_namespace

from affmap import compiled

PIXELS = 11
"""Width and height of a view in pixels (Appendix A)."""

EXTENT = 0.5
"""Width and height of a view in u (Appendix A)."""


class LayoutArrays(NamedTuple):
    """A visible layout in one precision, as arguments of compiled code."""

    offsets: np.ndarray
    """`[11]`, from a position to the centres of pixels, along either axis, u."""
    size: np.ndarray
    """`[2]`, width and height of the arena, u."""
    border_channel: int
    """Channel that everything outside the arena is painted in."""
    circles: np.ndarray
    """`[N, 3]`, centre x and centre y in u, squared radius in u^2."""
    channels: np.ndarray
    """`[N]`, channel of each circle."""


@dataclass(frozen=True)
class VisibleLayout:
    """The visible part of a layout: painted circles, and everything outside the arena."""

    size: tuple[float, float]
    """Width and height of the arena, u; its lower left corner is the origin."""
    num_channels: int
    """K, number of channels of a view."""
    border_channel: int
    """Channel that everything outside the arena is painted in."""
    circles: tuple[tuple[float, float, float, int], ...]
    """Centre x, centre y and radius in u, and channel, of each painted circle."""
    keys: tuple[tuple[float, float, float], ...] = ()
    """Centre x, centre y and radius in u of each circle where a visit opens the doors; none without doors."""
    opened: VisibleLayout | None = None
    """The visible layout once they are open; None without doors."""
    hidden: tuple[tuple[float, float, float], ...] = ()
    """Centre x, centre y and radius in u of each circle from inside which nothing is seen; none if all is."""

    @cached_property
    def arrays(self) -> dict[np.dtype, LayoutArrays]:
        """The arrays of the layout for positions of float32 and of float64."""
        return {np.dtype(dtype): self._round(dtype) for dtype in (np.float32, np.float64)}

    def at_key(self, positions: np.ndarray) -> np.ndarray:
        """Whether positions `[..., 2]` (u) are inside a key: `[...]`."""
        inside = np.zeros(positions.shape[:-1], bool)
        for x, y, radius in self.keys:
            inside |= np.hypot(positions[..., 0] - x, positions[..., 1] - y) < radius
        return inside

    def is_hidden(self, positions: Any) -> Any:
        """Whether nothing is seen from positions `[..., 2]` (u): `[...]`, of the same library."""
        xp = array_namespace(positions)
        x, y = positions[..., 0], positions[..., 1]
        result = xp.zeros_like(x, dtype=xp.bool)
        for center_x, center_y, radius in self.hidden:
            result = result | ((x - center_x) ** 2 + (y - center_y) ** 2 < radius**2)
        return result

    def _round(self, dtype: type[np.floating]) -> LayoutArrays:
        circles = np.array([(x, y, radius**2) for x, y, radius, _ in self.circles], dtype).reshape(-1, 3)
        channels = np.array([channel for *_, channel in self.circles], np.int64)
        size = np.array(self.size, dtype)
        return LayoutArrays(_offsets(np, dtype, None), size, self.border_channel, circles, channels)


def view(layout: VisibleLayout, positions: Any) -> Any:
    """Cut out the square around each position (Appendix A).

    A pixel is set where its centre lies in a painted circle or outside the arena. The vehicle itself is not drawn.

    Args:
        layout: the visible layout, such as `Layout.map`.
        positions: `[..., 2]` in u, NumPy array or torch tensor of floats.

    Returns:
        `[..., K, 11, 11]` bool, of the same library as `positions`; rows go upward (row 0 has the smallest y),
        columns to the right.
    """
    pictures = _cut(layout, positions)
    if layout.hidden:
        pictures[layout.is_hidden(positions)] = False
    return pictures


def _cut(layout: VisibleLayout, positions: Any) -> Any:
    """Cut out views where all is seen, see `view`."""
    places = for_compiled(positions)
    if places is None:
        return _draw(layout, positions)
    from affmap.compiled.views import cut

    pictures = np.empty((len(places), layout.num_channels, PIXELS, PIXELS), bool)
    cut(places, *layout.arrays[places.dtype], pictures)
    pictures = pictures.reshape(*positions.shape[:-1], *pictures.shape[1:])
    return pictures if isinstance(positions, np.ndarray) else array_namespace(positions).asarray(pictures, device="cpu")


def views(layouts: Sequence[VisibleLayout], positions: Any) -> Any:
    """Views at `positions` `[B, ..., 2]` in B layouts, or in a single one for all: `[B, ..., K, 11, 11]`.

    Raises:
        ValueError: another number of layouts.
    """
    if len(layouts) == 1:
        return view(layouts[0], positions)
    if len(layouts) != len(positions):
        raise ValueError(
            f"there are {len(layouts)} layouts; give one, or {len(positions)}, as many as there are positions."
        )
    xp = array_namespace(positions)
    return xp.stack([view(layout, own) for layout, own in zip(layouts, positions, strict=True)])


def for_compiled(positions: Any) -> np.ndarray | None:
    """Positions `[..., 2]` as an array `[P, 2]` for compiled code; None where that cannot be used."""
    if not compiled.enabled():
        return None
    if not isinstance(positions, np.ndarray):
        xp = array_namespace(positions)
        if str(positions.device) != "cpu" or positions.dtype not in (xp.float32, xp.float64):
            return None
        positions = positions.detach().numpy()
    if positions.dtype not in (np.float32, np.float64):
        return None
    # One kind of array only, since code is compiled for each kind.
    return np.asarray(positions if positions.flags.carray else positions.copy()).reshape(-1, 2)


def _offsets(xp: Any, dtype: Any, device: Any) -> Any:
    """From a position to the centres of pixels, along either axis: `[11]` in u."""
    return (xp.arange(PIXELS, dtype=dtype, device=device) - PIXELS // 2) * (EXTENT / PIXELS)


def _draw(layout: VisibleLayout, positions: Any) -> Any:
    """Draw views with the array's own library; see `view`."""
    xp = array_namespace(positions)
    # Positions are last while pixels are drawn: many positions make long rows, which is several times as fast.
    offsets = _offsets(xp, positions.dtype, positions.device)
    offsets = xp.reshape(offsets, (PIXELS, *[1] * (positions.ndim - 1)))
    x = positions[..., 0] + offsets  # [11, ...]
    y = (positions[..., 1] + offsets)[:, None]  # [11, 1, ...]
    width, height = layout.size
    border = (x < 0) | (x > width) | (y < 0) | (y > height)  # [11, 11, ...]
    channels = [xp.zeros_like(border) for _ in range(layout.num_channels)]
    channels[layout.border_channel] = border
    for center_x, center_y, radius, channel in layout.circles:
        # Pythagoras, arranged so that the only large arrays are of booleans.
        channels[channel] = channels[channel] | ((x - center_x) ** 2 <= radius**2 - (y - center_y) ** 2)
    picture = xp.stack(channels)  # [K, 11, 11, ...]
    return xp.permute_dims(picture, (*range(3, picture.ndim), 0, 1, 2))
