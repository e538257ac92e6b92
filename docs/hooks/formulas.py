"""Formulas: LaTeX becomes MathML, which browsers draw by themselves, in the font STIX Two Math.

Blocks of ```` ```math ```` stand by themselves, `` $`...`$ `` in a sentence.
"""

import re
from html import unescape
from importlib.util import find_spec
from pathlib import Path

from latex2mathml.converter import convert

FONT = "STIXTwoMath-Regular.ttf"
"""SIL Open Font License 1.1. Brackets stretch only in a font with a table of mathematics."""


def font() -> Path:
    """The file of the font, which the package ziamath brings along."""
    spec = find_spec("ziamath")
    assert spec and spec.origin
    return Path(spec.origin).with_name("fonts") / FONT


def fill_blocks(markdown: str) -> str:
    """Turn the formulas that stand by themselves into MathML."""
    return re.sub(r"^```math\n(.+?)^```$", _block, markdown, flags=re.M | re.S)


def fill_sentences(html: str) -> str:
    """Turn the formulas in sentences into MathML."""
    return re.sub(r"\$<code>(.*?)</code>\$", lambda found: convert(unescape(found[1])), html)


def _block(block: re.Match[str]) -> str:
    return f'<div class="formula">{convert(" ".join(block[1].split()), display="block")}</div>'
