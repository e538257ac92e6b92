"""Progress of work that was started from Python: a line that renews itself, or few plain lines (leaf)."""

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Update = Callable[..., None]
"""Called with the number of finished parts and, perhaps, a remark on the last of them."""

PLAIN_LINES = 5
"""Lines where no line can renew itself, such as in a file."""


@contextmanager
def reported(description: str, total: int, unit: str, plain: bool = True) -> Iterator[Update]:
    """Report progress while the block runs; yields a function to call with the number of finished `unit`s of `total`.

    A terminal and a notebook have one line that renews itself. Elsewhere there are few lines or, without `plain`, none.
    """
    stream, is_notebook = sys.stderr, type(sys.stdout).__module__.startswith("ipykernel")
    if is_notebook:
        stream = sys.stdout  # a notebook paints errors red
    if not (stream and (is_notebook or stream.isatty())):
        yield _lines(description, total, unit) if plain and stream else ignored
        return
    width = 0

    def update(finished: int, remark: str = "") -> None:
        nonlocal width
        line = _line(description, finished, total, unit, remark)[: shutil.get_terminal_size().columns - 1]
        print(f"\r{line:{width}}", end="", file=stream, flush=True)
        width = len(line)

    update(0)
    try:
        yield update
    finally:
        print(file=stream)


def ignored(finished: int, remark: str = "") -> None:
    """Show nothing."""


@contextmanager
def silent(description: str, total: int, unit: str, plain: bool = True) -> Iterator[Update]:
    """Report nothing; as `reported`."""
    yield ignored


def _lines(description: str, total: int, unit: str) -> Update:
    def update(finished: int, remark: str = "") -> None:
        if finished == total or finished * PLAIN_LINES // total > (finished - 1) * PLAIN_LINES // total:
            print(_line(description, finished, total, unit, remark), file=sys.stderr, flush=True)

    return update


def _line(description: str, finished: int, total: int, unit: str, remark: str) -> str:
    return ", ".join(filter(None, [f"{description}: {finished} of {total} {unit}", remark]))
