"""The report of a search: its trials as a table, and figures of its history and of the effect of each value.

Knows the sweeper's table (one row per trial: trial, status, result, batch_seconds, then a column for each key).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd

from affmap.report import build
from affmap.report.markdown import escape_name
from affmap.report.markdown import table as markdown_table
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.tables import write_csv
from affmap.settings import ConfigError

FIXED = ("trial", "status", "result", "batch_seconds")
"""Columns that are not keys."""

SHOWN = 10
"""Rows of the table of the best trials."""


def read(text: str) -> pd.DataFrame:
    """Read the sweeper's table of trials.

    Raises:
        ConfigError: no trial has a result.
    """
    table = pd.read_csv(StringIO(text)).astype({"trial": int, "result": float})
    if not (table["status"] == "ok").any():
        raise ConfigError("the search holds no trials with a result; run `affmap` with the same arguments first.")
    return table


@dataclass(frozen=True)
class SearchReport:
    """The history of a search, each value beside the result, and the best trials.

    It has `tables/trials.csv` and `tables/search.md`, and `figures/search.png` and `.pdf`.
    """

    output: Path
    trials: str
    """The sweeper's table, as CSV."""
    objective: str
    """The objective of the search; `success` is maximised, other metrics are minimised."""
    in_use: Mapping[str, Any]
    """Values of the configuration by dotted key, marked among the trials."""
    log_keys: Collection[str]
    """Keys that were searched on a logarithmic scale."""
    origin: Mapping[str, Any]
    """Further entries of the manifest, on the origin of the trials."""
    title: str
    command: str
    """Command line of this search."""
    notice: str | None
    """Warning to the reader, or None."""

    @property
    def record(self) -> dict[str, Any]:
        """Objective and origin of the trials, see `build.Report`."""
        head = {"title": self.title, "notice": self.notice, "report": self.command, "objective": self.objective}
        return {**head, **self.origin, "trials": sha256(self.trials.encode()).hexdigest()}

    @property
    def page(self) -> Path:
        """The best trials in Markdown."""
        return self.output / "tables" / "search.md"

    def draw(self, folder: Path) -> None:
        """Write tables and figure, see `build.Report`.

        Raises:
            ConfigError: there are no complete trials.
        """
        from affmap.experiments.search.figures import draw_search  # Matplotlib takes a second to import

        table = read(self.trials)
        keys = [key for key in table.columns if key not in FIXED]
        mask = pd.Series(bool(set(keys) <= self.in_use.keys()), table.index)
        for key in keys:
            mask &= table[key] == self.in_use.get(key)
        used = int(table[mask]["trial"].iloc[0]) if mask.any() else None
        write_csv(folder / "tables" / "trials.csv", table)
        draw_search(table, self.objective, used, self.log_keys, folder / "figures" / "search", self.notice)
        text = markdown(table, self.objective, used, keys)
        build.markdown_page(folder / "tables" / self.page.name, self.title, self.notice, self.command, text)


def ranked(table: pd.DataFrame, objective: str) -> pd.DataFrame:
    """Complete trials, the best first, and earlier ones before equal later ones."""
    complete = table[table["status"] == "ok"]
    return complete.sort_values("result", ascending=objective != "success", kind="stable", ignore_index=True)


def markdown(table: pd.DataFrame, objective: str, used: int | None, keys: list[str]) -> str:
    """Markdown table of the best trials and that of the values in use, after a summary."""
    metric = METRICS[objective]
    order = ranked(table, objective)
    results, numbers = order["result"].tolist(), order["trial"].tolist()
    failed = len(table) - len(order)
    lead = [f"{len(table)} trials, {failed} of which failed." if failed else f"{len(table)} trials."]
    lead.append(f"The best, trial {numbers[0]}, has {_format_result(results[0], objective)}.")
    rows = list(range(min(SHOWN, len(order))))
    if used in numbers:
        place = numbers.index(used)
        result = _format_result(results[place], objective)
        near = abs(results[place] - results[0]) <= (metric.margin or 0.0)
        lead.append(
            f"The values in use, trial {used}, come in place {place + 1} with {result}, "
            f"{'within' if near else 'outside'} the margin of {metric.margin:g} {metric.unit} that would not matter."
        )
        rows = sorted({*rows, place})
    lead.append("The best of many trials owes a part of its lead to chance.")
    heads = ["place", "trial", f"{metric.name} ({metric.unit})", *map(escape_name, keys)]
    cells = []
    for row in rows:
        trial = f"{numbers[row]} (in use)" if numbers[row] == used else str(numbers[row])
        cells.append(
            [str(row + 1), trial, number(results[row], 3), *(_format_value(order[key].iloc[row]) for key in keys)]
        )
    return " ".join(lead) + "\n\n" + markdown_table(heads, cells)


def _format_result(result: float, objective: str) -> str:
    metric = METRICS[objective]
    return f"a {metric.name} of {number(result, 3)} {metric.unit}"


def _format_value(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else escape_name(str(value))
