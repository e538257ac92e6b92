"""The tables of an experiment's report in a terminal: medians of all settings, and claims with their verdicts."""

import sys
from pathlib import Path

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from affmap.results.metrics import METRICS
from affmap.results.numbers import NOTHING, interval, number, p_value
from affmap.results.setting import CONTEXT_SIZE
from affmap.results.statistics import MIN_MEMBERS, Verdict
from affmap.settings.messages import printable

COLORS = {
    Verdict.HOLDS: "green",
    Verdict.DOES_NOT_HOLD: "red",
    Verdict.NOT_DECIDED: "yellow",
    Verdict.NOT_TESTED: "dim",
}


def console() -> Console:
    """A console that shows text as it is, as wide as the terminal, if there is one."""
    return Console(width=None if sys.stdout.isatty() else 200, markup=False, emoji=False, highlight=False)


def show(folder: Path) -> None:
    """Print the tables in a report's folder `tables`: medians, and claims where the experiment has some."""
    out = console()
    out.print(medians(pd.read_csv(folder / "medians.csv")))
    path = folder / "claims.csv"
    if path.is_file():
        table = pd.read_csv(path)
        out.print(claims(table))
        if (few := table["members"].between(1, MIN_MEMBERS - 1)).any():
            out.print(
                f"Tests need at least {MIN_MEMBERS} members; there are at most {table.loc[few, 'members'].max()} here."
            )


def claims(table: pd.DataFrame) -> Table:
    """A row for each part of a claim, from the columns of `affmap.results.scores.as_table`.

    Where a claim has several parts, a row with the verdict of the whole follows them.
    """
    rows = Table("claim", "statement", "effect [95 % interval]", "p", "verdict", box=SIMPLE_HEAD, pad_edge=False)
    table = table.astype(object).where(table.notna(), None)
    for name, parts in table.groupby("claim", sort=False):
        for part in parts.to_dict("records"):
            effect = interval(part["effect"], part["low"], part["high"], part["unit"])
            rows.add_row(
                f"{name} {part['part'] or ''}".strip(),
                printable(part["statement"]),
                effect,
                p_value(part["p"]),
                _verdict(part["part_verdict"]),
            )
        if len(parts) > 1:
            rows.add_row(str(name), "all parts that count", NOTHING, NOTHING, _verdict(parts["verdict"].iloc[0]))
    return rows


def medians(table: pd.DataFrame) -> Table:
    """A row for each metric and setting, a column for each context size, from `affmap.results.scores.medians`."""
    columns = [str(column) for column in table]
    keys = columns[columns.index("metric") + 1 : columns.index(CONTEXT_SIZE.column)]
    sizes = sorted(table[CONTEXT_SIZE.column].unique())
    rows = Table("", *(key.replace("_", " ") for key in keys), box=SIMPLE_HEAD, pad_edge=False)
    for size in sizes:
        rows.add_column(CONTEXT_SIZE.format(size), justify="right")
    table = table.astype(dict.fromkeys(keys, object)).fillna(dict.fromkeys(keys, ""))
    for values, group in table.groupby(["metric", *keys], sort=False):
        metric, *names = map(str, values)
        centers = group.set_index(CONTEXT_SIZE.column)["center"].reindex(sizes)
        label = f"{group['statistic'].iloc[0]} {METRICS[metric].name} ({METRICS[metric].unit})"
        rows.add_row(label, *map(printable, names), *map(number, centers))
    return rows


def _verdict(name: str) -> Text:
    return Text(name, COLORS[Verdict(name)])
