"""Figures that the code of a page draws, in place of its lines `*Figure: description.*`."""

import base64
import re
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import matplotlib
import matplotlib.pyplot as plt

FIGURE = r"^\*Figure: [^\n]+\.\*$"


def fill(markdown: str) -> str:
    """A page with the figures that its code draws; the code of other pages is not run."""
    return "".join(_parts(markdown)) if re.search(FIGURE, markdown, flags=re.M) else markdown


def _parts(markdown: str) -> Iterator[str]:
    matplotlib.use("agg")
    namespace: dict[str, Any] = {}
    for part in re.split(rf"(^```python\n.+?^```$|{FIGURE})", markdown, flags=re.M | re.S):
        if part.startswith("```python"):
            exec(part.removeprefix("```python").removesuffix("```"), namespace)
        elif re.fullmatch(FIGURE, part):
            part = _figure(part.removeprefix("*Figure: ").removesuffix(".*"))
        yield part


def _figure(description: str) -> str:
    """The figure that was drawn last, in its own size on a screen."""
    if not plt.get_fignums():
        raise ValueError(f"no code has drawn the figure: {description}.")
    png, width = BytesIO(), round(96 * plt.gcf().get_figwidth())
    plt.savefig(png, format="png", dpi=192)
    plt.close("all")
    source = base64.b64encode(png.getvalue()).decode()
    return f'<img alt="{description}" width="{width}" src="data:image/png;base64,{source}">'
