"""Signals in the middle of anything: real ones, in fresh processes, and chains of errors written out by hand."""

import signal
import subprocess
import sys

import pytest

from affmap.cli.processes import Terminated, interruption

STUMBLES = """
import os, signal
from affmap.cli import app, run
from affmap.config import explain

signal.signal(signal.SIGINT, signal.default_int_handler)  # where it is ignored from outside

def stumble(*_):
    try:
        os.kill(os.getpid(), {number})
    finally:
        raise AttributeError("stumbled")

def compose(arguments):
    with explain.hydra_errors():
        stumble()

def launch(arguments):
    run._job = stumble
    print(run._launch(arguments))

app.command({body})
"""


@pytest.mark.parametrize("body", ["stumble", "compose", "launch"])
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_in_the_middle_of_a_library_is_no_mistake(number: signal.Signals, status: int, body: str) -> None:
    """One that stumbles while it is interrupted raises an error of its own, which would else be told as its mistake, a
    wrong override, or a launcher that failed."""
    program = STUMBLES.format(number=int(number), body=body)
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (status, "") and ended.stderr.startswith("Stopped")


WORKS = """
import os, signal, threading, time
from joblib import Parallel, delayed
from affmap.cli.app import command
from affmap.cli.processes import sigint_spares_workers

def body(_):
    with sigint_spares_workers():
        threading.Timer({moment}, os.killpg, (0, signal.SIGINT)).start()
        Parallel(n_jobs=2)(delayed(time.sleep)(60) for _ in range(2))

signal.signal(signal.SIGINT, signal.default_int_handler)  # where it is ignored from outside
command(body)
"""


@pytest.mark.parametrize("moment", [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 1.0])
def test_ctrl_c_while_workers_start_is_told_once(moment: float) -> None:
    """A terminal sends it to the command and to its workers, of which each would print its own error, from imports."""
    program = [sys.executable, "-c", WORKS.format(moment=moment)]
    ended = subprocess.run(program, capture_output=True, text=True, check=False, timeout=50, start_new_session=True)
    told = "Stopped; run the same command again to resume.\n"
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", told)


def raised(error: BaseException, after: BaseException | None, hidden: bool) -> BaseException:
    """An error as it is caught: raised while another one was handled, `from` it or `from None`."""
    try:
        if after is None:
            raise error
        try:
            raise after
        except BaseException:
            if hidden:
                raise error from None
            raise error  # noqa: B904
    except BaseException as caught:
        return caught


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("received", [KeyboardInterrupt(), Terminated(143)])
def test_the_signal_is_found_behind_the_errors_that_it_caused(received: BaseException, hidden: bool) -> None:
    once = raised(AttributeError("flags"), received, hidden)
    assert (
        interruption(received)
        is interruption(once)
        is interruption(raised(ValueError("key"), once, hidden))
        is received
    )


def test_other_errors_were_caused_by_no_signal() -> None:
    """Nor is an exit of a program one: SIGTERM's error is the only kind of exit that counts."""
    alone = raised(ValueError("key"), AttributeError("flags"), hidden=False)
    assert interruption(alone) is None and interruption(SystemExit(1)) is None
