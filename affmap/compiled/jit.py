"""Compilation of loops by numba, kept on disk so that only the first command of a machine waits for it.

Importing this module needs numba; `affmap.compiled.enabled` tells whether it is there.
"""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache

F = TypeVar("F", bound=Callable[..., Any])


def _sources() -> str:
    """The digest of all code of this folder: numba looks at a function's own file only, not at those that it calls."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_SOURCES = _sources()


class _Cache(FunctionCache):
    """A cache of compiled code on disk, valid for all code of this folder; failures to read or write are ignored."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = _SOURCES

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # a corrupted file may raise anything
            self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk
            super().save_overload(sig, data)


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function at its first call, or find it compiled on disk.

    The interpreter's lock is released while it runs. Where no folder can be written to, it is compiled in each process.
    """
    dispatcher = numba.njit(nogil=True, error_model="numpy")(function)
    with suppress(RuntimeError):  # numba finds no folder for its files
        dispatcher._cache = _Cache(function)
    return dispatcher


def inlined(function: F) -> F:
    """Compile a function into those that call it."""
    return numba.njit(forceinline=True, error_model="numpy")(function)
