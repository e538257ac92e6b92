"""Links between files of the repository become links between pages of the site.

So every page can be read on a Git host, too, where its links lead to files.
"""

import posixpath
import re

PLACES = {
    r"docs/(.+)": r"\1",
    r"notebooks/(\w+)\.ipynb": r"notebooks/\1.md",
    r"runs/reference/(\w+)/report\.md": r"experiments/\1.md",
    r"runs/reference/paper/tables/claims\.md": r"results.md",
    r"runs/reference/(.+)": r"reference/\1",
}
"""Files of the repository -> where the site has the same."""


def translate(markdown: str, folder: str, page: str = "") -> str:
    """Lead the links of a text to places of the site.

    Args:
        markdown: A text.
        folder: Its folder in the repository, which its links start from.
        page: The folder of the site's page that shows it.
    """

    def link(found: re.Match[str]) -> str:
        target, part = resolve(folder, found[1]), found[2] or ""
        if target.endswith(".py") and part:  # a name of the API
            return f"][{dotted(target, part.removeprefix('#'))}]"
        return f"]({posixpath.relpath(_place(target), page or '.')}{part})"

    return re.sub(r"\]\(([^()\s:#]+)(#[^()\s]+)?\)", link, markdown)


def resolve(folder: str, target: str) -> str:
    """The path in the repository that a link in a folder leads to."""
    return posixpath.normpath(posixpath.join(folder, target))


def dotted(path: str, part: str) -> str:
    """The full name of a part of a module: `affmap/gaussian.py`, `kl` -> `affmap.gaussian.kl`."""
    return f"{path.removesuffix('.py').replace('/', '.')}.{part}"


def _place(path: str) -> str:
    for pattern, place in PLACES.items():
        if found := re.fullmatch(pattern, path):
            return found.expand(place)
    return path
