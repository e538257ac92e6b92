"""Views painted in compiled code, pixel by pixel.

The reference is `affmap.view`: the same comparisons in the same precision, so that all pixels are equal. Layouts are
given by the arrays of `affmap.view.LayoutArrays`, in the precision of the positions.
"""

import numpy as np

from affmap.compiled.jit import compiled, inlined


@inlined
def _least_square(first: np.floating, last: np.floating) -> np.floating:
    """The smallest square of any number between two."""
    return min(first * first, last * last) if first * last > 0 else first - first


@inlined
def paint(
    position: np.ndarray,
    offsets: np.ndarray,
    size: np.ndarray,
    border_channel: int,
    circles: np.ndarray,
    channels: np.ndarray,
    squares: np.ndarray,
    rows: np.ndarray,
) -> None:
    """Paint the view at `position` `[2]` into `rows` `[K, 11]`: bit c is the pixel in column c.

    `squares` `[11]` is for squared distances of columns from the centre of a circle.
    """
    pixels = len(offsets)
    outside = np.uint64(0)
    for column in range(pixels):
        x = position[0] + offsets[column]
        outside |= np.uint64(x < 0 or x > size[0]) << np.uint64(column)
    rows[:] = 0
    for row in range(pixels):
        y = position[1] + offsets[row]
        rows[border_channel, row] = np.uint64(2**pixels - 1) if y < 0 or y > size[1] else outside
    for number in range(len(circles)):
        center_x, center_y, squared_radius = circles[number]
        # Rounding never changes the order of two numbers: a circle that misses the nearest column and row has no pixel.
        near_x = _least_square(position[0] + offsets[0] - center_x, position[0] + offsets[-1] - center_x)
        near_y = _least_square(position[1] + offsets[0] - center_y, position[1] + offsets[-1] - center_y)
        if near_x > squared_radius - near_y:
            continue
        for column in range(pixels):
            distance = position[0] + offsets[column] - center_x
            squares[column] = distance * distance
        for row in range(pixels):
            distance = position[1] + offsets[row] - center_y
            limit = squared_radius - distance * distance
            inside = np.uint64(0)
            for column in range(pixels):
                inside |= np.uint64(squares[column] <= limit) << np.uint64(column)
            rows[channels[number], row] |= inside


@compiled
def cut(
    positions: np.ndarray,
    offsets: np.ndarray,
    size: np.ndarray,
    border_channel: int,
    circles: np.ndarray,
    channels: np.ndarray,
    views: np.ndarray,
) -> None:
    """Cut out the views of a layout at `positions` `[P, 2]` (u) into `views` `[P, K, 11, 11]` bool."""
    squares, rows = np.empty_like(offsets), np.empty(views.shape[1:3], np.uint64)
    for place in range(len(positions)):
        paint(positions[place], offsets, size, border_channel, circles, channels, squares, rows)
        for channel in range(views.shape[1]):
            for row in range(views.shape[2]):
                for column in range(views.shape[3]):
                    views[place, channel, row, column] = rows[channel, row] >> np.uint64(column) & np.uint64(1)
