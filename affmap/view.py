"""A map and positions -> local views: the one function that environment and look-up both see the world through (leaf).

It works on NumPy arrays and on torch tensors alike, and knows neither physics nor models. On the CPU views are cut out
in compiled code, elsewhere (and without numba) by the array's own library; all pixels are the same.
"""

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


class Scene(NamedTuple):
    """A map as numbers of one precision, as the arguments of compiled code."""

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
class Map:
    """What can be seen of a world: painted circles, and everything outside the arena."""

    size: tuple[float, float]
    """Width and height of the arena, u; its lower left corner is the origin."""
    num_channels: int
    """K, number of channels of a view."""
    border_channel: int
    """Channel that everything outside the arena is painted in."""
    circles: tuple[tuple[float, float, float, int], ...]
    """Centre x, centre y and radius in u, and channel, of each painted circle."""

    @cached_property
    def scenes(self) -> dict[np.dtype, Scene]:
        """The same map as numbers, for positions of float32 and of float64."""
        return {np.dtype(dtype): self._rounded(dtype) for dtype in (np.float32, np.float64)}

    def _rounded(self, dtype: type[np.floating]) -> Scene:
        circles = np.array([(x, y, radius**2) for x, y, radius, _ in self.circles], dtype).reshape(-1, 3)
        channels = np.array([channel for *_, channel in self.circles], np.int64)
        return Scene(_offsets(np, dtype, None), np.array(self.size, dtype), self.border_channel, circles, channels)


def view(world: Map, positions: Any) -> Any:
    """Cut the square around each position out of a map (Appendix A).

    A pixel is set where its centre lies in a painted circle or outside the arena. The vehicle itself is not drawn.

    Args:
        world: the map.
        positions: `[..., 2]` in u, NumPy array or torch tensor of floats.

    Returns:
        `[..., K, 11, 11]` bool, of the same library as `positions`; rows go upward (row 0 has the smallest y),
        columns to the right.
    """
    places = for_compiled(positions)
    if places is None:
        return _draw(world, positions)
    from affmap.compiled.views import cut

    pictures = np.empty((len(places), world.num_channels, PIXELS, PIXELS), bool)
    cut(places, *world.scenes[places.dtype], pictures)
    pictures = pictures.reshape(*positions.shape[:-1], *pictures.shape[1:])
    return pictures if isinstance(positions, np.ndarray) else array_namespace(positions).asarray(pictures)


def views(worlds: Sequence[Map], positions: Any) -> Any:
    """Views in several worlds: B maps and `positions` `[B, ..., 2]`, or a single map for all: `[B, ..., K, 11, 11]`.

    Raises:
        ValueError: another number of maps.
    """
    if len(worlds) == 1:
        return view(worlds[0], positions)
    if len(worlds) != len(positions):
        raise ValueError(
            f"there are {len(worlds)} maps; give one, or {len(positions)}, as many as there are positions."
        )
    xp = array_namespace(positions)
    return xp.stack([view(world, of_world) for world, of_world in zip(worlds, positions, strict=True)])


def for_compiled(positions: Any) -> np.ndarray | None:
    """Positions `[..., 2]` as compiled code takes them, `[P, 2]`; None where it does not."""
    if not compiled.enabled():
        return None
    if not isinstance(positions, np.ndarray):
        xp = array_namespace(positions)
        if str(positions.device) != "cpu" or positions.dtype not in (xp.float32, xp.float64):
            return None
        positions = positions.detach().numpy()
    if positions.dtype not in (np.float32, np.float64):
        return None
    # Code is compiled for each kind of array: let there be one.
    return np.asarray(positions if positions.flags.carray else positions.copy()).reshape(-1, 2)


def _offsets(xp: Any, dtype: Any, device: Any) -> Any:
    """From a position to the centres of pixels, along either axis: `[11]` in u."""
    return (xp.arange(PIXELS, dtype=dtype, device=device) - PIXELS // 2) * (EXTENT / PIXELS)


def _draw(world: Map, positions: Any) -> Any:
    """The views as `view` returns them, by the array's own library."""
    xp = array_namespace(positions)
    # Positions are last while pixels are drawn: many positions make long rows, which is several times as fast.
    offsets = _offsets(xp, positions.dtype, positions.device)
    offsets = xp.reshape(offsets, (PIXELS, *[1] * (positions.ndim - 1)))
    x = positions[..., 0] + offsets  # [11, ...]
    y = (positions[..., 1] + offsets)[:, None]  # [11, 1, ...]
    width, height = world.size
    border = (x < 0) | (x > width) | (y < 0) | (y > height)  # [11, 11, ...]
    channels = [xp.zeros_like(border) for _ in range(world.num_channels)]
    channels[world.border_channel] = border
    for center_x, center_y, radius, channel in world.circles:
        # Pythagoras, arranged so that the only large arrays are of booleans.
        channels[channel] = channels[channel] | ((x - center_x) ** 2 <= radius**2 - (y - center_y) ** 2)
    picture = xp.stack(channels)  # [K, 11, 11, ...]
    return xp.permute_dims(picture, (*range(3, picture.ndim), 0, 1, 2))
