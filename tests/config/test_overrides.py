"""Overrides as text: read by Hydra's grammar, told apart, replaced."""

import shlex

import pytest

from affmap.config.overrides import is_sweep, keys, parse, replace_experiment, without_sweeps
from affmap.config.sweep import complete
from affmap.settings import ConfigError


@pytest.mark.parametrize("character", sorted({*"~!@#$%^&*()-_+={}[]|\\:;\"',.<>?/`éß€ "}))
def test_the_advice_for_a_character_is_taken(character: str) -> None:
    """A text that Hydra refuses is read in the quotes that the sentence shows, for a shell as `shlex` is one."""
    try:
        parse([f"title=a{character}b"])
    except ConfigError as error:
        advice = str(error).rpartition(", as in ")[2].removesuffix(".")
        if character in "()[]{}=\"'":
            assert "meaning of their own" in advice
        else:
            assert [each.value() for each in parse(shlex.split(advice))] == [f"a{character}b"]


def test_overrides_are_told_apart_by_whether_they_sweep() -> None:
    """By hand: lists, ranges and choices of files; a list in brackets is one value."""
    fixed = ["experiment=exp1", "++seed=3", "training_layouts=[fog,original]", "~baselines"]
    swept = ["planner=cem,gradient", "members=range(2,4)", "world=choice(fog)"]
    assert without_sweeps([*swept, *fixed]) == fixed
    assert [is_sweep([line]) for line in (*fixed, *swept)] == [False] * 4 + [True] * 3
    assert keys([*fixed, *swept]) == [
        "experiment",
        "seed",
        "training_layouts",
        "baselines",
        "planner",
        "members",
        "world",
    ]


def test_another_experiment_with_the_same_command_line() -> None:
    """By hand: what is dropped, what is replaced, and what stays."""
    line = complete(["experiment=exp3", "scale=smoke", "++seed=3", "model.context_size=0,8"])
    swept = ("planner", "world", "model.context_size")
    assert replace_experiment(line, "exp3_growth", swept) == ["scale=smoke", "++seed=3", "experiment=exp3_growth"]
    assert replace_experiment(["output=a"], "exp1", ("output",)) == ["experiment=exp1"]
