"""Compiled loops over NumPy arrays (numba), for the inner loops: they avoid the overhead of PyTorch's calls.

Each has a reference elsewhere, in PyTorch or NumPy, which replaces it where numba is not installed or compiled loops
are switched off.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec

_switch = True


def use(switch: bool) -> None:
    """Switch the compiled loops of this process on (where numba is installed) or off."""
    global _switch
    _switch = switch


@contextmanager
def switched(switch: bool) -> Iterator[None]:
    """Use compiled loops or not, inside a `with` statement or a decorated function."""
    before = _switch
    use(switch)
    try:
        yield
    finally:
        use(before)


def enabled() -> bool:
    """Whether compiled loops are used: numba is installed, and they are not switched off."""
    return _switch and installed()


@cache
def installed() -> bool:
    """Whether numba can compile; `NUMBA_DISABLE_JIT=1` is its own switch, for debugging."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0") and find_spec("numba") is not None
