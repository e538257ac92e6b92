"""The references of compiled loops, where numba is installed."""

from collections.abc import Iterator
from contextlib import contextmanager

from affmap import compiled


@contextmanager
def interpreted() -> Iterator[None]:
    """Without compiled loops."""
    compiled.use(False)
    try:
        yield
    finally:
        compiled.use(True)
