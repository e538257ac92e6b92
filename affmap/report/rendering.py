"""A document's blocks -> PDF and HTML: one content, two layouts (`report.typ`, `report.html.jinja`).

Both are whole in themselves: the PDF has Typst's embedded fonts, the page its figures; neither asks a network.
"""

import base64
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import typst

from affmap.report.figures import DPI

_HERE = Path(__file__).parent


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
    widths = {
        block["name"]: figure_width(output / "figures" / f"{block['name']}.png")
        for block in data["blocks"]
        if block["kind"] == "figure"
    }
    compiler = typst.Compiler(
        (_HERE / "report.typ").read_bytes(),
        root=output,
        ignore_system_fonts=True,
        sys_inputs={"data": json.dumps({**data, "widths": widths})},
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
    template = environment.from_string((_HERE / "report.html.jinja").read_text("utf-8"))

    def embedded(name: str) -> str:
        return base64.b64encode((output / "figures" / f"{name}.png").read_bytes()).decode("ascii")

    return template.render(**data, embedded=embedded)


def figure_width(png: Path) -> float:
    """Inches; from the head of the file."""
    (pixels,) = struct.unpack(">I", png.read_bytes()[16:20])
    return float(pixels / DPI)
