"""The frame of all commands: the command line, errors as sentences, exit statuses, signals."""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from affmap.config.sweep import Sweep
from affmap.pipeline.job import check_members
from affmap.settings.messages import ConfigError
from affmap.store.stage import StoreError

MULTIRUN = ("-m", "--multirun")
"""Hydra's flag for sweeps; it is set where it is needed, whether it is given or not."""


class SweepError(Exception):
    """Some settings of a sweep have not been completed; the message names each."""


def command(
    body: Callable[[list[str]], None], known: Collection[str] = (), about: str | None = None, goes_on: bool = True
) -> None:
    """Run `body` on the command line's overrides; what goes wrong is told in a sentence. Flags must be `known`.

    `about` is what `--help` says; `goes_on` tells whether the same command goes on from where a signal stopped it.

    Exit status: 2 for a mistake in the command line, 1 for what failed, 130 or 143 where a signal ended it.
    """
    if about and {"--help", "-h"} & {*flags()}:
        print(f"{about}\n\nIt takes Hydra overrides, such as experiment=exp1 or output=runs/mine.")
        return
    stopped = ["Stopped", "; the same command goes on from there." if goes_on else "."]
    try:
        with ended_by_scheduler():
            body(_overrides(known))
    except BaseException as error:
        match _first(error):
            case KeyboardInterrupt():
                _leave_at_once("".join(stopped), 128 + signal.SIGINT)
            case Terminated(code=code):
                _leave_at_once(" by a signal".join(stopped), code)
            case ConfigError() | HydraException() | OmegaConfBaseException():
                _leave(str(error), 2)
            case StoreError() | SweepError():
                _leave(str(error), 1)
            case BrokenPipeError():  # whoever read the output, such as `head`, has enough
                os._exit(128 + signal.SIGPIPE)
            case OSError(filename=name, strerror=reason):
                _leave(f"{name or 'A file'}: {reason or error}; mend that and run the same command again.", 1)
            case _:
                raise


def read_sweep(arguments: Sequence[str]) -> Sweep:
    """The sweep of a command line, checked.

    Raises:
        ConfigError: a value that is not allowed, or a member in two jobs; the message says what would be right.
    """
    sweep = Sweep.read(arguments)
    check_members(sweep.configs)
    return sweep


def _first(error: BaseException) -> BaseException:
    """The signal that an error follows from, for libraries stumble when they are interrupted; else the error itself."""
    before: BaseException | None = error
    while before:
        if isinstance(before, (KeyboardInterrupt, Terminated)):
            return before
        before = before.__context__
    return error


def flags() -> list[str]:
    """The flags of the command line, but for that of sweeps."""
    return [argument for argument in sys.argv[1:] if argument.startswith("-") and argument not in MULTIRUN]


def _overrides(known: Collection[str]) -> list[str]:
    if unknown := [flag for flag in flags() if flag not in known]:
        raise ConfigError(f"{unknown[0]} is not known here; give Hydra overrides, such as experiment=exp1.")
    return [argument for argument in sys.argv[1:] if argument not in (*MULTIRUN, *known)]


def _leave(words: str, status: int) -> NoReturn:
    print(words, file=sys.stderr)
    sys.exit(status)


def _leave_at_once(words: str, status: int) -> NoReturn:
    """Leave without waiting for workers, which may have results to send that nobody will receive."""
    for worker in multiprocessing.active_children():
        worker.kill()
    print(words, file=sys.stderr, flush=True)
    sys.stdout.flush()
    os._exit(status)


class Terminated(SystemExit):
    """SIGTERM has come."""

    code: int


@contextmanager
def ended_by_scheduler() -> Iterator[None]:
    """SIGTERM, a scheduler's warning, ends the process as Ctrl-C does: at once, with locks released.

    A launcher that listens to the signal itself is not disturbed.
    """
    listening = (
        threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    )
    if listening:
        signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        if listening:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(number: int, _frame: object) -> None:
    raise Terminated(128 + number)


def end_with_parent() -> None:
    """Let a worker process end when the command that it works for is killed: nobody would receive its results."""
    if multiprocessing.current_process().name == "MainProcess" or _WATCH in {
        each.name for each in threading.enumerate()
    }:
        return
    threading.Thread(target=_watch, args=(os.getppid(),), name=_WATCH, daemon=True).start()


_WATCH = "affmap: is the parent there?"


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
