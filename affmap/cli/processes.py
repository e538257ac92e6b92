"""The ends of a command's processes: signals, workers, a parent that is gone."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path


class Terminated(SystemExit):
    """SIGTERM was received."""

    code: int


@contextmanager
def sigterm_ends_process() -> Iterator[None]:
    """Let SIGTERM, a scheduler's warning, end the process in the block as Ctrl-C does: at once, with locks released.

    A launcher with a handler of its own keeps it.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(number: int, _frame: object) -> None:
    raise Terminated(128 + number)


def interruption(error: BaseException) -> BaseException | None:
    """The signal that caused an error, if one did: libraries may fail with an error of their own when interrupted."""
    cause: BaseException | None = error
    while cause:
        if isinstance(cause, (KeyboardInterrupt, Terminated)):
            return cause
        cause = cause.__context__ or cause.__cause__
    return None


@contextmanager
def sigint_spares_workers() -> Iterator[None]:
    """Let Ctrl-C, which a terminal sends to all of its processes, end none that is started in the block.

    Else workers would print the errors of whatever it interrupts, such as imports. The command kills them.
    """
    resource_tracker.ensure_running()  # else a worker needs it, and Pythons before 3.14 start it and block nothing more
    is_over = threading.Event()
    # Python calls handlers in the main thread, whichever thread receives the signal: this one, which does not block it.
    threading.Thread(target=is_over.wait, name="affmap: hears Ctrl-C", daemon=True).start()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes inherit what a thread blocks
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        is_over.set()


def kill_workers() -> None:
    """End all worker processes at once."""
    for worker in _workers():
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)


def _workers() -> set[int]:
    """Processes of workers, also of one that was just being started, which only the system knows."""
    workers = {int(worker.pid or 0) for worker in multiprocessing.active_children()} - {0}
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            # The tracker of shared semaphores ends by itself, and removes them.
            if parent == os.getpid() and b"resource_tracker" not in (path / "cmdline").read_bytes():
                workers.add(int(path.name))
    return workers


def end_with_parent() -> None:
    """Let a worker process exit when its command is killed: nobody would receive its results."""
    is_main = multiprocessing.current_process().name == "MainProcess"
    if is_main or _WATCH in {thread.name for thread in threading.enumerate()}:
        return
    threading.Thread(target=_watch, args=(os.getppid(),), name=_WATCH, daemon=True).start()


_WATCH = "affmap: is the parent there?"


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
