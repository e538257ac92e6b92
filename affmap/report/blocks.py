"""What a document is made of: a list of blocks, plain data that both layouts know how to set (leaf).

`layout.typ` sets them as a PDF, `layout.html` as a page; each has a rule for every kind.
"""

from collections.abc import Mapping, Sequence
from typing import Any

Block = dict[str, Any]


def heading(text: str, level: int = 1) -> Block:
    """A numbered level of the outline, 1 or 2."""
    return {"kind": "heading", "text": text, "level": level}


def paragraph(text: str) -> Block:
    """A paragraph."""
    return {"kind": "paragraph", "text": text}


def alert(text: str) -> Block:
    """What a reader must not miss."""
    return {"kind": "alert", "text": text}


def bullets(items: Sequence[str]) -> Block:
    """A list of sentences."""
    return {"kind": "bullets", "items": list(items)}


def points(items: Sequence[tuple[str, str]]) -> Block:
    """A list of texts, each with a title."""
    return {"kind": "points", "items": [list(item) for item in items]}


def table(header: Sequence[str], rows: Sequence[Sequence[str]], wide: int | None = None) -> Block:
    """Rows of texts; the column number `wide` takes the room that the others leave."""
    return {"kind": "table", "header": list(header), "rows": [list(row) for row in rows], "wide": wide}


def claims(rows: Sequence[Mapping[str, str]]) -> Block:
    """The table of claims: `name`, `statement`, `detail`, `effect`, `p`, `opposite` and `verdict` of each."""
    return {"kind": "claims", "rows": [dict(row) for row in rows]}


def figure(name: str, caption: str) -> Block:
    """A drawn figure: its place in the folder `figures`, without an ending."""
    return {"kind": "figure", "name": name, "caption": caption}


def player(data: Mapping[str, Any], caption: str, legend: Sequence[tuple[str, str, str]]) -> Block:
    """Runs to be played, in the page only; `players.py` says what the data are. Legend: shape, colour and words."""
    return {"kind": "player", "data": dict(data), "caption": caption, "legend": [list(entry) for entry in legend]}


def explorer(data: Mapping[str, Any], caption: str) -> Block:
    """Affordance maps to be pointed at, in the page only; `explorers.py` says what the data are."""
    return {"kind": "explorer", "data": dict(data), "caption": caption}
