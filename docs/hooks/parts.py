"""Links that stand by themselves become the thing that they lead to, so that it cannot go stale.

On a Git host they stay links. Such a paragraph of a page, `[text](target)` or `[text](target "filter | filter")`,
becomes

| target | becomes |
|---|---|
| `../runs/reference/exp1/tables/claims.md` | the table, or those of its rows that contain all of the filters |
| `../affmap/gaussian.py#nll` | those statements of the function that contain one of the filters |
| `../README.md#glossary` | a section of the README |
| `tried.csv` | the table of what the tests try |
| `../conf/layout` | cards of all environments |
| `../conf` | every group and key of the configuration |
| `../affmap/cli` | a table of all commands |
| `../runs/reference/scores` | the table of scored agents; with a filter, another column of it |
| `../conf/protocol/eight_worlds.yaml` | an evaluation protocol, and its digest |

Paths are those from a page in `docs`. Figures that the code of a page draws are in `plots.py`.
"""

import csv
import inspect
import pkgutil
import re
from collections.abc import Callable
from typing import Any

import commands
import environments
import leaderboard
import settings
from excerpt import excerpt
from links import resolve, translate
from places import REFERENCE, ROOT

from affmap.report.markdown import text_table

LINK = r"(?<=\n\n)\[[^\]\n]+\]\((?P<target>[^)\s]+)(?: \"(?P<filters>[^\"\n]+)\")?\)(?=\n\n|\n*\Z)"


def fill(markdown: str, folder: str) -> str:
    """Fill in the parts of a page.

    Args:
        markdown: The page.
        folder: Its folder in the repository.
    """
    return re.sub(LINK, lambda link: _filled(link, folder), markdown)


def _filled(link: re.Match[str], folder: str) -> str:
    target = resolve(folder, link["target"])
    filters = link["filters"].split(" | ") if link["filters"] else []
    for pattern, part in PARTS.items():
        if found := re.fullmatch(pattern, target):
            return part(*found.groups(), *filters)
    return link[0]


def table(path: str, *texts: str) -> str:
    """A Markdown table of the reference run, or those of its rows that contain all of some texts."""
    head, line, *rows = [row for row in (REFERENCE / path).read_text("utf-8").splitlines() if row.startswith("|")]
    chosen = [row for row in rows if all(text in row for text in texts)]
    if not chosen:
        raise ValueError(f"{path} has no row with {', '.join(texts)}.")
    return "\n".join([head, line, *chosen])


def source(path: str, name: str, *texts: str) -> str:
    """The statements of a function that contain one of some texts, under the name of its file."""
    thing: Any = pkgutil.resolve_name(f"{path.removesuffix('.py').replace('/', '.')}:{name}")
    code = excerpt(inspect.getsource(getattr(thing, "fget", thing)), texts)
    return f"`{path}`, `{name}`:\n\n```python\n{code}\n```"


def readme(anchor: str) -> str:
    """The text below a heading of the README; for pages in the folder `docs` itself."""
    text = (ROOT / "README.md").read_text("utf-8")
    sections = {heading.lower().replace(" ", "-"): body for heading, body in re.findall(SECTION, text, re.M | re.S)}
    if anchor not in sections:
        raise ValueError(f"README.md has no heading #{anchor}.")
    return translate(sections[anchor].strip(), "")


SECTION = r"^## ([^\n]+)\n(.+?)(?=^## |\Z)"


def tried() -> str:
    """Attacks on affmap that the tests try, how often, and the outcome: `docs/tried.csv`, which they write."""
    with (ROOT / "docs/tried.csv").open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return text_table(heads, [(attack, f"{int(times):,}", outcome) for attack, times, outcome in rows])


PARTS: dict[str, Callable[..., str]] = {
    r"runs/reference/(.+/tables/\w+\.md)": table,
    r"(affmap/.+\.py)#(.+)": source,
    r"README\.md#(.+)": readme,
    r"docs/tried\.csv": tried,
    r"conf/layout": environments.gallery,
    r"conf": settings.settings,
    r"affmap/cli": commands.index,
    r"runs/reference/scores": leaderboard.scores,
    r"conf/protocol/(\w+)\.yaml": leaderboard.protocol,
}
"""Path in the repository -> the part of the page that a link to it becomes."""
