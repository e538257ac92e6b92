"""Pages as text: Markdown in which `{{ name argument }}` stands for a part of a report, and the building blocks of it.

A directive is a method of the page's content. `{{ include name }}` is another text; it is left out where each line of
it that is a directive has nothing to show, so that a heading and its explanation come and go with their table.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from inspect import isfunction, signature
from pathlib import Path

from affmap.settings import ConfigError

_DIRECTIVE = re.compile(r"\{\{ (\w+)(?: ([\w/]+))? \}\}")
_SPECIAL = re.compile(r"[\\`*_{}\[\]#]")
_ENTITIES = {"&": "&amp;", "<": "&lt;", ">": "&gt;", "|": "&#124;"}


def fill(path: Path, content: object, folders: Sequence[Path]) -> str:
    """Fill the directives of a page.

    Args:
        path: the page.
        content: its public methods are the directives; each returns Markdown, empty for nothing.
        folders: where included texts are looked for, in this order.

    Returns:
        Markdown, without empty lines in a row.

    Raises:
        ConfigError: a directive or a text is not known.
    """
    return re.sub(r"\n{3,}", "\n\n", _fill(path, content, folders)).strip() + "\n"


def _fill(path: Path, content: object, folders: Sequence[Path], lines: list[str] | None = None) -> str:
    """A text with its directives filled; `lines` receives the values of those that are a line, but for includes."""

    def value(directive: re.Match[str]) -> str:
        name, argument = directive.groups()
        if name == "include":
            text = _include(path, argument, content, folders)
        else:
            text = _call(path, directive[0], content, name, argument)
        before, after = directive.string[: directive.start()], directive.string[directive.end() :]
        if lines is not None and name != "include" and before[-1:] in ("", "\n") and after[:1] in ("", "\n"):
            lines.append(text)
        return text.strip()

    return _DIRECTIVE.sub(value, path.read_text("utf-8"))


def _call(path: Path, directive: str, content: object, name: str, argument: str | None) -> str:
    methods = [
        each for each in dir(content) if not each.startswith("_") and isfunction(getattr(type(content), each, 0))
    ]
    if name not in methods:
        raise ConfigError(f"{path}: {directive} is no directive; there are: include, {', '.join(methods)}.")
    method: Callable[..., str] = getattr(content, name)
    try:
        bound = signature(method).bind(*filter(None, [argument]))
    except TypeError:
        wants = ", ".join(signature(method).parameters) or "nothing"
        raise ConfigError(f"{path}: {directive} should have {wants} after the name {name!r}.") from None
    return method(*bound.args)


def _include(path: Path, name: str | None, content: object, folders: Sequence[Path]) -> str:
    """Another text, filled; empty where it has lines that are directives, and all of them are empty."""
    files = [folder / f"{name}.md" for folder in folders]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        raise ConfigError(f"{path}: there is no text {name!r} to include; looked for {', '.join(map(str, files))}.")
    lines: list[str] = []
    text = _fill(file, content, folders, lines)
    return text if any(lines) or not lines else ""


def escape(text: str) -> str:
    """A text in a line of Markdown, none of it taken for markup."""
    marked = _SPECIAL.sub(r"\\\g<0>", " ".join(text.split()))
    for character, entity in _ENTITIES.items():
        marked = marked.replace(character, entity)
    return re.sub(r"^(\d*)([-+.)])(?=\s|$)", r"\1\\\2", marked)  # no list begins here


def bullets(items: Iterable[str]) -> str:
    """A list of Markdown texts."""
    return "\n".join(f"- {item}" for item in items)


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown cells."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(cells)} |" for cells in rows)]) + "\n"


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose cells are text."""
    return table([escape(head) for head in heads], [[escape(cell) for cell in row] for row in rows])
