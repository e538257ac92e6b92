"""The frame of all commands: command line, error messages, exit statuses, signals."""

import argparse
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from affmap.config import sweep
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline.job import MachineError, check_members, check_report
from affmap.settings.messages import ConfigError, nearest, one_line, printable
from affmap.store.files import FULL_DISK, locked
from affmap.store.stage import StoreError

MULTIRUN = ("-m", "--multirun")
"""Hydra's flag for sweeps; it is added where it is needed and optional on the command line."""


OVERRIDES = "An override is key=value, as for affmap; `affmap --help` lists groups and keys."
"""The end of each command's help."""


class SweepError(Exception):
    """Some settings of a sweep are incomplete; the message names each."""


def command(
    body: Callable[[list[str]], None], known: Collection[str] = (), about: str | None = None, resumes: bool = True
) -> None:
    """Run `body` on the command line's overrides and report errors in a sentence; other flags than `known` are errors.

    `about` is the text of `--help`: purpose, usage, examples. It is no docstring, which optimised bytecode lacks.
    `resumes` tells whether the same command resumes after a signal.

    Exit status: 2 for a mistake in the command line, 1 for a failure, 130 or 143 for a signal.
    """
    open_streams()
    remedy = "; run the same command again to resume." if resumes else "."
    try:
        with _own_environment(), sigterm_ends_process():
            if about and {"--help", "-h"} & {*flags()}:
                print(f"{about}\n{OVERRIDES}")
            else:
                body(_overrides(known))
        sys.stdout.flush()
    except BaseException as error:
        match _first(error):
            case KeyboardInterrupt():
                _leave_at_once(f"Stopped{remedy}", 128 + signal.SIGINT)
            case Terminated(code=code):
                _leave_at_once(f"Stopped by a signal{remedy}", code)
            case ConfigError() | MachineError() | HydraException() | OmegaConfBaseException():
                _leave(str(error), 2)
            case StoreError() | SweepError():
                _leave(str(error), 1)
            case BrokenPipeError():  # the reader of the output, such as `head`, has enough
                os._exit(128 + signal.SIGPIPE)
            case OSError(errno=number, filename=str(name)) if number in FULL_DISK:
                _leave(f"The disk of {name} is full; make room and run the same command again.", 1)
            case OSError(filename=name, strerror=reason):
                _leave(f"{name or 'A file'}: {reason or error}; fix that and run the same command again.", 1)
            case _:
                raise


@contextmanager
def _own_environment() -> Iterator[None]:
    """Set variables that a command's libraries and workers read, and put the caller's back, who may be a notebook."""
    before = dict(os.environ)
    # Commands draw into files, whatever the user's settings of Matplotlib say.
    os.environ |= {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    # Of workers that were killed, joblib removes shared semaphores, and need not warn of them.
    warnings = (before.get("PYTHONWARNINGS"), "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker")
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, warnings))
    try:
        yield
    finally:
        for name in ("MPLBACKEND", "MATPLOTLIBRC", "PYTHONWARNINGS"):
            os.environ.pop(name, None)
            if name in before:
                os.environ[name] = before[name]


class Parser(argparse.ArgumentParser):
    """A parser of the command line of a program without overrides; its help begins with the purpose, then the usage."""

    def __init__(self, name: str, purpose: str, examples: str) -> None:
        """Begin with no arguments; `examples` are the end of the help, lines that are kept."""
        super().__init__(name, epilog=f"examples:\n{examples}", formatter_class=argparse.RawDescriptionHelpFormatter)
        self._purpose = f"{name}: {purpose}"

    def format_help(self) -> str:
        """The text of `--help`."""
        return f"{self._purpose}\n\n{super().format_help()}"


def open_streams() -> None:
    """Open the null device for each standard stream that is closed or missing, as after `affmap >&-`.

    Else a file that is opened next would have the stream's number, and get what libraries and workers print.
    """
    for name, mode in {"stdin": "r", "stdout": "w", "stderr": "w"}.items():
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115  # its number is the lowest free one
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)


def read_jobs(arguments: Sequence[str]) -> Search | Sweep:
    """The search of a command line, or its sweep; a folder stands for the overrides of what was run into it.

    Raises:
        ConfigError: a value is not allowed, or there is no such folder; the message gives a remedy.
    """
    overrides = sweep.expand_folder(arguments)
    return Search.read(overrides) or read_sweep(overrides)


def read_sweep(arguments: Sequence[str]) -> Sweep:
    """The validated sweep of a command line.

    Raises:
        ConfigError: a value is not allowed, or a member is in two jobs; the message gives a remedy.
    """
    jobs = Sweep.read(arguments)
    check_report(jobs)
    check_members(jobs)
    return jobs


@contextmanager
def written_alone(path: Path) -> Iterator[None]:
    """Hold the lock of a folder that a command writes; others that write it wait."""
    lock = path.with_name(f".{path.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    with locked(lock, f"another command that writes {path}"):
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _first(error: BaseException) -> BaseException:
    """The signal that caused an error, since libraries may fail when they are interrupted; else the error itself."""
    cause: BaseException | None = error
    while cause:
        if isinstance(cause, (KeyboardInterrupt, Terminated)):
            return cause
        cause = cause.__context__
    return error


def flags() -> list[str]:
    """The flags of the command line, except Hydra's for sweeps."""
    return [argument for argument in sys.argv[1:] if argument.startswith("-") and argument not in MULTIRUN]


def _overrides(known: Collection[str]) -> list[str]:
    if unknown := [flag for flag in flags() if flag not in known]:
        near = nearest(unknown[0], [*known, "--help"])
        remedy = f"did you mean {near}?" if near else "give Hydra overrides, such as experiment=exp1."
        raise ConfigError(f"{unknown[0]} is not known here; {remedy}")
    for before, argument, after in zip(["", *sys.argv[1:]], sys.argv[1:], [*sys.argv[2:], ""], strict=False):
        if argument == "=" and before and after:
            raise ConfigError(f"an override has no blanks around its =; write {one_line(f'{before}={after}')}.")
    return [argument for argument in sys.argv[1:] if argument not in (*MULTIRUN, *known)]


def _leave(message: str, status: int) -> NoReturn:
    print(printable(message), file=sys.stderr)
    sys.exit(status)


def _leave_at_once(message: str, status: int) -> NoReturn:
    """Exit without waiting for workers, which may have results to send that nobody will receive."""
    for worker in _workers():
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    print(printable(message), file=sys.stderr, flush=True)
    sys.stdout.flush()
    os._exit(status)


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
