"""The authors of affmap and the paper that it reproduces, for readers: of `CITATION.cff`, the only place for both."""

from functools import cache
from typing import Any

from affmap.report.markdown import escape
from affmap.results.numbers import listed
from affmap.settings import base, plain_yaml

FILE = "CITATION.cff"


@cache
def citation() -> dict[str, Any]:
    """The citation of affmap in the Citation File Format; it is beside the folder `conf`."""
    citation: dict[str, Any] = plain_yaml.load((base.folder().parent / FILE).read_text("utf-8"), FILE)
    return citation


def authors() -> str:
    """The authors of affmap."""
    return _names(citation())


def paper() -> str:
    """The paper as an entry of a list of references, in Markdown."""
    paper = citation()["preferred-citation"]
    place = f"doi:{paper['doi']}"
    words = f"{_names(paper)} ({paper['year']}). {paper['title']}. {paper['journal']}, {paper['volume']}."
    return f"{escape(words)} [{escape(place)}](https://doi.org/{paper['doi']})"


def request() -> str:
    """The sentence that asks for a citation."""
    return str(citation()["message"])


def _names(work: dict[str, Any]) -> str:
    people = [each.get("name") or f"{each['given-names']} {each['family-names']}" for each in work["authors"]]
    return listed(people)
