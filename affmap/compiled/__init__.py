"""Compiled loops over NumPy arrays (numba): where the time goes, without the time between PyTorch's calls.

Each has its reference elsewhere, in PyTorch or NumPy, which is used where numba is not installed.
"""

from functools import cache
from importlib.util import find_spec


@cache
def available() -> bool:
    """Whether numba is installed."""
    return find_spec("numba") is not None
