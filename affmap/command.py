"""What all commands share: reading the command line, telling what is wrong in a sentence, ending when told to."""

import signal
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import NoReturn

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from affmap.settings import ConfigError
from affmap.stage import StoreError

MULTIRUN = ("-m", "--multirun")
"""Hydra's flag for sweeps; it is set where it is needed, whether it is given or not."""


class SweepError(Exception):
    """Some settings of a sweep have not been completed; the message names each."""


def command(body: Callable[[list[str]], None], known: Collection[str] = ()) -> None:
    """Run `body` on the command line's overrides; what goes wrong is told in a sentence. Flags must be `known`.

    Exit status: 2 for a mistake in the command line, 1 for what failed, 130 or 143 where a signal ended it.
    """
    try:
        with ended_by_scheduler():
            body(_overrides(known))
    except (ConfigError, HydraException, OmegaConfBaseException) as error:
        _leave(str(error), 2)
    except (StoreError, SweepError) as error:
        _leave(str(error), 1)
    except KeyboardInterrupt:
        _leave("Stopped; the same command goes on from there.", 128 + signal.SIGINT)
    except Terminated as ending:
        _leave("Stopped by a signal; the same command goes on from there.", ending.code)


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


class Terminated(SystemExit):
    """SIGTERM has come."""

    code: int


@contextmanager
def ended_by_scheduler() -> Iterator[None]:
    """SIGTERM, a scheduler's warning, ends the process as Ctrl-C does: at once, with locks released.

    A launcher that listens to the signal itself is not disturbed.
    """
    listening = current_thread() is main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if listening:
        signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        if listening:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(number: int, _frame: object) -> None:
    raise Terminated(128 + number)
