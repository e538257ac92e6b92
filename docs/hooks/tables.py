"""Cells of tables know the heads of their columns, so that on a phone a row can be a list: see `style.css`."""

import re
from html import escape, unescape


def label(html: str) -> str:
    """Give the cells of a page's tables the attribute `data-label`, the head of their column.

    Heads that are names, such as `planner.num_elites`, may break after dots and underscores.
    """
    return re.sub(r"(<table>.*?</thead>)(.+?)</table>", _labelled, html, flags=re.S)


def _labelled(table: re.Match[str]) -> str:
    head, rows = table.groups()
    labels = [_text(cell) for cell in re.findall(r"<th\b[^>]*>(.*?)</th>", head, flags=re.S)]
    head = re.sub(r">[^<]+", _breakable, head)
    return head + re.sub(r"<tr\b.+?</tr>", lambda row: _row(row[0], labels), rows, flags=re.S) + "</table>"


def _breakable(text: re.Match[str]) -> str:
    return re.sub(r"(?<=\w)([._])(?=\w)", r"\1<wbr>", text[0])


def _row(row: str, labels: list[str]) -> str:
    left = iter(labels)
    return re.sub(r"<(?:td|th)\b", lambda cell: f'{cell[0]} data-label="{escape(next(left))}"', row)


def _text(html: str) -> str:
    """What a piece of HTML says."""
    return unescape(re.sub(r"<[^>]+>", "", html)).strip()
