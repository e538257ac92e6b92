"""Pages as text: Markdown in which `{{ name argument }}` stands for a part of a report, and its building blocks.

A directive is a method of the page's content. `{{ include name }}` inserts another text. That text is left out if
all of its directives on lines of their own are empty, so a heading and its explanation come and go with their table.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from inspect import isfunction, signature
from pathlib import Path

from affmap.settings import ConfigError

_DIRECTIVE = re.compile(r"\{\{(.*?)\}\}")
_SPECIAL = re.compile(r"[\\`*_{}\[\]#]")
_ENTITIES = {"&": "&amp;", "<": "&lt;", ">": "&gt;", "|": "&#124;", "$": "&#36;", "~": "&#126;"}
"""Of these, dollars and tildes are markup on GitHub, and a backslash before them is not known everywhere."""


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
    return re.sub(r"\n{3,}", "\n\n", _fill(path, content, folders)[0]).strip() + "\n"


def _fill(
    path: Path, content: object, folders: Sequence[Path], parents: tuple[Path, ...] = ()
) -> tuple[str, list[str]]:
    """Fill the directives of a text; also return the values of those on lines of their own, in included texts, too."""
    if path in parents:
        raise ConfigError(f"{path} includes itself, by way of {', '.join(each.name for each in parents)}.")
    shown: list[str] = []

    def value(directive: re.Match[str]) -> str:
        if not (parts := re.fullmatch(r" (\w+)(?: ([\w/]+))? ", directive[1])):
            raise ConfigError(f"{path}: {directive[0]} cannot be read; write {{{{ name }}}} or {{{{ name word }}}}.")
        name, argument = parts.groups()
        if name == "include":
            text, values = _include(path, argument, content, folders, parents)
            shown.extend(values)
            return text.strip()
        text = _call(path, directive[0], content, name, argument)
        before, after = directive.string[: directive.start()], directive.string[directive.end() :]
        if before[-1:] in ("", "\n") and after[:1] in ("", "\n"):
            shown.append(text)
        return text.strip()

    return _DIRECTIVE.sub(value, path.read_text("utf-8")), shown


def _call(path: Path, directive: str, content: object, name: str, argument: str | None) -> str:
    methods = [
        each for each in dir(content) if not each.startswith("_") and isfunction(getattr(type(content), each, 0))
    ]
    if name not in methods:
        raise ConfigError(f"{path}: {directive} is not a directive; choose one of: include, {', '.join(methods)}.")
    method: Callable[..., str] = getattr(content, name)
    parameters = list(signature(method).parameters)
    if len(parameters) != (argument is not None):
        remedy = " ".join([name, *parameters])
        raise ConfigError(
            f"{path}: {directive} needs {'an argument' if parameters else 'no argument'}; write {{{{ {remedy} }}}}."
        )
    try:
        return method(argument) if argument is not None else method()
    except ConfigError as error:
        raise ConfigError(f"{path}: {directive}: {error}") from None


def _include(
    path: Path, name: str | None, content: object, folders: Sequence[Path], parents: tuple[Path, ...]
) -> tuple[str, list[str]]:
    """Fill an included text, and return its values; the text is empty if it has values and all of them are empty."""
    files = [folder / f"{name}.md" for folder in folders]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        raise ConfigError(f"{path}: there is no text {name!r} to include; looked for {', '.join(map(str, files))}.")
    text, shown = _fill(file, content, folders, (*parents, path))
    return text if any(shown) or not shown else "", shown


def escape(text: str) -> str:
    """Text as one line of Markdown, with all markup escaped."""
    marked = _SPECIAL.sub(r"\\\g<0>", " ".join(text.split()))
    for character, entity in _ENTITIES.items():
        marked = marked.replace(character, entity)
    return re.sub(r"^(\d*)([-+.)])(?=\s|$)", r"\1\\\2", marked)  # no list begins here


def escape_name(text: str) -> str:
    """Text as by `escape`, but with underscores within words, where they are no markup."""
    return re.sub(r"(?<=\w)\\_(?=\w)", "_", escape(text))


def code(text: str) -> str:
    """Text as one line of code in Markdown, between more backticks than there are in it."""
    fence = "`" * (1 + max(map(len, re.findall("`+", text)), default=0))
    return f"{fence}{text}{fence}" if fence == "`" else f"{fence} {text} {fence}"


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
