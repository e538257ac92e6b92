"""A page as PDF and HTML: one tree of Markdown, set by two layouts (`layout.typ`, `layout.html`).

Both are self-contained: the PDF has Typst's embedded fonts, the HTML its figures, style (`layout.css`) and
scripts, and neither needs a network.
"""

import base64
import hashlib
import json
import os
import re
import struct
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import typst
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode
from markupsafe import Markup, escape

from affmap.report import build
from affmap.report.drawing.files import DPI
from affmap.results.statistics import Verdict
from affmap.store.files import named_errors

_HERE = Path(__file__).parent

SCRIPTS = ("tables", "player/parts", "player/moment", "player/player", "explorer/explorer")
"""The page's scripts; each needs only those before it."""

SHORT = 12
"""Cells of at most so many characters are not wrapped."""

Node = dict[str, Any]
"""A part of a page: its `kind`, its own `parts`, and further keys that a layout needs."""

Widgets = Mapping[str, Mapping[str, Any]]
"""Name of a widget -> variables of its template, `<name>/<name>.html`."""


def write(output: Path, text: str, notice: str | None, widgets: Widgets) -> None:
    """Write `report.md`, `report.pdf` and `report.html`.

    Args:
        output: the report's folder, where the paths of figures in `text` begin.
        text: the page in Markdown, see `parse`.
        notice: a warning that heads every page of the PDF, or None.
        widgets: inserted into the HTML in place of comments.
    """
    printed, shown = pdf(output, text, notice), html(output, text, widgets)
    build.write_text(output / "report.md", text)
    with named_errors(output / "report.pdf"):
        (output / "report.pdf").write_bytes(printed)
    build.write_text(output / "report.html", shown)


def parse(text: str) -> list[Node]:
    """Parse a page into its parts.

    Beyond CommonMark with tables, an image with a paragraph in italics after it is a figure with its caption, a
    paragraph in bold is an alert, and a comment such as `<!-- player -->` is the place of a widget. All other HTML is
    text.
    """
    root = SyntaxTreeNode(MarkdownIt("commonmark", {"html": True}).enable("table").parse(text))
    parts: list[Node] = []
    for part in _nodes(root.children):
        if parts and _only(part, "em") and _only(parts[-1], "image"):
            image, caption = parts.pop()["parts"][0], part["parts"][0]
            part = {"kind": "figure", "text": "", "source": image["source"], "parts": caption["parts"]}
        parts.append(part)
    anchors: Counter[str] = Counter()
    for part in parts:
        if part["kind"] == "heading":
            anchor = re.sub(r"\W+", "-", f"part {plain(part['parts']).lower()}").strip("-")
            anchors[anchor] += 1
            part["anchor"] = anchor if anchors[anchor] == 1 else f"{anchor}-{anchors[anchor]}"
    return parts


def _nodes(children: Iterable[SyntaxTreeNode]) -> list[Node]:
    nodes: list[Node] = []
    for child in children:
        if child.type == "inline" or (child.type == "paragraph" and child.hidden):  # of a tight list
            nodes += _nodes(child.children)
        elif child.type != "text" or child.content:
            nodes.append(_node(child))
    return nodes


def _node(node: SyntaxTreeNode) -> Node:
    own: Node = {"kind": node.type, "text": node.content, "parts": _nodes(node.children)}
    if node.type == "heading":
        own["level"] = int(node.tag[1:])
    elif node.type == "link":
        own["target"] = str(node.attrs["href"])
    elif node.type == "image":
        own["source"] = str(node.attrs["src"])
    elif node.type == "table":
        head, *rows = ([cell["parts"] for cell in row["parts"]] for group in own["parts"] for row in group["parts"])
        own |= {"head": head, "rows": rows}
    elif node.type in ("html_block", "html_inline"):
        comment = re.fullmatch(r"<!-- (\w+) -->\s*", node.content)
        own |= {"kind": "widget", "name": comment[1]} if comment else {"kind": "text"}
    elif node.type == "paragraph" and _only(own, "strong"):
        own |= {"kind": "alert", "parts": own["parts"][0]["parts"]}
    return own


def _only(node: Node, kind: str) -> bool:
    """Whether a node is a paragraph with a single part, of the given kind."""
    return node["kind"] == "paragraph" and [part["kind"] for part in node["parts"]] == [kind]


def plain(parts: Iterable[Node]) -> str:
    """The text of some parts without markup."""
    return "".join(part["text"] or plain(part["parts"]) for part in parts)


def pdf(output: Path, text: str, notice: str | None, **how: Any) -> bytes:
    """Set a page with Typst; `how` is passed on (`format`, `ppi`)."""
    parts = parse(text)
    paths = {part["source"]: (output / part["source"]).resolve() for part in parts if part["kind"] == "figure"}
    root = Path(os.path.commonpath([output.resolve(), *paths.values()]))  # a report may show figures of other ones
    figures = {
        source: {"path": f"/{path.with_suffix('.pdf').relative_to(root).as_posix()}", "width": figure_width(path)}
        for source, path in paths.items()
    }
    data = {"title": _title(parts), "notice": notice or "", "parts": parts, "figures": figures}
    compiler = typst.Compiler(
        (_HERE / "layout.typ").read_bytes(),
        root=root,
        ignore_system_fonts=True,
        sys_inputs={"data": json.dumps(data)},
    )
    pages = compiler.compile(**{"format": "pdf", **how})
    first = pages[0] if isinstance(pages, list) else pages  # a list is for formats with a file per page
    assert isinstance(first, bytes)  # None is for a file that Typst writes itself
    return first


def html(output: Path, text: str, widgets: Widgets) -> str:
    """Set a page as HTML that needs no other file."""
    parts, templates = parse(text), _templates()
    start = next((place for place, part in enumerate(parts) if part.get("level") == 2), len(parts))
    frame: Mapping[str, Any] = {
        "title": _title(parts),
        "head": _html(output, parts[:start], widgets),
        "contents": [(part["anchor"], plain(part["parts"])) for part in parts if part.get("level") == 2],
        "body": _html(output, parts[start:], widgets),
        "style": Markup((_HERE / "layout.css").read_text("utf-8")),
        "script": Markup(script()),
        "policy": policy(script()),
    }
    return templates.get_template("layout.html").render(frame)


@cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


_TAGS = {
    "paragraph": "p",
    "strong": "strong",
    "em": "em",
    "code_inline": "code",
    "fence": "pre",
    "code_block": "pre",
    "bullet_list": "ul",
    "ordered_list": "ol",
    "list_item": "li",
    "blockquote": "blockquote",
}


def _html(output: Path, parts: Iterable[Node], widgets: Widgets) -> Markup:
    """Set parts as HTML, one after the other."""

    def tag(name: str, part: Node, attributes: str = "", **values: str) -> Markup:
        inner = part["text"] if part["kind"] != "heading" and part["text"] else _html(output, part["parts"], widgets)
        return Markup(f"<{name}{attributes}>{{inner}}</{name}>").format(inner=inner, **values)

    def cell(name: str, parts: list[Node]) -> Markup:
        words = plain(parts)
        short = ["short"] if len(words) <= SHORT else []
        classes = [words.replace(" ", "-")] if words in list(Verdict) else short
        return tag(name, {"kind": "cell", "text": "", "parts": parts}, f' class="{classes[0]}"' if classes else "")

    def one(part: Node) -> Markup:
        match part["kind"]:
            case "text":
                return escape(part["text"])
            case "softbreak":
                return Markup("\n")
            case "hardbreak" | "hr" as kind:
                return Markup("<br>\n" if kind == "hardbreak" else "<hr>\n")
            case "heading":
                return tag(f"h{part['level']}", part, ' id="{anchor}"', anchor=part["anchor"]) + "\n"
            case "alert":
                return tag("p", part, ' class="alert"') + "\n"
            case "link":
                return tag("a", part, ' href="{target}"', target=part["target"])
            case "figure":
                png = output / part["source"]
                image = Markup('<img alt="{}" style="width: {}rem" src="{}">').format(
                    part["source"], 8.5 * figure_width(png), _embedded(png)
                )
                return Markup("<figure>\n{}\n{}\n</figure>\n").format(image, tag("figcaption", part))
            case "table":
                head = Markup().join(cell("th", each) for each in part["head"])
                rows = Markup("\n").join(
                    Markup("<tr>{}</tr>").format(Markup().join(cell("td", each) for each in row))
                    for row in part["rows"]
                )
                return Markup(
                    '<div class="scroll"><table>\n<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody>\n</table></div>\n'
                ).format(head, rows)
            case "widget":
                name = part["name"]
                widget = widgets.get(name)
                return Markup(_templates().get_template(f"{name}/{name}.html").render(widget) if widget else "")
            case "image":
                return Markup("<em>{}</em>").format(part["text"])  # only figures stand by themselves
            case kind:
                return tag(_TAGS[kind], part) + ("" if kind in ("strong", "em", "code_inline") else "\n")

    return Markup().join(map(one, parts))


def _title(parts: Iterable[Node]) -> str:
    return next((plain(part["parts"]) for part in parts if part["kind"] == "heading"), "")


def script() -> str:
    """The page's own script."""
    files = [(_HERE / f"{name}.js").read_text("utf-8") for name in SCRIPTS]
    return "\n".join(['"use strict";', *files])


def policy(text: str) -> str:
    """Content security policy of a page: it may run this script and no other, and fetch nothing."""
    digest = base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
    return f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data:"


def _embedded(png: Path) -> str:
    """Figure as a data URL, as SVG if there is one."""
    svg = png.with_suffix(".svg")
    kind, file = ("svg+xml", svg) if svg.is_file() else ("png", png)
    return f"data:image/{kind};base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"


def figure_width(png: Path) -> float:
    """Width of a figure in inches, read from the header of its PNG."""
    (pixels,) = struct.unpack(">I", png.read_bytes()[16:20])
    return float(pixels / DPI)
