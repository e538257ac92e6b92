"""Notebooks as pages: their cells, and what these have put out."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

from links import translate
from places import ROOT


def files() -> list[Path]:
    """All notebooks."""
    return sorted((ROOT / "notebooks").glob("*.ipynb"))


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each notebook."""
    for path in files():
        yield f"notebooks/{path.stem}.md", "\n\n".join(_cells(path))


def _cells(path: Path) -> Iterator[str]:
    """The cells of a notebook, and what they have put out, as Markdown."""
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        text = "".join(cell["source"])
        is_text = cell["cell_type"] == "markdown"
        yield translate(text, "notebooks", "notebooks") if is_text else f"```python\n{text}\n```"
        for output in cell.get("outputs", []):
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                picture = "".join(data["image/png"]).strip()
                yield f'<img alt="what the cell draws" src="data:image/png;base64,{picture}">'
            elif "text/html" in data:
                html = re.sub(r"<style.*?</style>", "", "".join(data["text/html"]), flags=re.S)
                yield re.sub(r"<table\b[^>]*>", "<table>", html)  # in the style of the site
            else:
                yield f"```text\n{''.join(data['text/plain']).rstrip()}\n```"
