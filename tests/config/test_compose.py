"""Composition of files that somebody adds to `conf`: mistakes in them are told with the file."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from affmap.config import sweep
from affmap.settings import ConfigError

MINE = "name: mine\ntitle: Mine\n"


def told(*line: str) -> str:
    with pytest.raises(ConfigError) as caught:
        sweep.jobs(sweep.complete(line))
    return str(caught.value)


HYPEROPT = "defaults:\n  - override /hydra/sweeper: hyperopt\nobjective: success\n"


@pytest.mark.parametrize(
    ("name", "text", "remedy"),
    [
        ("experiment/mine", MINE, "add it"),
        ("experiment/folder/mine", MINE, "add it"),
        (
            "experiment/mine",
            f"# My experiment.\n# @package _global_\n{MINE}",
            "line 2 is '# @package _global_', so move it to the top",
        ),
        ("experiment/mine", f"{MINE}# @package _global_\n", "line 3 is '# @package _global_', so move it to the top"),
        ("experiment/mine", f"# @package _global\n{MINE}", "line 1 is '# @package _global', so correct it"),
        ("experiment/mine", f"# @package experiment\n{MINE}", "line 1 is '# @package experiment', so correct it"),
        (
            "experiment/mine",
            f"{MINE}# @pakage _global_\n",
            "line 3 is '# @pakage _global_', so correct it and move it to the top",
        ),
        ("scale/mine", "members: 3\nnotice: null\n", "add it"),
        ("search/mine", "objective: success\n", "add it"),
        ("search/mine", HYPEROPT, "add it"),
        (
            "search/folder/mine",
            f"# Mine.\n# @package _global_\n{HYPEROPT}",
            "line 2 is '# @package _global_', so move it to the top",
        ),
        ("experiment/mine", "defaults:\n  - override /planner: cem\n", "add it"),
    ],
)
def test_a_file_without_its_package_line_is_named_with_the_line(
    own_conf: Path, name: str, text: str, remedy: str
) -> None:
    """Missing, not the first line, or misspelt: the file's keys would be those of a group that no job has."""
    path = own_conf / f"{name}.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    group, _, option = name.partition("/")
    sentence = f"conf/{name}.yaml should begin with the line `# @package _global_`; {remedy}."
    assert told(f"{group}={option}") == sentence
    path.write_text(f"# @package _global_\n{text.replace('@', '')}")
    assert len(sweep.jobs(sweep.complete([f"{group}={option}"]))) == 1, "the remedy helps"


def test_a_file_that_another_builds_on_needs_the_line_as_well(own_conf: Path) -> None:
    (own_conf / "experiment/base.yaml").write_text(MINE)
    (own_conf / "experiment/mine.yaml").write_text("# @package _global_\ndefaults: [/experiment/base]\nseed: 3\n")
    assert told("experiment=mine") == (
        "conf/experiment/base.yaml should begin with the line `# @package _global_`; add it."
    )


@pytest.mark.parametrize("group", ["experiment", "layout"])
def test_a_key_that_stands_twice_is_told_with_file_and_line(own_conf: Path, group: str) -> None:
    """By Hydra's reader, and by ours, which would take the last one: another world."""
    text = (own_conf / "layout/original.yaml").read_text().replace("name: original", "name: mine")
    text = f"# @package _global_\n{MINE}" if group == "experiment" else text
    key, value = ("title", "Mine again") if group == "experiment" else ("circles", "[]")
    path = own_conf / group / "mine.yaml"
    path.write_text(text)
    line = ["experiment=mine"] if group == "experiment" else ["world=mine"]
    assert len(sweep.jobs(sweep.complete(line))) == 1
    path.write_text(f"{text}{key}: {value}\n")
    place = f"conf/{group}/mine.yaml, line {len(text.splitlines()) + 1}"
    assert f"{place}: the key {key!r} stands twice; keep one of the two." in told(*line)


def test_what_a_key_merges_may_be_overridden(own_conf: Path) -> None:
    """In a file that Hydra reads; the value by hand."""
    (own_conf / "experiment/mine.yaml").write_text(
        "# @package _global_\nmodel: {context_size: 2}\ntraining: {<<: {num_epochs: 3}, num_epochs: 4}\n"
    )
    (job,) = sweep.jobs(["experiment=mine"])
    assert (job.model.context_size, job.training.num_epochs) == (2, 4)


def test_a_value_of_a_file_that_changes_is_refused(own_conf: Path) -> None:
    (own_conf / "experiment/mine.yaml").write_text(f"# @package _global_\n{MINE}seed: ${{now:%S}}\n")
    assert re.match(r"seed = '\$\{now:%S\}' may be another value each time it is read; ", told("experiment=mine"))


def test_errors_of_yaml_name_the_file_as_it_is_called(own_conf: Path) -> None:
    """Not by its place on this machine."""
    (own_conf / "experiment/mine.yaml").write_text("# @package _global_\ntitle: [\n")
    message = told("experiment=mine")
    assert 'in "conf/experiment/mine.yaml", line 3' in message and str(own_conf) not in message


def test_a_file_that_would_take_minutes_is_refused_before_hydra_reads_it(own_conf: Path) -> None:
    (own_conf / "experiment/mine.yaml").write_text(f"# @package _global_\n{MINE}{'#' * 10**6}\n")
    assert re.match(r"conf/experiment/mine\.yaml has 1,000,0\d\d bytes; ", told("experiment=mine"))


NO_KEY = "cannot be read: it has no key; write key=value, such as model.context_size=3."


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("=x", f"the override '=x' {NO_KEY}"),
        ("=1,2", f"the override '=1,2' {NO_KEY}"),
        ("+=x", f"the override '+=x' {NO_KEY}"),
        ("~", f"the override '~' {NO_KEY}"),
        ("@a=b", f"the override '@a=b' {NO_KEY}"),
        ("~foo", "foo is not a known key; correct its spelling."),
        ("~foo=3", "foo is not a known key; correct its spelling."),
        ("~planner.foo", "planner.foo is not a known key; correct its spelling."),
        ("planner@foo=cem", "planner@foo is not a known key; correct its spelling."),
        ("~planner=gradient", "planner is not gradient, so it cannot be removed; leave the override out."),
        ("~seed=99", "seed is not 99, so it cannot be removed; leave the override out."),
    ],
)
def test_overrides_of_no_key_are_told_in_sentences_of_ours(override: str, sentence: str) -> None:
    """Golden sentences, without Hydra's talk of its defaults list."""
    assert told(override) == sentence


@pytest.mark.parametrize(("launcher", "package"), [("ray", "hydra-ray-launcher"), ("slurm", "hydra-submitit-launcher")])
def test_a_launcher_whose_package_is_not_installed_names_the_extra(launcher: str, package: str) -> None:
    """By pyproject.toml; Hydra lists the launchers that are there."""
    if find_spec(f"hydra_plugins.{package.replace('-', '_')}"):
        pytest.skip("it is installed")
    assert told(f"hydra/launcher={launcher}") == (
        f"hydra/launcher = {launcher!r} needs {package}, which is not installed: pip install 'affmap[{launcher}]'."
    )
    assert "'nope' does not exist; there are: basic," in told("hydra/launcher=nope")
