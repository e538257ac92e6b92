"""Progress of long work: a bar in a terminal, plain lines elsewhere (leaf)."""

import logging
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

log = logging.getLogger("affmap")

SECONDS_BETWEEN_LINES = 15


@contextmanager
def track(
    description: str, total: int, unit: str, note: Callable[[int, int], None] = lambda finished, total: None
) -> Iterator[Callable[[int], None]]:
    """Show progress; yields a function to call with the number of finished `unit`s, out of `total`.

    `note` is called with both numbers, to record them elsewhere.
    """
    # Workers of a parallel sweep share the terminal: their bars would overwrite each other.
    has_terminal = multiprocessing.current_process().name == "MainProcess" and bool(sys.stdout and sys.stdout.isatty())
    with (_bar if has_terminal else _lines)(description, total, unit) as show:

        def update(finished: int) -> None:
            show(finished)
            note(finished, total)

        yield update


@contextmanager
def _bar(description: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(),
    )
    with Progress(*columns) as progress:
        task = progress.add_task(description, total=total)
        yield lambda finished: progress.update(task, completed=finished)


@contextmanager
def _lines(description: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    last = time.monotonic()
    first: tuple[int, float] | None = None

    def update(finished: int) -> None:
        nonlocal last, first
        now = time.monotonic()
        if first is None:  # a resumed training does not begin at zero
            first = finished, now
        elif now - last > SECONDS_BETWEEN_LINES and finished < total:
            left = round((now - first[1]) / (finished - first[0]) * (total - finished))
            log.info("%s: %d of %d %s, %d:%02d left", description, finished, total, unit, *divmod(left, 60))
            last = now

    log.info("%s: %d %s", description, total, unit)
    yield update
