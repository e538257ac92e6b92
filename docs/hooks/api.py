"""The reference: a page for each public name, under the name that users type, and their index.

Public names are those that the stubs (`__init__.pyi`) of the package and of its folders hand on. `docs/api.md` groups
them in lists of links, below the heading of a group:

| link to | stands for |
|---|---|
| `../affmap/gaussian.py#kl` | a name of a module |
| `../affmap/plot/__init__.py` | a folder |
| `../affmap/planning` | the names in `affmap.__all__` that come from a folder and have no link |
| `../affmap/__init__.pyi` | those that come from none of the folders on the page |
"""

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module

import griffe
import keys
from links import dotted
from places import DOCS, ROOT

from affmap.report.markdown import code, table
from affmap.settings import Settings

LINES = r"(?:^- \[.+\]\(\.\./affmap/.+\)\n)+"


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each public name."""
    names = [name for group in groups().values() for name in group]
    for name in names:
        described = member(name)
        page = _PAGE.format(name=name, title=typed(name))
        if _is_settings(described):
            page = _settings(name, described)
        if described.is_subpackage:  # names that it hands on have pages of their own
            inside = [each for each in names if typed(each).startswith(f"{name}.")]
            page = f"{page}      members: false\n\n{_table(inside)}"
        yield place(name), page


_PAGE = """---
title: {title}
---

::: {name}
    options:
      heading: {title}
      toc_label: {title}
      heading_level: 1
"""

_SETTINGS = """---
title: {title}
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
    """The index, where each link of `docs/api.md` is a row with a link and a sentence."""
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


def _names(lines: str) -> list[str]:
    """Full names that some links stand for."""
    names: list[str] = []
    for target in _targets(lines):
        path, _, name = target.partition("#")
        if name:
            names.append(dotted(path, name))
        elif path.endswith("/__init__.py"):
            names.append(path.removesuffix("/__init__.py").replace("/", "."))
        else:
            names += _public(target)
    return names


def _public(target: str) -> list[str]:
    """Full names of `affmap.__all__` that have no link: of a folder, or, for the stub, of all folders without one."""
    targets = _targets((DOCS / "api.md").read_text("utf-8"))
    linked = {dotted(*each.split("#")) for each in targets if "#" in each}
    names = [name for name, short in exports().items() if short.count(".") == 1 and name not in linked]
    return [name for name in names if target == (_folder(name) if _folder(name) in targets else STUB)]


STUB = "affmap/__init__.pyi"


def _folder(name: str) -> str:
    return "/".join(name.split(".")[:2])


def _targets(markdown: str) -> list[str]:
    """Paths in the repository of a text's links to the package."""
    return re.findall(r"\]\(\.\./(affmap/.+)\)", markdown)


def _table(names: list[str]) -> str:
    rows = [f"| [`{typed(name)}`][{name}] | {summary(name)} |" for name in names]
    return "\n".join(["| name | purpose |", "|---|---|", *rows, ""])
