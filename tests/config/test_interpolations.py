"""Interpolations, by hand: those of keys and of the environment are the same every time; others are refused."""

from collections.abc import Sequence

import pytest

from affmap.config import sweep
from affmap.config.compose import compose, launch_settings, values
from affmap.config.interpolations import MOST_EXPANDED
from affmap.settings import ConfigError


def told(line: Sequence[str]) -> str:
    with pytest.raises(ConfigError) as caught:
        sweep.jobs(sweep.complete(line))
    return str(caught.value)


@pytest.mark.parametrize(
    "line",
    [
        "seed=${now:%S}",
        "title='at ${now:%H:%M:%S}'",
        "title=\"${oc.decode:'${now:%S}'}\"",
        'title="${oc.select:nope,${now:%S}}"',
        "title='${oc.env:NOPE,${now:%S}}'",
        "title='${${name}:%S}'",
        "training_layouts=['${now:%S}']",
        "++model.transition.kind='${now:%S}'",
        "title=$\\{now\\:%S\\}",
        "title=${hydra.job.id}",
        "title='${ hydra.run.dir}'",
        "title='${[hydra][run].dir}'",
        "title=${hydra}",
        "title='${oc.create:\"a: &a [1]\"}'",
    ],
)
def test_a_value_that_changes_is_refused_before_anything_runs(line: str) -> None:
    """Functions of Hydra and OmegaConf, written in each way that its grammar knows, and Hydra's own keys."""
    key = line.partition("=")[0].lstrip("+").replace("training_layouts", "training_layouts.0")
    message = told([line])
    assert message.startswith(f"{key} = ") and "may be another value each time it is read; write the value" in message


def test_references_to_keys_and_to_the_environment_are_resolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Absolute, relative, of lists, of choices and of variables; the values by hand."""
    monkeypatch.setenv("AFFMAP_TEST", "mine")
    for text, value in {
        "${world}": "original",
        "${ .world }": "original",
        "${training_layouts[0]} and ${training_layouts.0}": "original and original",
        "${oc.env:AFFMAP_TEST} ${oc.env:AFFMAP_NOT,other}": "mine other",
        "${hydra.runtime.choices.planner}": "cem",
        "costs $3 {a: b}": "costs $3 {a: b}",
    }.items():
        assert values(compose([f"title='{text}'"]))["title"] == value


def test_hydra_s_own_folders_may_have_the_time_in_their_names() -> None:
    composed = compose(["hydra.run.dir='logs/${now:%Y}'"])
    assert launch_settings(composed)["hydra.run.dir"].startswith("logs/2")


@pytest.mark.parametrize(("above", "written"), [("", "'{}'"), ("", "[{}]"), ("hydra.job.env_set.", "'{}'")])
def test_references_that_multiply_are_told_without_being_resolved(above: str, written: str) -> None:
    """Ten references to ten references ... to one value, ten deep, as text and as lists: 10^10 values."""
    names = [f"{above}x{depth}" for depth in range(10)]
    separator = "," if "[" in written else ""
    lines = [
        f"+{one}={written.format(separator.join([f'${{{other}}}'] * 10))}"
        for one, other in zip(names, [*names[1:], "world"], strict=True)
    ]
    message = told(lines)
    assert message.startswith(f"{above}x0") and message.endswith("write the value itself.")
    assert f"stands for more than {MOST_EXPANDED} values or characters" in message


def test_a_reference_in_a_mapping_that_is_a_reference_counts() -> None:
    """`${x.a.b}`, where `x.a` refers to a mapping: it is not lost on the way."""
    many = ",".join(["${x.list}"] * 100)
    line = [f"+x={{list: [{','.join(['1'] * 200)}], all: {{b: [{many}]}}, a: '${{x.all}}', c: '${{x.a.b}}'}}"]
    assert told(line).startswith(("x.a = '${x.all}' refers to", "x.c = '${x.a.b}' refers to"))


def test_a_reference_to_itself_ends() -> None:
    assert told(["title=${title}"]).startswith("this cannot be read: ")
    assert told(["+x=${y}${y}", "+y=${x}${x}"]).startswith("this cannot be read: ")


@pytest.mark.parametrize("line", ["seed=shuffle(0,1,2)", "seed=shuffle(range(3))", "baselines=shuffle([random])"])
def test_an_order_that_changes_is_refused(line: str) -> None:
    """Labels and settings of jobs are read one after the other, and would be in different orders."""
    assert told([line]).endswith("it has another order each time it is read; write the order itself.")
