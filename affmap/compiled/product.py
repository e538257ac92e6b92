"""Products of small matrices, at the rate at which the processor multiplies.

A vector holds eight columns of the result; four rows of two vectors, or eight rows of one, stay in registers while the
sums grow. Matrices are flat arrays of float32, row by row.
"""

from typing import Any, NamedTuple

from affmap.compiled.jit import compiled, inlined
from affmap.compiled.lanes import WIDTH, broadcast, fma, load, store


class Matrix(NamedTuple):
    """A matrix in a flat array; transposed, or all rows the same, without a copy."""

    numbers: Any
    row: int
    """Numbers from one row to the next."""
    column: int
    """Numbers from one column to the next."""


class Shape(NamedTuple):
    """The shape of a product: `[rows, depth]` times `[depth, width]`."""

    rows: int
    """A multiple of 8."""
    depth: int
    width: int
    """A multiple of 8."""


@compiled
def product(start: Matrix, a: Matrix, b: Any, c: Any, shape: Shape) -> None:
    """Write `start + a b` into `c`; `b` and `c` stand row by row, and so do the columns of `start`."""
    rows, depth, width = shape
    step, row, column = start.row, a.row, a.column
    for v in range(0, width - WIDTH, 2 * WIDTH):
        for r in range(0, rows, 4):
            s, p, place = r * step + v, r * row, r * width + v
            _four_rows(start.numbers, s, step, a.numbers, p, row, column, b, v, depth, c, place, width)
    if width % (2 * WIDTH):
        v = width - WIDTH
        for r in range(0, rows, 8):
            s, p, place = r * step + v, r * row, r * width + v
            _eight_rows(start.numbers, s, step, a.numbers, p, row, column, b, v, depth, c, place, width)


@inlined
def _four_rows(
    start: Any,
    s: int,
    step: int,
    a: Any,
    p: int,
    row: int,
    column: int,
    b: Any,
    v: int,
    depth: int,
    c: Any,
    r: int,
    width: int,
) -> None:
    """Sixteen columns of four rows; they begin at `s`, `p`, `v` and `r` in their arrays."""
    a0, b0 = load(start, s), load(start, s + WIDTH)
    a1, b1 = load(start, s + step), load(start, s + step + WIDTH)
    a2, b2 = load(start, s + 2 * step), load(start, s + 2 * step + WIDTH)
    a3, b3 = load(start, s + 3 * step), load(start, s + 3 * step + WIDTH)
    for _ in range(depth):
        left, right = load(b, v), load(b, v + WIDTH)
        factor = broadcast(a, p)
        a0, b0 = fma(left, factor, a0), fma(right, factor, b0)
        factor = broadcast(a, p + row)
        a1, b1 = fma(left, factor, a1), fma(right, factor, b1)
        factor = broadcast(a, p + 2 * row)
        a2, b2 = fma(left, factor, a2), fma(right, factor, b2)
        factor = broadcast(a, p + 3 * row)
        a3, b3 = fma(left, factor, a3), fma(right, factor, b3)
        p += column
        v += width
    store(c, r, a0)
    store(c, r + WIDTH, b0)
    store(c, r + width, a1)
    store(c, r + width + WIDTH, b1)
    store(c, r + 2 * width, a2)
    store(c, r + 2 * width + WIDTH, b2)
    store(c, r + 3 * width, a3)
    store(c, r + 3 * width + WIDTH, b3)


@inlined
def _eight_rows(
    start: Any,
    s: int,
    step: int,
    a: Any,
    p: int,
    row: int,
    column: int,
    b: Any,
    v: int,
    depth: int,
    c: Any,
    r: int,
    width: int,
) -> None:
    """Eight columns of eight rows; they begin at `s`, `p`, `v` and `r` in their arrays."""
    a0, a1 = load(start, s), load(start, s + step)
    a2, a3 = load(start, s + 2 * step), load(start, s + 3 * step)
    a4, a5 = load(start, s + 4 * step), load(start, s + 5 * step)
    a6, a7 = load(start, s + 6 * step), load(start, s + 7 * step)
    for _ in range(depth):
        factors = load(b, v)
        a0, a1 = fma(factors, broadcast(a, p), a0), fma(factors, broadcast(a, p + row), a1)
        a2, a3 = fma(factors, broadcast(a, p + 2 * row), a2), fma(factors, broadcast(a, p + 3 * row), a3)
        a4, a5 = fma(factors, broadcast(a, p + 4 * row), a4), fma(factors, broadcast(a, p + 5 * row), a5)
        a6, a7 = fma(factors, broadcast(a, p + 6 * row), a6), fma(factors, broadcast(a, p + 7 * row), a7)
        p += column
        v += width
    store(c, r, a0)
    store(c, r + width, a1)
    store(c, r + 2 * width, a2)
    store(c, r + 3 * width, a3)
    store(c, r + 4 * width, a4)
    store(c, r + 5 * width, a5)
    store(c, r + 6 * width, a6)
    store(c, r + 7 * width, a7)
