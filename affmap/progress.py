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
def reported(description: str, total: int, unit: str, on_terminal_only: bool = False) -> Iterator[Update]:
    """Report progress while the block runs; yields a function to call with the number of finished `unit`s of `total`.

    A terminal and a notebook have one line that renews itself; elsewhere there are few lines.
    """
    is_terminal, is_notebook = bool(sys.stderr and sys.stderr.isatty()), _is_notebook()
    if not sys.stderr or (on_terminal_only and not is_terminal):
        yield ignored
        return
    if not (is_terminal or is_notebook):
        yield _lines(description, total, unit)
        return
    stream = sys.stdout if is_notebook else sys.stderr  # a notebook paints errors red
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
def silent(description: str, total: int, unit: str, on_terminal_only: bool = False) -> Iterator[Update]:
    """Report nothing; as `reported`."""
    yield ignored


def _is_notebook() -> bool:
    return type(sys.stdout).__module__.startswith("ipykernel")


def _lines(description: str, total: int, unit: str) -> Update:
    def update(finished: int, remark: str = "") -> None:
        if finished == total or finished * PLAIN_LINES // total > (finished - 1) * PLAIN_LINES // total:
            print(_line(description, finished, total, unit, remark), file=sys.stderr, flush=True)

    return update


def _line(description: str, finished: int, total: int, unit: str, remark: str) -> str:
    return ", ".join(filter(None, [f"{description}: {finished} of {total} {unit}", remark]))
