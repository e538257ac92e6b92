"""Compilation of loops by numba, kept on disk so that only the first command of a machine waits for it.

Importing this module needs numba; `affmap.compiled.available` tells whether it is there.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def _sources() -> str:
    """The digest of all code of this folder: numba looks at a function's own file only, not at those that it calls."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_SOURCES = _sources()


def compiled(function: F) -> F:
    """Compile a function at its first call, or find it compiled on disk.

    The interpreter's lock is released while it runs. Where no folder can be written to, it is compiled in each process.
    """
    try:
        dispatcher = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # numba finds no folder for its files
        return numba.njit(nogil=True, error_model="numpy")(function)
    dispatcher._cache._cache_file._source_stamp = _SOURCES
    return dispatcher


def inlined(function: F) -> F:
    """Compile a function into those that call it."""
    return numba.njit(forceinline=True, error_model="numpy")(function)
