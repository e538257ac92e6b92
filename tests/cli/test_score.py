"""The command `affmap-score`: an agent of a user's own module, those that there are, and mistakes in a sentence."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ENVIRONMENT, in_process

import affmap
from affmap.cli import score
from affmap.control import Protocol, StraightAgent
from affmap.control.pretrained import reference
from affmap.control.scoring import SCORES
from affmap.results import leaderboard

MODULE = """
import torch
from affmap.control import Decision, StraightAgent


class Still:
    def initial(self, num_problems):
        return None

    def act(self, observation, state, generators):
        return Decision.without_prediction(torch.zeros(len(observation.position), 4)), None


class Hasty(Still):
    def act(self, observation, state, generators):
        return observation.haste, None


def straight():
    return StraightAgent()


def three():
    return 3


def broken(number=0):
    return 1 / number


def needy(model):
    return model


nothing = None
"""

SMALL = """
name: small
channels: [solid, fog, force_up, force_down]
worlds: [original, training_fog]
seed: 1000
vehicle: default
planner: cem
control: {num_steps: 50, runs_per_member: 4, guide: none}
"""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with a module and a protocol of two worlds and four runs."""
    (tmp_path / "flyers.py").write_text(MODULE)
    (tmp_path / "conf/protocol").mkdir(parents=True)
    (tmp_path / "conf/protocol/small.yaml").write_text(SMALL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "flyers", raising=False)
    return tmp_path


def test_an_agent_of_a_module_is_scored_in_a_process_of_its_own(work: Path) -> None:
    """As `affmap.score` scores it; the folder has its runs, its module, and the command."""
    command = [sys.executable, "-W", "ignore", "-c", "from affmap.cli.score import main; main()"]
    line = ["flyers:straight", "--protocol", "small", "--output", "runs/scores/mine"]
    result = subprocess.run([*command, *line], cwd=work, capture_output=True, text=True, env=ENVIRONMENT, timeout=300)
    assert result.returncode == 0, result.stderr
    protocol = Protocol.load("protocol", "small")
    assert result.stdout.startswith(f"flyers:straight: 1 member, 4 runs in each world of small ({protocol.digest})\n")
    expected = affmap.score(StraightAgent(), protocol, progress=False)
    rows = re.findall(r"^ (\w+) +(\S+) \[.+\] +(\S+) +(\S+) $", result.stdout, re.MULTILINE)
    values = expected[["score", "success", "mean_distance"]].to_numpy().tolist()
    shown = [(world, *(f"{each:.2f}" for each in row)) for world, row in zip(expected["world"], values, strict=True)]
    assert rows == shown
    record, runs = leaderboard.read(work / "runs/scores/mine")
    assert record["protocol"] == {"name": "small", "digest": protocol.digest}
    assert record["command"] == f"affmap-score {' '.join(line)}"
    assert (work / "runs/scores/mine/flyers.py").read_text() == MODULE
    assert record["extensions"] == [{"module": "flyers", "sha256": record["files"]["flyers.py"]}]
    flown = protocol.fly(StraightAgent())
    assert runs["steps_to_reach"].tolist() == flown["steps_to_reach"].tolist() and len(runs) == 8


def test_agents_that_there_are_need_no_module(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One of the configuration, and a trained one with all of its members: 25 cannot share four runs, four can."""
    assert in_process(monkeypatch, "affmap-score", ["random", "--protocol", "small", "--name", "by chance"]) == 0
    assert capsys.readouterr().out.startswith("by chance: 1 member, 4 runs in each world of small")
    assert in_process(monkeypatch, "affmap-score", ["exp1", "--protocol", "small"]) == 2
    assert "the agent has 25 members, and the 4 runs in each world of 'small' cannot" in capsys.readouterr().err
    affmap.load("exp1", members=range(4)).save("mine")
    line = ["mine", "--planner", "cem", "--guide", "none", "--protocol", "small"]
    assert in_process(monkeypatch, "affmap-score", line) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("mine, C = 8, mlp, cem: 4 members")
    assert "The agent has not learned the channels of training_fog, and so has no mean." in printed
    assert re.search(r"^ training_fog +– +– +– $", printed, re.MULTILINE)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["flyers:three"], "flyers:three returned 3, which is no agent; let it return an object with the methods"),
        (["flyers:Still", "--protocol", "nine"], "conf/protocol/nine.yaml does not exist; conf/protocol holds: eight"),
        (
            ["flyers:Stil"],
            "flyers:Stil: 'flyers' has no function or class 'Stil'; did you mean Still? There are: Still",
        ),
        (["flyers:nothing"], "flyers:nothing: 'flyers' has no function or class 'nothing'; there are: Still, Hasty"),
        (["flyers:"], "'flyers:' names no function; write module:function, such as mine:agent."),
        (
            ["flyers:broken"],
            "flyers:broken: calling broken failed in {work}/flyers.py, line 28, with ZeroDivisionError",
        ),
        (["flyers:needy"], "flyers:needy: calling needy failed with TypeError: needy() missing 1 required positional"),
        (["walkers:Still"], "walkers:Still: importing 'walkers' failed with ModuleNotFoundError: No module named"),
        (
            ["flyers:Hasty", "--protocol", "small"],
            "flyers:Hasty: flying failed in {work}/flyers.py, line 16, with AttributeError",
        ),
        (["json:Still"], "json:Still: 'json' has no function or class 'Still'; "),
        (["exp99"], "exp99 does not exist, and is none of the reference run's experiments, exp1, "),
        (["planner"], "agent = 'planner' needs a model; name an experiment, such as exp5."),
        (
            ["straight", "--planner", "cem"],
            "--planner chooses among trained agents, and straight is none; leave it out.",
        ),
        (["straight", "--name", " "], "--name is empty; give the agent a name, or leave it out."),
        (["straight", "--guide", "none"], "--guide none is for agents that plan, and straight does not; leave it out."),
        (["straight", "--output", "."], "folder = '.' is not allowed: it should be the path of a folder"),
        (["straight", "--output", "conf"], "conf cannot hold the runs of an agent: conf holds no report. Name another"),
        (["straight", "--protcol", "small"], "--protcol is not known here; did you mean --protocol?"),
        ([], "the following arguments are required: source."),
    ],
)
def test_a_mistake_is_told_in_a_sentence(
    line: list[str],
    told: str,
    work: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Status 2, and nothing but a line on the error stream."""
    assert in_process(monkeypatch, "affmap-score", line) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert captured.err.startswith(told.format(work=work))


def test_a_module_that_python_has_under_the_same_name_is_told(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It would be imported in place of the user's."""
    (work / "json.py").write_text(MODULE)
    assert in_process(monkeypatch, "affmap-score", ["json:Still"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("json:Still: Python has another module 'json', ")
    assert error.endswith("json.py; rename your module, and its name here.\n")


def test_examples_of_the_help_are_commands_that_it_takes(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its parser reads each of them, and their agents are there but for the user's own."""
    bodies = []
    monkeypatch.setattr(score, "command", lambda body, resumes: bodies.append(body))
    monkeypatch.setattr(score, "_score", lambda given, line: taken.append(given))
    taken: list[score.Namespace] = []
    for example in score.EXAMPLES.splitlines():
        monkeypatch.setattr(sys, "argv", example.strip().partition("   ")[0].split())
        score.main()
        bodies.pop()([])
    assert len(taken) == 6
    for given in taken:
        if given.source not in ("mine:Agent", "runs/exp1"):
            assert score._agent(given, Protocol())


def test_the_published_table_is_of_the_protocol_that_there_is() -> None:
    """Each folder: one digest; a command that names its agent and its folder, and starts with the program's name."""
    digest = Protocol().digest
    folders = sorted((reference() / SCORES).iterdir())
    assert len(folders) > 10
    for folder in folders:
        record = json.loads((folder / "provenance.json").read_text())
        assert record["protocol"]["digest"] == digest, folder
        assert record["command"].startswith("affmap-score ") and record["command"].endswith(f"scores/{folder.name}")
        assert not record["git"].endswith("-dirty")
