"""The flags of programs that show agents: one name for one thing, and mistakes in a sentence."""

import re
import sys
from importlib.metadata import version

import pytest

from affmap.control.pretrained import load
from affmap.play import render, window
from affmap.play.parser import TRANSITIONS

PROGRAMS = {"affmap-play": window.main, "affmap-render": render.main}


def told(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The sentence on the error stream, with which a program ends before it does anything."""
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    with pytest.raises(SystemExit) as leaving:
        PROGRAMS[name]()
    captured = capsys.readouterr()
    assert (leaving.value.code, captured.out, captured.err.count("\n")) == (2, "", 1)
    return captured.err


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_layout_is_a_world_everywhere(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `affmap world=fog` says; another name is refused, and this one is listed."""
    message = told(name, monkeypatch, capsys, "exp1", "--layout", "fog")
    assert message.startswith("--layout is not known here; there are: --help, --version, --world, ")
    assert told(name, monkeypatch, capsys, "--wrld", "fog") == "--wrld is not known here; did you mean --world?\n"


@pytest.mark.parametrize("name", PROGRAMS)
def test_other_mistakes_are_told_in_a_sentence(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the usage."""
    number = told(name, monkeypatch, capsys, "--context-size", "x")
    assert number == "argument --context-size: invalid int value: 'x'.\n"
    assert told(name, monkeypatch, capsys, "exp1", "exp2").startswith("exp2 is not known here; there are: --help, ")


@pytest.mark.parametrize("name", PROGRAMS)
def test_examples_of_the_help_are_commands_that_the_program_takes(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its parser reads each of them; they show every flag that chooses among agents, of models that there are."""
    read: list[str] = []
    module = {"affmap-play": window, "affmap-render": render}[name]
    monkeypatch.setattr(module, "command", lambda body, resumes: read.append("as a command line"))
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit):
        PROGRAMS[name]()
    text = capsys.readouterr().out
    examples = [line.split() for line in text.partition("examples:")[2].splitlines() if line.strip()]
    for example in examples:
        monkeypatch.setattr(sys, "argv", [*example])
        PROGRAMS[name]()
    assert len(read) == len(examples) > 3
    shown = {word for example in examples for word in example if word.startswith("--")}
    assert shown >= {flag for flag in ("--context-size", "--transition", "--guide") if f"[{flag} " in text}
    for model, source in re.findall(r"(\w+) of (\w+)", re.sub(r"\s+", " ", TRANSITIONS)):
        assert load(source, transition=model)


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_know_the_version(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--version"])
    with pytest.raises(SystemExit) as leaving:
        PROGRAMS[name]()
    assert leaving.value.code == 0
    assert capsys.readouterr().out.startswith(f"affmap {version('affmap')} (torch {version('torch')}, Hydra ")
