"""Tables for a terminal."""

from collections.abc import Sequence
from itertools import groupby

import pandas as pd
from measure import Result
from rich.table import Table


def table(results: Sequence[Result]) -> Table:
    """What was measured: under each work, in bold, who did it."""
    shown = Table("work and contender", "unit")
    for heading in ("time of a unit", "ratio", "lowest", "highest", "useful work / matrix product"):
        shown.add_column(heading, justify="right")
    for work, rows in groupby(results, lambda result: result.work):
        shown.add_row(f"[bold]{work}")
        for row in rows:
            share = "" if row.share_of_limit is None else f"{row.share_of_limit:.2g}"
            ratios = (f"{ratio:.3g}" for ratio in (row.ratio, row.ratio_low, row.ratio_high))
            shown.add_row(f"  {row.contender}", row.unit, duration(row.seconds), *ratios, share)
        shown.add_section()
    return shown


def plain_table(content: pd.DataFrame) -> Table:
    """Any table."""
    shown = Table(*(str(column) for column in content.columns))
    for values in content.itertuples(index=False):
        cells = (f"{value:.3g}" if isinstance(value, float) else str(value) for value in values)
        shown.add_row(*("" if cell == "nan" else cell for cell in cells))
    return shown


def duration(seconds: float) -> str:
    """Seconds in the unit that suits them."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"
