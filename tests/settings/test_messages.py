"""Lists in messages: the first of many, and the number of the others; by hand."""

from affmap.settings.messages import FEW, MOST, few, first_lines


def test_a_sentence_lists_few_names() -> None:
    names = list("abcdefg")
    assert FEW == 5 and few(names) == "a, b, c, d, e and 2 more" and few(names[:5], "; ") == "a; b; c; d; e"
    assert few([]) == ""


def test_an_error_has_few_lines() -> None:
    """The others are not even made."""
    lines = map(str, range(1, 13))
    assert MOST == 10 and first_lines(lines, 12) == [*map(str, range(1, 11)), "... and 2 more."]
    assert next(lines) == "11"
    assert first_lines(["a"], 1) == ["a"] and first_lines([], 0) == []
