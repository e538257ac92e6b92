"""The site is made here: MkDocs calls the `on_` functions.

Beside the pages of `docs` it has pages that are made from the project itself when it is built: notebooks, published
reports, environments, commands, and the reference of the API. Links that stand by themselves are filled in, see
`parts.py`; all other links between files become links between pages, see `links.py`.
"""

import posixpath
from collections.abc import Iterator
from typing import Any

import api
import commands
import environments
import experiments
import formulas
import links
import notebook
import parts
import plots
import tables
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from places import REFERENCE, ROOT

MADE = {
    "Layouts": environments.pages,
    "Experiments": experiments.pages,
    "Each command": commands.pages,
}
"""Entry of the navigation that is empty in `mkdocs.yml` -> the pages that it holds."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill the pages that are made into the navigation."""
    for entry in [*_entries(config.nav)]:
        for title, content in entry.items():
            if content == [] and title in MADE:
                entry[title] = [place for place, _ in MADE[title]()]
            elif content == []:
                entry[title] = [
                    {heading: [{api.short(name): api.place(name)} for name in names]}
                    for heading, names in api.groups().items()
                ]
    return config


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add what does not lie in `docs`."""
    for make in (*MADE.values(), notebook.pages, api.pages):
        for place, text in make():
            files.append(File.generated(config, place, content=text))
    for place, picture in environments.pictures():
        files.append(File.generated(config, place, content=picture))
    for path in experiments.files():
        place = f"reference/{path.relative_to(REFERENCE).as_posix()}"
        files.append(File.generated(config, place, abs_src_path=str(path)))
    for path in notebook.files():
        files.append(File.generated(config, f"notebooks/{path.name}", abs_src_path=str(path)))
    files.append(File.generated(config, "CITATION.cff", abs_src_path=str(ROOT / "CITATION.cff")))
    files.append(File.generated(config, f"fonts/{formulas.FONT}", abs_src_path=str(formulas.font())))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in the figures and parts of a page, and formulas that stand by themselves; lead links to pages."""
    if page.file.src_uri == "api.md":
        return api.index(markdown)
    place = posixpath.dirname(page.file.src_uri)
    folder = posixpath.join("docs", place)
    filled = parts.fill(plots.fill(markdown), folder)
    return formulas.fill_blocks(links.translate(filled, folder, place))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in the formulas in sentences, and label the cells of tables."""
    return tables.label(formulas.fill_sentences(html))


def _entries(nav: Any) -> Iterator[dict[str, Any]]:
    """Every entry of the navigation that has a title, at any depth."""
    for entry in nav or []:
        if isinstance(entry, dict):
            yield entry
            for content in entry.values():
                yield from _entries(content) if isinstance(content, list) else ()
