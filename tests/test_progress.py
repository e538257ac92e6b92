"""Progress in Python: the very characters, on streams that stand for a terminal, a notebook and a file."""

import io
import sys

import pytest

import affmap
from affmap.progress import reported


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Notebook(io.StringIO):
    """Stands for the stream of a notebook, which says that it is no terminal."""

    __module__ = "ipykernel.iostream"


def count(total: int, note: str = "") -> None:
    with reported("counting", total, "sheep") as update:
        for finished in range(1, total + 1):
            update(finished, note if finished < total else "")


def test_a_terminal_has_one_line_that_renews_itself(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A shorter line covers a longer one; the standard output stays clean."""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    count(2, "asleep")
    lines = ["counting: 0 of 2 sheep", "counting: 1 of 2 sheep, asleep", "counting: 2 of 2 sheep        "]
    assert terminal.getvalue() == "".join(f"\r{line}" for line in lines) + "\n"
    assert capsys.readouterr().out == ""


def test_a_line_never_wraps(monkeypatch: pytest.MonkeyPatch) -> None:
    """What wraps is not renewed."""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setenv("COLUMNS", "20")
    count(1, "a note that is long")
    assert {len(line.strip()) for line in terminal.getvalue().split("\r")} == {0, 19}


def test_a_notebook_has_such_a_line_on_its_standard_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", notebook := Notebook())
    count(1)
    assert notebook.getvalue() == "\rcounting: 0 of 1 sheep\rcounting: 1 of 1 sheep\n"


@pytest.mark.parametrize(("total", "numbers"), [(100, [20, 40, 60, 80, 100]), (3, [1, 2, 3]), (7, [2, 3, 5, 6, 7])])
def test_elsewhere_there_are_few_lines(total: int, numbers: list[int], capsys: pytest.CaptureFixture[str]) -> None:
    """By hand: whenever a fifth is complete."""
    count(total)
    assert capsys.readouterr().err.splitlines() == [f"counting: {number} of {total} sheep" for number in numbers]


def test_nothing_is_shown_without_a_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Python has none where it was started without a console."""
    monkeypatch.setattr(sys, "stderr", None)
    count(3)


def test_flights_are_shown_on_a_terminal_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    agent = affmap.load("exp1", context_size=0)
    affmap.fly(agent, "original", steps=2)
    assert capsys.readouterr() == ("", "")
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", notebook := Notebook())
        affmap.fly(agent, "original", steps=2)
    assert notebook.getvalue() == ""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    affmap.fly(agent, "original", steps=2)
    assert terminal.getvalue().endswith("\rflight in original: 2 of 2 steps\n")
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    affmap.fly(agent, "original", steps=2, progress=False)
    assert terminal.getvalue() == ""
