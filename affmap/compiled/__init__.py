"""Compiled loops over NumPy arrays (numba): where the time goes, without the time between PyTorch's calls.

Each has its reference elsewhere, in PyTorch or NumPy, which takes its place where numba is not installed, and in a
process that has switched them off.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec

_wanted = True


def use(wanted: bool) -> None:
    """Switch the compiled loops of this process on (where numba is installed) or off."""
    global _wanted
    _wanted = wanted


@contextmanager
def switched(wanted: bool) -> Iterator[None]:
    """Use compiled loops or not, inside a `with` statement or a decorated function."""
    before = _wanted
    use(wanted)
    try:
        yield
    finally:
        use(before)


def enabled() -> bool:
    """Whether compiled loops are to be used: numba is installed, and nobody has switched them off."""
    return _wanted and installed()


@cache
def installed() -> bool:
    """Whether numba can compile; `NUMBA_DISABLE_JIT=1` is its own switch, for debugging."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0") and find_spec("numba") is not None
