"""Progress of long work: a bar in a terminal, plain lines elsewhere, or as `displayed` says."""

import logging
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from affmap.progress import Update

log = logging.getLogger("affmap")

Display = Callable[[str, int, str], AbstractContextManager[Update]]
"""From description, total and unit, a context that yields a function to call with finished parts and a remark."""

_display: ContextVar[Display | None] = ContextVar("_display", default=None)

SECONDS_BETWEEN_LINES = 15


@contextmanager
def track(
    description: str, total: int, unit: str, note: Callable[[int, int], None] = lambda finished, total: None
) -> Iterator[Update]:
    """Show progress; yields a function to call with the number of finished `unit`s, of `total`, and a remark.

    `note` is called with both numbers, to record them elsewhere.
    """
    # Workers of a parallel sweep share the terminal: their bars would overwrite each other.
    has_terminal = multiprocessing.current_process().name == "MainProcess" and bool(sys.stdout and sys.stdout.isatty())
    display = _display.get() or (_bar if has_terminal else _lines)
    with display(description, total, unit) as show:

        def update(finished: int, remark: str = "") -> None:
            show(finished, remark)
            note(finished, total)

        yield update


@contextmanager
def displayed(display: Display) -> Iterator[None]:
    """Let all progress be shown by `display` while the block runs."""
    token = _display.set(display)
    try:
        yield
    finally:
        _display.reset(token)


@contextmanager
def _bar(description: str, total: int, unit: str) -> Iterator[Update]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TextColumn("{task.fields[remark]}", markup=False),
        TimeRemainingColumn(),
    )
    with Progress(*columns) as progress:
        task = progress.add_task(description, total=total, remark="")
        yield lambda finished, remark="": progress.update(task, completed=finished, remark=remark)


@contextmanager
def _lines(description: str, total: int, unit: str) -> Iterator[Update]:
    last = time.monotonic()
    first: tuple[int, float] | None = None

    def update(finished: int, remark: str = "") -> None:
        nonlocal last, first
        now = time.monotonic()
        if first is None:  # a resumed training does not begin at zero
            first = finished, now
        elif now - last > SECONDS_BETWEEN_LINES and finished < total:
            left = round((now - first[1]) / (finished - first[0]) * (total - finished))
            done = f"{finished} of {total} {unit}{remark and ', '}{remark}"
            log.info("%s: %s, %d:%02d left", description, done, *divmod(left, 60))
            last = now

    log.info("%s: %d %s", description, total, unit)
    yield update
