"""A map and positions -> local views: the one function that environment and look-up both see the world through (leaf).

It works on NumPy arrays and on torch tensors alike, and knows neither physics nor models.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from array_api_compat import array_namespace

PIXELS = 11
"""Width and height of a view in pixels (Appendix A)."""

EXTENT = 0.5
"""Width and height of a view in u (Appendix A)."""


class Map(NamedTuple):
    """What can be seen of a world: painted circles, and everything outside the arena."""

    size: tuple[float, float]
    """Width and height of the arena, u; its lower left corner is the origin."""
    num_channels: int
    """K, number of channels of a view."""
    border_channel: int
    """Channel that everything outside the arena is painted in."""
    circles: tuple[tuple[float, float, float, int], ...]
    """Centre x, centre y and radius in u, and channel, of each painted circle."""


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
    xp = array_namespace(positions)
    pitch = EXTENT / PIXELS
    offsets = (xp.arange(PIXELS, dtype=positions.dtype, device=positions.device) - PIXELS // 2) * pitch
    # Positions are last while pixels are drawn: many positions make long rows, which is several times as fast.
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
