"""Pages as text: Markdown in which `{{ name argument }}` stands for a part of a report, and its building blocks.

A directive is a method of the page's content. `{{ include name }}` inserts another text. That text is left out if
all of its directives on lines of their own are empty, so a heading and its explanation come and go with their table.
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
        folders: searched for included texts, in this order.

    Returns:
        Markdown without consecutive empty lines.

    Raises:
        ConfigError: a directive or an included text does not exist.
    """
    return re.sub(r"\n{3,}", "\n\n", _fill(path, content, folders)).strip() + "\n"


def _fill(path: Path, content: object, folders: Sequence[Path], lines: list[str] | None = None) -> str:
    """Fill the directives of a text; `lines` collects the values of those on a line of their own, except includes."""

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
    """Fill an included text; empty if it has directives on lines of their own and all of them are empty."""
    files = [folder / f"{name}.md" for folder in folders]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        raise ConfigError(f"{path}: there is no text {name!r} to include; looked for {', '.join(map(str, files))}.")
    lines: list[str] = []
    text = _fill(file, content, folders, lines)
    return text if any(lines) or not lines else ""


def escape(text: str) -> str:
    """Text as one line of Markdown, with all markup escaped."""
    marked = _SPECIAL.sub(r"\\\g<0>", " ".join(text.split()))
    for character, entity in _ENTITIES.items():
        marked = marked.replace(character, entity)
    return re.sub(r"^(\d*)([-+.)])(?=\s|$)", r"\1\\\2", marked)  # no list begins here


def bullets(items: Iterable[str]) -> str:
    """Markdown list."""
    return "\n".join(f"- {item}" for item in items)


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table of cells in Markdown."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(cells)} |" for cells in rows)]) + "\n"


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table of cells in plain text."""
    return table([escape(head) for head in heads], [[escape(cell) for cell in row] for row in rows])
