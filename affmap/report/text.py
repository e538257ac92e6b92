"""Numbers as readers see them (leaf)."""

import math

NOTHING = "\N{EN DASH}"
"""What a cell shows that has nothing to show."""


def number(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a true minus sign; an en dash where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:{'+' if sign else ''}.{digits}f}".replace("-", "\N{MINUS SIGN}")


def p_value(value: float | None) -> str:
    """A p value to three digits; an en dash where there is none."""
    if value is None:
        return NOTHING
    return "< 0.001" if value < 0.001 else f"{value:.3f}"
