"""A document's blocks as PDF and HTML: one content, two layouts (`layout.typ`, `layout.html`).

Both are whole in themselves: the PDF has Typst's embedded fonts, the page its figures, style (`layout.css`) and
scripts, and neither asks a network.
"""

import base64
import hashlib
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import typst
from markupsafe import Markup

from affmap.report.drawing.files import DPI

_HERE = Path(__file__).parent

SCRIPTS = ("tables", "player/parts", "player/moment", "player/player", "explorer/explorer")
"""The page's scripts, in the order in which they need each other."""


def write(output: Path, data: Mapping[str, Any]) -> None:
    """Write `report.pdf` and `report.html` into `output`, whose folder `figures` holds the drawn ones.

    Args:
        output: the report's folder.
        data: `title`, `notice` (empty for none) and `blocks`.
    """
    (output / "report.pdf").write_bytes(pdf(output, data))
    (output / "report.html").write_text(html(output, data), "utf-8", newline="\n")


def pdf(output: Path, data: Mapping[str, Any], **how: Any) -> bytes:
    """Set a document with Typst; `how` is passed on (`format`, `ppi`)."""
    printed = [{key: value for key, value in block.items() if key != "data"} for block in data["blocks"]]
    compiler = typst.Compiler(
        (_HERE / "layout.typ").read_bytes(),
        root=output,
        ignore_system_fonts=True,
        sys_inputs={"data": json.dumps({**data, "blocks": printed, "widths": _widths(output, data)})},
    )
    pages = compiler.compile(**{"format": "pdf", **how})
    first = pages[0] if isinstance(pages, list) else pages  # a list is for formats with a file per page
    assert isinstance(first, bytes)  # None is for a file that Typst writes itself
    return first


def html(output: Path, data: Mapping[str, Any]) -> str:
    """Set a document as a page that needs no other file."""
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    template = environment.from_string((_HERE / "layout.html").read_text("utf-8"))

    style = (_HERE / "layout.css").read_text("utf-8")
    return template.render(
        **data,
        widths=_widths(output, data),
        embedded=lambda name: _embedded(output / "figures" / name),
        style=Markup(style),
        script=Markup(script()),
        policy=policy(script()),
    )


def _widths(output: Path, data: Mapping[str, Any]) -> dict[str, float]:
    """Name of a figure -> its width, inches."""
    names = [block["name"] for block in data["blocks"] if block["kind"] == "figure"]
    return {name: figure_width(output / "figures" / f"{name}.png") for name in names}


def script() -> str:
    """The page's own script."""
    files = [(_HERE / f"{name}.js").read_text("utf-8") for name in SCRIPTS]
    return "\n".join(['"use strict";', *files])


def policy(text: str) -> str:
    """What a page may do: run this script, which is its own, and no other; fetch nothing."""
    digest = base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
    return f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data:"


def _embedded(path: Path) -> str:
    """A figure as an address that holds it: as SVG where there is one."""
    svg = path.with_name(f"{path.name}.svg")
    kind, file = ("svg+xml", svg) if svg.is_file() else ("png", path.with_name(f"{path.name}.png"))
    return f"data:image/{kind};base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"


def figure_width(png: Path) -> float:
    """Inches; from the head of the file."""
    (pixels,) = struct.unpack(">I", png.read_bytes()[16:20])
    return float(pixels / DPI)
