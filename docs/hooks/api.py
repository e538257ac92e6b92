"""The reference: a page for each public name, under the name that users type, and their index.

Public names are those that the stubs (`__init__.pyi`) of the package and of its folders hand on. `docs/api.md` groups
them. Its lines are, below the heading of a group,

| line | stands for |
|---|---|
| `::: affmap.gaussian.kl` | a name of a folder or a module |
| `{{ public planning }}` | the names in `affmap.__all__` that come from a folder and have no line |
| `{{ public }}` | those that come from none of the folders named on the page |
"""

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module

import griffe
import keys
from places import DOCS, ROOT

from affmap.report.markdown import code, table
from affmap.settings import Settings

LINES = r"(?:^(?:\{\{ public.*\}\}|::: .+)\n)+"


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each public name."""
    names = [name for group in groups().values() for name in group]
    for name in names:
        described = member(name)
        page = _PAGE.format(name=name, title=typed(name), short=short(name))
        if _is_settings(described):
            page = _settings(name, described)
        if described.is_subpackage:  # names that it hands on have pages of their own
            inside = [each for each in names if typed(each).startswith(f"{name}.")]
            page = f"{page}      members: false\n\n{_table(inside)}"
        yield place(name), page


_PAGE = """---
title: {short}
---

::: {name}
    options:
      heading: {title}
      toc_label: {title}
      heading_level: 1
"""

_SETTINGS = """---
title: {short}
---

# {title}

```python
{signature}
```

::: {name}
    options:
      show_root_heading: false
      members: false

{keys}
"""

_METHOD = """
::: {name}
    options:
      heading: {short}
      toc_label: {short}
      heading_level: 2
"""


def _settings(name: str, described: griffe.Object | griffe.Alias) -> str:
    """The page of a class of settings: its keys in a table, then its methods and properties."""
    module, _, kind = name.rpartition(".")
    settings: type[Settings] = getattr(import_module(module), kind)
    rows = [(code(key), words, meaning) for key, words, meaning in keys.described(settings) if meaning]
    page = _SETTINGS.format(
        name=name,
        title=typed(name),
        short=short(name),
        signature=_signature(settings),
        keys=table(["key", "type", "meaning"], rows),
    )
    own = [each for each in described.members if not each.startswith("_") and each not in settings.model_fields]
    return page + "".join(_METHOD.format(name=f"{name}.{each}", short=each) for each in own)


def _is_settings(described: griffe.Object | griffe.Alias) -> bool:
    """Whether it is a class whose signature is made when Python runs."""
    return isinstance(described, griffe.Class) and any(base.path == SETTINGS for base in described.mro())


SETTINGS = "affmap.settings.base.Settings"


def _signature(kind: type[Settings]) -> str:
    """The signature of a class, a line for each argument."""
    lines = [f"    {parameter}," for parameter in inspect.signature(kind).parameters.values()]
    return "\n".join([f"{kind.__name__}(", "    *,", *lines, ")"])


def place(name: str) -> str:
    """The page of a name."""
    return f"api/{typed(name)}.md"


def index(markdown: str) -> str:
    """The index, where each line of `docs/api.md` is a row with a link and a sentence."""
    return re.sub(LINES, lambda lines: _table(_names(lines[0])), markdown, flags=re.M)


def groups() -> dict[str, list[str]]:
    """Heading of `docs/api.md` -> full names of its group."""
    parts = re.findall(rf"^## (.+)\n\n({LINES})", (DOCS / "api.md").read_text("utf-8"), flags=re.M)
    return {heading: _names(lines) for heading, lines in parts}


@cache
def exports() -> dict[str, str]:
    """Full name -> the shortest name under which a stub hands it on."""
    names: dict[str, str] = {}
    for stub in sorted((ROOT / "affmap").rglob("__init__.pyi"), key=lambda path: len(path.parts)):
        package = ".".join(stub.parent.relative_to(ROOT).parts)
        for node in ast.parse(stub.read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:  # others hand on a whole folder
                for alias in node.names:
                    full = f"{package}.{node.module}.{alias.name}"
                    names.setdefault(full, f"{package}.{alias.asname or alias.name}")
    return names


def typed(name: str) -> str:
    """The name that users type."""
    return exports().get(name, name)


def short(name: str) -> str:
    """The last part of a name, for lists."""
    return name.rpartition(".")[2]


def summary(name: str) -> str:
    """The first sentence of a name's docstring, for a cell of a table."""
    docstring = member(name).docstring
    first = " ".join(docstring.value.split("\n\n")[0].split()) if docstring else ""
    return re.split(r"(?<=\w\w\.)\s", first)[0].rstrip(".:").replace("|", "\\|")


def member(name: str) -> griffe.Object | griffe.Alias:
    """A name as the source describes it; nothing is imported."""
    return _package()[name.removeprefix("affmap.")]


@cache
def _package() -> griffe.Object | griffe.Alias:
    return griffe.load("affmap", search_paths=[ROOT], docstring_parser="google")


def _public(folders: list[str]) -> list[str]:
    """Full names of `affmap.__all__` without a line here: from some folders, or from those that it never names."""
    page = (DOCS / "api.md").read_text("utf-8")
    named = " ".join(re.findall(r"^\{\{ public (.+) \}\}$", page, flags=re.M)).split()
    public = [name for name, short in exports().items() if short.count(".") == 1 and f"::: {name}\n" not in page]
    return [name for name in public if (name.split(".")[1] in folders if folders else name.split(".")[1] not in named)]


def _names(lines: str) -> list[str]:
    names: list[str] = []
    for line in lines.splitlines():
        words = line.strip("{}: ").split()
        names += _public(words[1:]) if line.startswith("{{") else words
    return names


def _table(names: list[str]) -> str:
    rows = [f"| [`{typed(name)}`][{name}] | {summary(name)} |" for name in names]
    return "\n".join(["| name | purpose |", "|---|---|", *rows, ""])
