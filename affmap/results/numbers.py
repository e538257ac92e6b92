"""Numbers and lists for readers (leaf)."""

import math
from collections.abc import Iterable, Sequence

from affmap.settings.messages import counted as counted

NOTHING = "\N{EN DASH}"
"""Content of an empty cell."""


def number(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a true minus sign, from a million with an exponent; an en dash if there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    form = "+" if sign else ""
    text = f"{value:{form}.{digits}f}"
    if abs(value) >= 1e6:
        mantissa, exponent = f"{value:{form}.1e}".split("e")
        text = f"{mantissa}e{int(exponent)}"
    return text.replace("-", "\N{MINUS SIGN}")


def interval(value: float | None, low: float | None, high: float | None, unit: str) -> str:
    """An effect with its 95 % interval, if there is one, and its unit; an en dash if there is no effect."""
    if value is None:
        return NOTHING
    digits = 4 if unit == "ratio" else 2 if abs(value) < 1000 else 0
    size, *ends = (number(each, digits, sign=True) for each in (value, low, high))
    return f"{size} {unit}" if low is None else f"{size} [{', '.join(ends)}] {unit}"


def estimate(value: float | None, low: float | None, high: float | None) -> str:
    """A value with its 95 % interval; an en dash if there is none."""
    text = number(value)
    return text if text == NOTHING else f"{text} [{number(low)}, {number(high)}]"


def p_value(value: float | None) -> str:
    """A p value to three digits; an en dash if there is none."""
    if value is None:
        return NOTHING
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def span(values: Iterable[int]) -> str:
    """The only value of several, or the smallest and the largest."""
    numbers = [int(value) for value in values]
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low} to {high}"


def listed(words: Sequence[str]) -> str:
    """Words as an enumeration."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else NOTHING


def points(markdown: str) -> list[tuple[str, str]]:
    """The items of a Markdown list whose items begin with a bold title: title and text of each."""
    items = []
    for item in f"\n{markdown}".split("\n- ")[1:]:
        title, _, text = " ".join(item.split()).removeprefix("**").partition("**")
        items.append((title, text.strip()))
    return items
