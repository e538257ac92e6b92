"""Progress: plain lines at the right times with the right estimate, a bar in a terminal only."""

import io
import multiprocessing
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import pytest

from affmap.pipeline import progress
from affmap.pipeline.progress import Overview, displayed, follow, track
from affmap.progress import Update


class Clock:
    """Stands for `time.monotonic`."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("affmap.pipeline.progress.time.monotonic", clock)
    return clock


def lines(caplog: pytest.LogCaptureFixture, clock: Clock, updates: list[tuple[float, int]], total: int) -> list[str]:
    """Lines that are logged when `updates` (time, finished) happen."""
    with caplog.at_level("INFO", logger="affmap"), track("flying", total, "steps") as update:
        for now, finished in updates:
            clock.now = now
            update(finished)
    return caplog.messages


def test_lines_come_every_15_seconds_with_the_time_that_is_left(caplog: pytest.LogCaptureFixture, clock: Clock) -> None:
    """By hand: a step a second since the first one at 101 s; 83 steps are left at 118 s."""
    updates = [(100.0 + step, step) for step in range(1, 34)]
    assert lines(caplog, clock, updates, 100) == [
        "flying: 100 steps",
        "flying: 16 of 100 steps, 1:24 left",
        "flying: 32 of 100 steps, 1:08 left",
    ]


def test_a_resumed_task_is_judged_by_its_own_speed(caplog: pytest.LogCaptureFixture, clock: Clock) -> None:
    """By hand: 40 of 50 were done before; one takes 20 s, so nine more take 180 s at 41."""
    assert lines(caplog, clock, [(110, 40), (130, 41)], 50) == [
        "flying: 50 steps",
        "flying: 41 of 50 steps, 3:00 left",
    ]


def test_short_and_finished_tasks_are_reported_once(caplog: pytest.LogCaptureFixture, clock: Clock) -> None:
    """Nothing within 15 s, nothing at the end."""
    assert lines(caplog, clock, [(101, 1), (114, 2), (200, 3)], 3) == ["flying: 3 steps"]


def test_nothing_is_printed_by_the_lines(capsys: pytest.CaptureFixture[str], clock: Clock) -> None:
    """They are for the log alone."""
    with track("flying", 3, "steps") as update:
        update(1)
    assert capsys.readouterr() == ("", "")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_bar_in_a_terminal(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """The drawing ends with the count; no lines are logged."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    with caplog.at_level("INFO", logger="affmap"), track("flying", 7, "steps") as update:
        for finished in range(1, 8):
            update(finished)
    assert "flying" in terminal.getvalue() and "7/7" in terminal.getvalue()
    assert caplog.messages == []


def test_a_worker_draws_no_bar(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Workers of a sweep share the terminal: plain lines there."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setattr(multiprocessing.current_process(), "_name", "LokyProcess-1")
    with caplog.at_level("INFO", logger="affmap"), track("flying", 7, "steps") as update:
        update(1)
    assert terminal.getvalue() == "" and caplog.messages == ["flying: 7 steps"]


@pytest.mark.parametrize("is_terminal", [True, False])
def test_an_error_passes_through(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> None:
    if is_terminal:
        monkeypatch.setattr(sys, "stdout", Terminal())
    with pytest.raises(RuntimeError, match="broken"), track("flying", 7, "steps"):
        raise RuntimeError("broken")


def test_a_remark_stands_behind_the_number(caplog: pytest.LogCaptureFixture, clock: Clock) -> None:
    """In a line, and in a bar's."""
    with caplog.at_level("INFO", logger="affmap"), track("training", 9, "epochs") as update:
        update(1, "validation -1.00 nats")
        clock.now += 16
        update(2, "validation -2.50 nats")
    assert caplog.messages[1:] == ["training: 2 of 9 epochs, validation -2.50 nats, 1:52 left"]


def test_a_caller_may_display_it_otherwise(capsys: pytest.CaptureFixture[str]) -> None:
    """All that is passed on, in the block only; what notes it still does."""
    shown: list[tuple[object, ...]] = []
    noted: list[tuple[int, int]] = []

    @contextmanager
    def display(*about: object) -> Iterator[Update]:
        shown.append(about)
        yield lambda *values: shown.append(values)

    with displayed(display), track("flying", 3, "steps", lambda *values: noted.append(values)) as update:
        update(1, "high")
    with track("walking", 3, "steps") as update:
        update(1)
    assert shown == [("flying", 3, "steps"), (1, "high")] and noted == [(1, 3)]


BEGIN = Overview(0, 3, 1, 9, 1.5, None)
MIDDLE = Overview(1, 3, 4, 9, 4.0, 70.0)
END = Overview(3, 3, 9, 9, 9.0, 0.0)


def followed(monkeypatch: pytest.MonkeyPatch, overviews: Iterable[Overview]) -> None:
    """Follow jobs until each of these states has been read; the last one is read again and again."""
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LOOKS", 0.001)
    states, seen = list(overviews), 0

    def look() -> Overview:
        nonlocal seen
        seen += 1
        return states[min(seen, len(states)) - 1]

    with follow("exp1", look):
        deadline = time.monotonic() + 60
        while seen < len(states):
            assert time.monotonic() < deadline, "nobody looks"
            time.sleep(0.001)


def test_a_sweep_has_one_bar_in_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends with the last state; the time that is left is told where it is known."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setenv("COLUMNS", "150")
    followed(monkeypatch, [BEGIN, MIDDLE, END])
    shown = terminal.getvalue()
    assert "0 of 3 settings, 1 of 9 stages complete" in shown and "?" not in shown.replace("\x1b[?25", "")
    assert shown.rindex("3 of 3 settings, 9 of 9 stages complete") > shown.index("0 of 3 settings")
    assert str(MIDDLE) == "1 of 3 settings, 4 of 9 stages complete, 1:10 left"


def test_a_sweep_without_a_terminal_has_a_line_for_news_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One for a further setting, none for the same state again, none at the end, which the command reports."""
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", -1)
    followed(monkeypatch, [BEGIN, BEGIN, MIDDLE, MIDDLE, MIDDLE, END])
    assert capsys.readouterr().out == f"exp1: {MIDDLE}\n"
    monkeypatch.setattr(progress, "SECONDS_OF_SILENCE", -1)
    followed(monkeypatch, [BEGIN, BEGIN, END])
    assert capsys.readouterr().out == f"exp1: {BEGIN}\n"


def test_an_error_ends_the_looking(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is raised in the block passes; a folder that is renamed while it is read is no error."""
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LOOKS", 0.001)
    looks: list[int] = []

    def look() -> Overview:
        looks.append(1)
        if len(looks) > 1:
            raise FileNotFoundError
        return BEGIN

    def work() -> None:
        while len(looks) < 3:
            time.sleep(0.001)
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"), follow("exp1", look):
        work()
    number = len(looks)
    time.sleep(0.02)
    assert len(looks) == number
