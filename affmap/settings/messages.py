"""Error messages for invalid configuration values, one line each."""

import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from itertools import islice
from typing import Any, Literal

from pydantic_core import ErrorDetails

VARIABLE = "AFFMAP_IMPORT"
"""Environment variable with the names of users' modules, separated by commas; they may lie in the current folder."""

OWN = f"one of your own is known once {VARIABLE}, or an entry point of its package, names its module"
"""How names from outside become known (`affmap.settings.extensions`), for messages about unknown ones."""

MOST = 10
"""Sentences of one error; further ones are only counted."""

FEW = 5
"""Names that a sentence lists where there may be hundreds; further ones are only counted."""


_PROBLEMS = {
    "path_type": "should be the path of a folder",
    "model_type": "should be a valid dictionary",
    "int_parsing_size": "should have fewer digits",
}
"""Problems for which pydantic's words name classes, or are no part of a sentence."""


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names key, value and remedy."""


def format_value(value: Any, length: int = 100) -> str:
    """A value for an error message: on one line, printable, and not longer than `length`."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of more than 4,300 digits, a list in a list in a list ...
        return f"<{type(value).__name__} too large to be shown>"
    return text if len(text) <= length else f"{shorten(text, length)} ({len(text)} characters)"


def nearest(word: str, options: Iterable[str]) -> str | None:
    """The option that a misspelt word most likely means; None where none is near."""
    return next(iter(get_close_matches(word, [*options], 1)), None)


def alternatives(word: str, options: Sequence[str], heading: str = "there are") -> str:
    """The end of a sentence about an option that does not exist: the nearest one, if one is near, and all options."""
    listed = ", ".join(options)
    return f"did you mean {near}? There are: {listed}." if (near := nearest(word, options)) else f"{heading}: {listed}."


def shorten(text: str, length: int) -> str:
    """The beginning and the end of a text that is longer than `length`."""
    if len(text) <= length:
        return text
    return f"{text[: length - 15]} ... {text[-10:]}"


def counted(number: int, noun: str) -> str:
    """A number with its noun, which takes an s unless it is one."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def few(names: Sequence[str], separator: str = ", ") -> str:
    """The first few names of a list, and the number of the others."""
    rest = len(names) - FEW
    return separator.join(names[:FEW]) + (f" and {rest} more" if rest > 0 else "")


def first_lines(lines: Iterable[str], number: int) -> list[str]:
    """The first lines of an error that has so many, and a line with the number of the others, which are not made."""
    return [*islice(lines, MOST), *([f"... and {number - MOST} more."] if number > MOST else [])]


def one_line(text: str, length: int = 600) -> str:
    """A text on one line, without characters that cannot be printed, and not longer than `length`."""
    return shorten(printable(" ".join(text.split())), length)


def printable(text: str) -> str:
    """A text of one or more lines, in which characters that cannot be printed, such as escapes, are spelt out."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


class PrintableFormatter(logging.Formatter):
    """Formats log messages, which may quote files and names of files, so that they do not control a terminal."""

    def __init__(self, fmt: str, datefmt: str | None = None, style: Literal["%"] = "%", setting: str = "") -> None:
        """Begin each message with the `setting` of the job that logs it, such as the values of swept keys."""
        super().__init__(fmt, datefmt, style)
        self._setting = shorten(setting, 100)  # a search may try many values at once

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  # the name that `logging` calls
        """The message with the setting."""
        record.message = ": ".join(filter(None, [self._setting, record.getMessage()]))
        return super().formatMessage(record)

    def format(self, record: logging.LogRecord) -> str:
        """The message as a printable text."""
        return printable(super().format(record))


Keys = Callable[[Mapping[str, Any], str], Iterable[str]]
"""Of some values and an unknown key of theirs: the keys that they may have."""


def sentences(errors: Sequence[ErrorDetails], values: Any, origin: str, origins: Mapping[str, str], known: Keys) -> str:
    """A line for each invalid value: its origin, and the error; keys with the same one share a line.

    Args:
        errors: from pydantic.
        values: those that were validated.
        origin: where the values come from.
        origins: the same for single keys that come from elsewhere.
        known: the keys that settings may have in place of an unknown one.
    """
    keys: dict[tuple[str, str], list[str]] = {}
    for item in errors:
        place = origins.get(str(item["loc"][0]) if item["loc"] else "", origin)
        text = one_line(sentence(item, values, known))
        key, equals, rest = text.partition(" = ")
        keys.setdefault((place, equals + rest if equals else text), []).append(key if equals else "")
    lines = (f"{place}: {', '.join(dict.fromkeys(each))}{rest}" for (place, rest), each in keys.items())
    return "\n".join(first_lines(lines, len(keys)))


def sentence(item: ErrorDetails, values: Any, known: Keys) -> str:
    """An invalid value in a sentence: key = value, error, remedy."""
    key, value = _key(item["loc"], values, item["type"] == "missing"), format_value(item["input"])
    problem = _PROBLEMS.get(item["type"]) or re.sub(r"^(Value error, |\w+ (?=should ))", "", item["msg"])
    problem = shorten(problem, 600)
    if item["type"] == "missing":
        return f"{key} is missing; add the key."
    if item["type"] == "extra_forbidden":
        holder = _holder(item["loc"], values)
        of = f" of kind = {format_value(holder['kind'])}" if "kind" in holder else ""
        remedy = _remedy(item["loc"], key, known(holder, str(item["loc"][-1])))
        return f"{key} = {value} is not a known key{of}; {remedy}"
    if item["type"] == "invalid_key" or (item["loc"][-1:] == ("[key]",) and not isinstance(item["input"], str)):
        return f"{key}: the key is not text; put quotes around it, or remove it."
    if item["type"] == "union_tag_not_found":
        return f"{key}.kind is missing; add the key."
    if item["type"] == "union_tag_invalid":
        tags = item["ctx"]["expected_tags"].replace(", ", " or ")
        return f"{key}.kind = {format_value(item['ctx']['tag'])} is not allowed: it should be {tags}; {OWN}."
    if item["type"] == "value_error" and isinstance(item["input"], Mapping):
        return f"{key}: {problem}" if key else problem  # a check of several keys names them and their values itself
    if isinstance(item.get("ctx", {}).get("error"), ConfigError):
        return f"{key} = {value}: {problem}"  # the value names a file with a mistake of its own
    return f"{key} = {value} is not allowed: it {problem}."


def _remedy(location: Sequence[int | str], key: str, known: Iterable[str]) -> str:
    """The end of a sentence about an unknown key; below the top, pydantic does not tell which keys there may be."""
    if len(location) == 1:
        return alternatives(key, [*known])
    near = nearest(str(location[-1]), known)
    return f"did you mean {key[: key.rfind('.') + 1]}{near}?" if near else "remove it or correct its spelling."


def _key(location: Sequence[int | str], values: Any, is_missing: bool) -> str:
    """The dotted key of a place in `values`, which may lack the last part."""
    key = ""
    for place, part in enumerate(location):
        is_missing_part = is_missing and place == len(location) - 1
        if isinstance(part, str) and not is_missing_part and not (isinstance(values, Mapping) and part in values):
            continue  # pydantic also names the alternatives that it has tried
        key += f"[{part}]" if isinstance(part, int) else f".{format_value(part)[1:-1]}"
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            values = None
    return key.lstrip(".")


def _holder(location: Sequence[int | str], values: Any) -> Any:
    """The part of `values` that has the last key of a location."""
    for part in location[:-1]:
        if isinstance(part, int) or part in values:  # pydantic also names the alternatives that it has tried
            values = values[part]
    return values
