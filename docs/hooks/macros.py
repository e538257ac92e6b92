"""Lines of pages that are filled in when the site is built, so that they cannot go stale.

A line `{{ what arguments }}` of a page becomes

| line | becomes |
|---|---|
| `{{ table exp1/tables/claims.md }}` | a table of `runs/reference`; with ` | text`, its rows that contain the text |
| `{{ source affmap.gaussian.nll }}` | a function; with ` | text | text`, its lines that contain one of them |
| `{{ readme Glossary }}` | a section of the README, with its links to places of the site |
| `{{ tried }}` | the table of what the tests try |
| `{{ plot description }}` | the figure that the page's code above draws, see `plots.py` |
| `{{ environments }}` | cards of all environments |
| `{{ commands }}` | a table of all commands |
| `{{ settings }}` | every group and key of the configuration |
"""

import csv
import inspect
import re
from collections.abc import Callable
from importlib import import_module
from typing import Any

import commands
import environments
import settings
from places import REFERENCE, ROOT

from affmap.report.markdown import text_table

PLACES = {
    r"docs/(.+?)": r"\1",
    r"notebooks/(\w+)\.ipynb": r"notebooks/\1.md",
    r"runs/reference/(\w+)/report\.md": r"experiments/\1.md",
    r"runs/reference/paper/tables/claims\.md": r"results.md",
    r"runs/reference/(.+?)": r"reference/\1",
}
"""Links of the README -> where the site has the same."""


def fill(markdown: str) -> str:
    """Fill in the lines of a page."""
    return re.sub(r"^\{\{ (\w+)(?: (.+))? \}\}$", _filled, markdown, flags=re.M)


def _filled(line: re.Match[str]) -> str:
    macro = MACROS.get(line[1])
    if not macro:
        return line[0]  # a directive of reports that a page shows
    return macro(*(line[2].split(" | ") if line[2] else ()))


def table(path: str, *texts: str) -> str:
    """A Markdown table of the reference run, or those of its rows that contain all of some texts."""
    head, line, *rows = [row for row in (REFERENCE / path).read_text("utf-8").splitlines() if row.startswith("|")]
    chosen = [row for row in rows if all(text in row for text in texts)]
    if not chosen:
        raise ValueError(f"{path} has no row with {', '.join(texts)}.")
    return "\n".join([head, line, *chosen])


def source(name: str, *texts: str) -> str:
    """A function, or those of its lines that contain one of some texts, under the name of its file."""
    module, path = _split(name)
    thing: Any = import_module(module)
    for part in path.split("."):
        thing = getattr(thing, part)
    lines, _ = inspect.getsourcelines(getattr(thing, "fget", thing))
    chosen = [line for line in lines if not texts or any(text in line for text in texts)]
    missing = [text for text in texts if not any(text in line for line in chosen)]
    if missing:
        raise ValueError(f"{name} has no line with {', '.join(missing)}.")
    indent = min(len(line) - len(line.lstrip()) for line in chosen if line.strip())
    code = "".join(line[indent:] if line.strip() else line for line in chosen)
    return f"`{module.replace('.', '/')}.py`, `{path}`:\n\n```python\n{code}```"


def readme(heading: str) -> str:
    """The text below a heading of the README; for pages in the folder `docs` itself."""
    found = re.search(
        rf"^## {re.escape(heading)}\n(.+?)(?=^## |\Z)", (ROOT / "README.md").read_text("utf-8"), re.M | re.S
    )
    if not found:
        raise ValueError(f"README.md has no heading {heading}.")
    text = found[1].strip()
    for pattern, place in PLACES.items():
        text = re.sub(rf"\]\({pattern}\)", rf"]({place})", text)
    return text


def tried() -> str:
    """Attacks on affmap that the tests try, how often, and the outcome: `docs/tried.csv`, which they write."""
    with (ROOT / "docs/tried.csv").open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return text_table(heads, [(attack, f"{int(times):,}", outcome) for attack, times, outcome in rows])


def _split(name: str) -> tuple[str, str]:
    """A dotted name as that of its module and the rest."""
    parts = name.split(".")
    depth = max(d for d in range(1, len(parts)) if ROOT.joinpath(*parts[:d]).with_suffix(".py").is_file())
    return ".".join(parts[:depth]), ".".join(parts[depth:])


MACROS: dict[str, Callable[..., str]] = {
    "table": table,
    "source": source,
    "readme": readme,
    "tried": tried,
    "environments": environments.gallery,
    "commands": commands.index,
    "settings": settings.settings,
}
