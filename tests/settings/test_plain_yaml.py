"""Plain YAML, by hand: keys that stand twice and aliases that multiply are told, with file, key and line."""

from collections.abc import Callable

import pytest
import yaml

from affmap.settings import ConfigError, plain_yaml

BOMB = "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
"""Less than 400 bytes that mean 9^9 values, 400 million."""


def told(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        plain_yaml.load(text, "conf/mine.yaml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "key"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "a"),
        ("a: 1\n'a': 1\n", 2, "a"),
        ("a:\n  - b: 1\n  - {c: 1, d: 2, c: 1}\n", 3, "c"),
        ("a: {b: {c: 1}}\nd: 1\na: {b: {e: 1}}\n", 3, "a"),
        ("1: a\n1: b\n", 2, "1"),
        ("a: &a {b: 1}\nc: {<<: *a, b: 2, b: 3}\n", 2, "b"),
        ("a: !!set {b, b}\n", 1, "b"),
    ],
)
def test_a_key_that_stands_twice_is_told_with_file_and_line(text: str, line: int, key: str) -> None:
    """Wherever it stands; PyYAML alone keeps the last one."""
    assert told(text) == f"conf/mine.yaml, line {line}: the key {key!r} stands twice; keep one of the two."
    assert yaml.safe_load(text)


def test_merge_keys_may_be_overridden() -> None:
    """Against values written out; one override is inside a mapping that is merged before it is read itself."""
    text = """
one: &one {x: 1, y: 1}
deep: {deeper: {two: &two {<<: *one, y: 2}}}
three: {<<: *two, x: 3}
four: {<<: [*one, *two], z: 4}
five: {<<: *one, <<: {z: 5}}
"""
    assert plain_yaml.load(text, "here") == {
        "one": {"x": 1, "y": 1},
        "deep": {"deeper": {"two": {"x": 1, "y": 2}}},
        "three": {"x": 3, "y": 2},
        "four": {"x": 1, "y": 1, "z": 4},
        "five": {"x": 1, "y": 1, "z": 5},
    }


@pytest.mark.parametrize(
    "text",
    [
        BOMB,
        BOMB.replace("[", "[{x: ").replace(",", "}, {x: ").replace("]", "}]"),
        "a: &a {x: 1}\n"
        + "".join(f"a{n + 1}: &a{n + 1} {{<<: [{', '.join([f'*a{n}'.removesuffix('0')] * 9)}]}}\n" for n in range(9)),
        "a: &a [*a]\n",
        "a: &a {b: [1, *a]}\n",
    ],
)
@pytest.mark.parametrize("read", [plain_yaml.load, plain_yaml.check_aliases])
def test_aliases_that_multiply_are_told_without_being_written_out(
    read: Callable[[str, str], object], text: str
) -> None:
    """Lists, mappings and merge keys of nine times nine times nine ..., and an alias in itself."""
    with pytest.raises(
        ConfigError, match=r"^here has aliases that stand for more than 10000 values; write out fewer values\.$"
    ):
        read(text, "here")


def test_aliases_that_stand_for_little_are_read() -> None:
    """As PyYAML reads them; 100 aliases of 100 values are as many as there may be."""
    text = f"a: &a [{', '.join(['1'] * 98)}]\nb: [{', '.join(['*a'] * 100)}]\n"
    assert plain_yaml.load(text, "here") == yaml.safe_load(text)
    plain_yaml.check_aliases(text, "here")
    plain_yaml.check_aliases("a: [*b, &c", "no YAML")


@pytest.mark.parametrize("value", ["[" * 900, "2026-13-01", "!!int x", "!!int ''", "!!timestamp x", "9" * 5000, "\0"])
def test_values_that_python_stumbles_over_are_told_with_the_file(value: str) -> None:
    """PyYAML lets Python's own errors through."""
    assert told(f"a: {value}\n").startswith("conf/mine.yaml is not plain YAML: ")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1\nb: [1\nc: 2\n", "line 3: while parsing a flow sequence, expected ',' or ']', but got ':'"),
        (
            "a: 1\n\tb: 2\n",
            "line 2: while scanning for the next token, found character '\\t' that cannot start any token",
        ),
        ("a: 1\nb: !mine 3\n", "line 2: could not determine a constructor for the tag '!mine'"),
        ("a: 1\n---\nb: 2\n", "line 2: expected a single document in the stream, but found another document"),
        ("a: 1\nb: \0\n", "line 2: the character '\\x00' is not allowed"),
        ("a: " + "[" * 5000, "it is nested too deeply"),
    ],
)
def test_errors_of_yaml_name_the_file_and_the_line(text: str, reason: str) -> None:
    """Golden sentences, without the places and names that PyYAML has for a text."""
    assert told(text) == f"conf/mine.yaml is not plain YAML: {reason}."
