"""Progress of long work: a bar in a terminal, plain lines elsewhere, or as `displayed` says."""

import logging
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from threading import Event, Thread
from typing import NamedTuple

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from affmap.progress import Update

log = logging.getLogger("affmap")

Display = Callable[[str, int, str], AbstractContextManager[Update]]
"""From description, total and unit, a context that yields a function to call with finished parts and a remark."""

_display: ContextVar[Display | None] = ContextVar("_display", default=None)

SECONDS_BETWEEN_LINES = 15
SECONDS_BETWEEN_LOOKS = 1
SECONDS_OF_SILENCE = 120
"""After so long a line comes even if no further setting is complete."""


class Overview(NamedTuple):
    """The progress of a sweep."""

    settings: int
    """Settings that are complete."""
    num_settings: int
    stages: int
    """Stages that are complete; one that several settings share is counted once."""
    num_stages: int
    work: float
    """The same, with fractions of those that are not."""
    seconds_left: float | None
    """None if unknown."""

    def __str__(self) -> str:
        """The numbers in words."""
        is_known = self.seconds_left is not None and self.stages < self.num_stages
        left = f", {duration(self.seconds_left)} left" if is_known else ""
        return (
            f"{self.settings} of {self.num_settings} settings, {self.stages} of {self.num_stages} stages complete{left}"
        )


def duration(seconds: float | None) -> str:
    """Hours, minutes and seconds; a question mark if unknown."""
    if seconds is None:
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


@contextmanager
def follow(description: str, look: Callable[[], Overview]) -> Iterator[None]:
    """Show the progress of jobs in other processes while the block runs: a bar in a terminal, few lines elsewhere.

    `look` reads it, again and again, in a thread of its own.
    """
    stop = Event()
    with (_overall_bar if _has_terminal() else _few_lines)(description, look()) as show:

        def watch() -> None:
            pause = float(SECONDS_BETWEEN_LOOKS)
            while not stop.wait(pause):
                begin = time.monotonic()
                with suppress(OSError):  # a folder was renamed meanwhile
                    show(look())
                pause = max(SECONDS_BETWEEN_LOOKS, 20 * (time.monotonic() - begin))  # of thousands of settings

        thread = Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(SECONDS_BETWEEN_LOOKS)
        show(look())


@contextmanager
def _overall_bar(description: str, first: Overview) -> Iterator[Callable[[Overview], None]]:
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, redirect_stdout=False, redirect_stderr=False) as progress:
        task = progress.add_task(description, total=first.num_stages, text=str(first))
        progress.update(task, completed=first.work)
        yield lambda now: progress.update(task, completed=now.work, text=str(now))


@contextmanager
def _few_lines(description: str, first: Overview) -> Iterator[Callable[[Overview], None]]:
    settings, last = first.settings, time.monotonic()

    def show(now: Overview) -> None:
        nonlocal settings, last
        silence = time.monotonic() - last
        is_news = now.settings > settings and silence > SECONDS_BETWEEN_LINES
        if now.settings < now.num_settings and (is_news or silence > SECONDS_OF_SILENCE):
            print(f"{description}: {now}", flush=True)
            settings, last = now.settings, time.monotonic()

    yield show


def _has_terminal() -> bool:
    return bool(sys.stdout and sys.stdout.isatty())


@contextmanager
def track(
    description: str, total: int, unit: str, note: Callable[[int, int], None] = lambda finished, total: None
) -> Iterator[Update]:
    """Show progress; yields a function to call with the number of finished `unit`s, of `total`, and a remark.

    `note` is called with both numbers, to record them elsewhere.
    """
    # Workers of a parallel sweep share the terminal: their bars would overwrite each other.
    has_terminal = multiprocessing.current_process().name == "MainProcess" and _has_terminal()
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
