"""The frame of all commands: command line, error messages, exit statuses."""

import os
import signal
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from affmap.cli.processes import Terminated, interruption, kill_workers, sigterm_ends_process
from affmap.config.notes import expand_folder
from affmap.config.search import Search
from affmap.config.sweep import Sweep
from affmap.pipeline.job import check_members, check_report
from affmap.pipeline.machine import MachineError
from affmap.results.manifest import check_place
from affmap.settings.messages import ConfigError, nearest, one_line, printable
from affmap.store import provenance
from affmap.store.files import FULL_DISK, locked
from affmap.store.stage import StoreError

MULTIRUN = ("-m", "--multirun")
"""Hydra's flag for sweeps; it is added where it is needed and optional on the command line."""

VERSION = "--version"
"""Flag of all commands: print the versions of affmap and of the packages that it stands on."""

OVERRIDES = "An override is key=value, as for affmap; `affmap --help` lists groups, `affmap --cfg job` all keys."
"""The end of each command's help."""


class SweepError(Exception):
    """Some settings of a sweep are incomplete; the message names the first."""


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
            if VERSION in flags():
                print(version())
            elif about and {"--help", "-h"} & {*flags()}:
                print(f"{about}\n{OVERRIDES}")
            else:
                body(_overrides(known))
        sys.stdout.flush()
    except BaseException as error:
        match interruption(error) or error:
            case KeyboardInterrupt():
                _leave_at_once(f"Stopped{remedy}", 128 + signal.SIGINT)
            case Terminated(code=code):
                _leave_at_once(f"Stopped by a signal{remedy}", code)
            case ConfigError() | MachineError() | HydraException() | OmegaConfBaseException():
                leave(str(error), 2)
            case StoreError() | SweepError():
                leave(str(error), 1)
            case BrokenPipeError():  # the reader of the output, such as `head`, has enough
                os._exit(128 + signal.SIGPIPE)
            case OSError(errno=number, filename=str(name)) if number in FULL_DISK:
                leave(f"The disk of {name} is full; make room and run the same command again.", 1)
            case OSError(filename=name, strerror=reason):
                leave(f"{name or 'A file'}: {reason or error}; fix that and run the same command again.", 1)
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
    overrides = expand_folder(arguments)
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
    """Hold the lock of a folder that a command writes; others that write it wait.

    Raises:
        ConfigError: a file is in its place, or on the way.
    """
    check_place(path)
    lock = path.with_name(f".{path.name}.lock")
    lock.parent.mkdir(parents=True, exist_ok=True)
    with locked(lock, f"another command that writes {path}"):
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def version() -> str:
    """The versions of affmap and of the packages that it stands on, on a line."""
    of = provenance.versions()
    return f"affmap {of['affmap']} (torch {of['torch']}, Hydra {of['hydra-core']}, Python {of['python']})"


def leave(message: str, status: int) -> NoReturn:
    """Exit with a sentence on the error stream."""
    print(printable(message), file=sys.stderr)
    sys.exit(status)


def flags() -> list[str]:
    """The flags of the command line, except Hydra's for sweeps."""
    return [argument for argument in sys.argv[1:] if argument.startswith("-") and argument not in MULTIRUN]


def _overrides(known: Collection[str]) -> list[str]:
    if unknown := [flag for flag in flags() if flag not in known]:
        near = nearest(unknown[0], [*known, "--help", VERSION])
        remedy = f"did you mean {near}?" if near else "give Hydra overrides, such as experiment=exp1."
        raise ConfigError(f"{unknown[0]} is not known here; {remedy}")
    for before, argument, after in zip(["", *sys.argv[1:]], sys.argv[1:], [*sys.argv[2:], ""], strict=False):
        if argument == "=" and before and after:
            raise ConfigError(f"an override has no blanks around its =; write {one_line(f'{before}={after}')}.")
    return [argument for argument in sys.argv[1:] if argument not in (*MULTIRUN, *known)]


def _leave_at_once(message: str, status: int) -> NoReturn:
    """Exit without waiting for workers, which may have results to send that nobody will receive."""
    kill_workers()
    print(printable(message), file=sys.stderr, flush=True)
    sys.stdout.flush()
    os._exit(status)
