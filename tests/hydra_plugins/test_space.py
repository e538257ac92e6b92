import math
from pathlib import Path
from typing import Any

import pytest
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given, settings
from hypothesis import strategies as st

from hydra_plugins.hyperopt_sweeper._space import Interval, Options, SearchError, Space, parse

PARSER = OverridesParser.create()


def space_of(*arguments: str, **params: str) -> Space:
    return parse(PARSER, params, arguments)


@pytest.mark.parametrize(
    ("text", "dimension"),
    [
        ("interval(1,20)", Interval(1.0, 20.0, log=False, integer=False)),
        ("interval(-1.5,2)", Interval(-1.5, 2.0, log=False, integer=False)),
        ("tag(log,interval(1e-4,1e-1))", Interval(1e-4, 1e-1, log=True, integer=False)),
        ("int(interval(1,20))", Interval(1, 20, log=False, integer=True)),
        ("tag(log,int(interval(1,20)))", Interval(1, 20, log=True, integer=True)),
        ("int(tag(log,interval(1,20)))", Interval(1, 20, log=True, integer=True)),
        ("choice(0.0,0.1,0.5)", Options((0.0, 0.1, 0.5), ("0.0", "0.1", "0.5"), ordered=False)),
        ("a,b", Options(("a", "b"), ("a", "b"), ordered=False)),
        ("null,true,1", Options((None, True, 1), ("null", "True", "1"), ordered=False)),
        ("str(choice(1,true))", Options(("1", "true"), ("'1'", "'true'"), ordered=False)),
        ("[1,2],{a:1},'x,y'", Options(([1, 2], {"a": 1}, "x,y"), ("[1,2]", "{a:1}", "'x,y'"), ordered=False)),
        ("choice('1','it\\'s')", Options(("1", "it's"), ("'1'", r"'it\'s'"), ordered=False)),
        ("range(1,10,2)", Options((1, 3, 5, 7, 9), ("1", "3", "5", "7", "9"), ordered=True)),
        ("range(3,0,-1)", Options((3, 2, 1), ("3", "2", "1"), ordered=True)),
        ("range(0.5,2)", Options((0.5, 1.5), ("0.5", "1.5"), ordered=True)),
        ("float(range(0,3))", Options((0.0, 1.0, 2.0), ("0.0", "1.0", "2.0"), ordered=True)),
        ("sort(3,1,2)", Options((1, 2, 3), ("1", "2", "3"), ordered=False)),
        ("shuffle(a,b,c,d,e,f,g,h)", Options(tuple("abcdefgh"), tuple("abcdefgh"), ordered=False)),
        ("shuffle(range(0,6))", Options(tuple(range(6)), tuple("012345"), ordered=True)),
    ],
)
def test_every_element_of_the_grammar(text: str, dimension: Interval | Options) -> None:
    """Reference: Hydra's documentation of the grammar, by hand; `repr` tells 1 from 1.0 and from True."""
    space = space_of(f"+model.key={text}", "other=1")
    assert repr(space.dimensions) == repr({"model.key": dimension})
    assert space.keys == {"model.key": "+model.key"}
    assert space.fixed == ["other=1"]


def test_glob_chooses_from_a_group(tmp_path: Path) -> None:
    """Reference: the files that the pattern matches, by hand."""
    (tmp_path / "db").mkdir()
    for name in ("mysql", "mongo", "sqlite"):
        (tmp_path / "db" / f"{name}.yaml").touch()
    with initialize_config_dir(str(tmp_path), version_base="1.3"):
        parser = OverridesParser.create(GlobalHydra.instance().config_loader())
        assert parse(parser, {}, ["db=glob(m*)"]).dimensions["db"] == Options(
            ("mongo", "mysql"), ("mongo", "mysql"), ordered=False
        )
        with pytest.raises(SearchError, match=r"^db=glob\(x\*\): there is no value that db could have"):
            parse(parser, {}, ["db=glob(x*)"])


def test_the_command_line_wins_over_the_configuration_file() -> None:
    """Reference: written by hand; a key is the same with and without a leading +."""
    space = space_of("+a=interval(0,2)", "b=7", a="interval(0,1)", b="interval(0,1)", c="3", d="x,y")
    assert {key: str(dimension) for key, dimension in space.dimensions.items()} == {
        "a": "interval(0.0,2.0)",
        "d": "choice(x,y)",
    }
    assert space.fixed == ["b=7", "c=3"]
    assert space.overrides({"a": 0.5, "d": 1}) == ["b=7", "c=3", "+a=0.5", "d=y"]


def test_other_overrides_stay_as_they_are() -> None:
    """Reference: the command line itself."""
    fixed = ["~gone", "++forced=[1,2]", "db@backup=mysql", "text='a, b'"]
    assert space_of(*fixed, "x=1,2").fixed == fixed


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("tag(log,interval(0,1))", "a logarithmic interval cannot begin at 0.0; begin it above 0, or omit the tag"),
        ("tag(log,int(interval(-3,1)))", "cannot begin at -3"),
        ("interval(2,2)", "the interval is empty, because 2.0 is not less than 2.0"),
        ("interval(2,1)", "the interval is empty, because 2.0 is not less than 1.0"),
        ("int(interval(1.2,1.8))", "the interval is empty, because 1 is not less than 1"),
        ("interval(0,inf)", "must be finite"),
        ("interval(nan,1)", "must be finite"),
        ("tag(ln,interval(1,2))", "the tag ln means nothing here; the only one is log"),
        ("tag(log,ordered,interval(1,2))", "the tag ordered means nothing here"),
        ("tag(log,choice(1,2))", "the tag log means nothing here"),
        ("range(3,3)", "there is no value that lr could have"),
    ],
)
def test_a_bad_space_is_a_sentence_with_its_key(text: str, problem: str) -> None:
    """Reference: written by hand."""
    with pytest.raises(SearchError) as error:
        space_of(f"lr={text}")
    assert str(error.value).startswith(f"lr={text}: ") and problem in str(error.value)
    with pytest.raises(SearchError) as same:
        space_of(lr=text)
    assert str(same.value) == str(error.value)


def test_nothing_to_search_over() -> None:
    """Reference: written by hand."""
    with pytest.raises(SearchError, match=r"nothing to search over; give at least one key a space"):
        space_of("x=1", y="[1,2]")


intervals = st.builds(
    lambda low, width: f"interval({low},{low + width})", low=st.floats(-1e6, 1e6), width=st.floats(1e-3, 1e6)
)
integers = st.builds(
    lambda low, width: f"int(interval({low},{low + width}))", low=st.integers(-99, 99), width=st.integers(1, 99)
)
logs = st.builds(
    lambda low, factor: f"tag(log,interval({low},{low * factor}))", low=st.floats(1e-9, 1e3), factor=st.floats(1.1, 1e6)
)
log_integers = st.builds(
    lambda low, width: f"tag(log,int(interval({low},{low + width})))",
    low=st.integers(1, 99),
    width=st.integers(1, 9999),
)
ranges = st.builds(
    lambda low, width, step: f"range({low},{low + width},{step})",
    low=st.integers(-99, 99),
    width=st.integers(1, 99),
    step=st.integers(1, 9),
)
element = st.one_of(
    st.integers(-99, 99),
    st.booleans(),
    st.sampled_from(["abc", "'12'", "'a,b'", "[1,2]", "{a:1}", "1e-05", "-0.5", "'it\\'s'"]),
)
choices = st.lists(element, min_size=1, max_size=5).map(lambda items: f"choice({','.join(map(str, items))})")
spaces = st.one_of(intervals, integers, logs, log_integers, ranges, choices)


@given(text=spaces, fractions=st.lists(st.floats(0, 1), min_size=1, max_size=4))
@settings(deadline=None, max_examples=60)
def test_jobs_read_the_values_that_are_recorded(text: str, fractions: list[float]) -> None:
    """Reference: Hydra's own parser, of what the job gets; alone and stacked."""
    space = space_of(f"key={text}")
    dimension = space.dimensions["key"]
    low, high = (dimension.low, dimension.high) if isinstance(dimension, Interval) else (0, len(dimension.values) - 1)
    points = [{"key": low + fraction * (high - low)} for fraction in fractions]
    values = [space.values(point)["key"] for point in points]
    read: list[Any] = [PARSER.parse_override(space.overrides(point)[-1]).value() for point in points]
    assert repr(read) == repr(values)
    assert repr(PARSER.parse_override(space.stacked(points)[-1]).value()) == repr(values)
    for value in values:  # and back
        assert repr(space.values(space.point({"key": value}, "here"))["key"]) == repr(value)


def test_what_rounding_puts_outside_is_taken_for_the_end() -> None:
    """Reference: the ends; logarithms miss them by a bit, and whole numbers are drawn from half a step beyond."""
    rate, count, options = space_of(
        "a=tag(log,interval(0.1,0.3))", "b=int(interval(1,3))", "c=range(4,8)"
    ).dimensions.values()
    assert [rate.value(math.nextafter(0.1, 0)), rate.value(math.nextafter(0.3, 1))] == [0.1, 0.3]
    assert [count.value(0.5), count.value(3.5)] == [1, 3]
    assert [options.value(-0.5), options.value(3.5)] == [4, 7]


@pytest.mark.parametrize(
    ("text", "inside", "outside"),
    [
        ("interval(0,1)", [0, 1, 0.5], [-1e-9, 1.01, "0.5", True, None, float("nan")]),
        ("int(interval(1,5))", [1, 5, 2.0], [0, 6, 2.5]),
        ("1,true,null,b", [1, 1.0, True, None, "b"], [False, 2, "1", "a"]),
        ("range(0,1,0.1)", [0, 0.3, 0.9], [1.0, 0.35]),
    ],
)
def test_what_lies_in_a_space(text: str, inside: list[Any], outside: list[Any]) -> None:
    """Reference: written by hand; true is not 1, and 0.3 is 3 x 0.1."""
    space = space_of(f"key={text}")
    for value in inside:
        actual = space.values(space.point({"key": value}, "here"))["key"]
        assert actual == pytest.approx(value) if isinstance(value, float) else actual == value
    for value in outside:
        with pytest.raises(SearchError, match=r"^hydra.sweeper.initial\[0\]: key = .* does not lie in"):
            space.point({"key": value}, "hydra.sweeper.initial[0]")


def test_a_point_names_each_key_and_no_other() -> None:
    """Reference: written by hand."""
    space = space_of("a=1,2", "b=3,4")
    with pytest.raises(SearchError, match="here has values of a, c, but the searched keys are a, b; give a value"):
        space.point({"a": 1, "c": 3}, "here")
