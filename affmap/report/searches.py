"""What a search has found: its trials as a table, and figures of its history and of what each value does.

Knows the sweeper's table (a row for each trial: trial, status, result, batch_seconds, then a column for each key).
"""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from affmap.files import sha256
from affmap.report import figures, sealed
from affmap.report.metrics import METRICS
from affmap.report.tables import write_csv
from affmap.report.text import number
from affmap.settings import ConfigError

FIXED = ("trial", "status", "result", "batch_seconds")
"""Columns that are no keys."""

TRIALS = "trials"
"""What tells the provenance of a search from that of a report: the digest of the table of trials."""

SHOWN = 10
"""Rows of the table of the best."""


def read(path: Path) -> pd.DataFrame:
    """The sweeper's table of trials.

    Raises:
        ConfigError: it is not there, or something else.
    """
    try:
        table = pd.read_csv(path).astype({"trial": int, "result": float})
    except (OSError, ValueError, KeyError):
        raise ConfigError(f"{path} holds no trials; run `affmap` with the same arguments first.") from None
    if list(table.columns[: len(FIXED)]) != list(FIXED) or not (table["status"] == "ok").any():
        raise ConfigError(f"{path} holds no complete trials; run `affmap` with the same arguments first.")
    return table


def write(
    output: Path,
    path: Path,
    objective: str,
    *,
    in_use: Mapping[str, Any],
    log_keys: Collection[str],
    origin: Mapping[str, Any],
    title: str,
    command: str,
    notice: str | None,
) -> Path:
    """Write `tables/trials.csv` and `tables/search.md`, `figures/search.png` and `.pdf`, and `provenance.json`.

    Args:
        output: folder of the report; made where it is missing.
        path: the sweeper's table.
        objective: the metric that the search is for; `success` is the better the larger, others the smaller.
        in_use: values of the configuration by dotted key, to be found among the trials.
        log_keys: keys that were searched on a logarithmic scale.
        origin: what else to say of where the trials come from.
        title: heads the page.
        command: what a reader types to get this search.
        notice: a warning to the reader, or None.

    Returns:
        The path of the Markdown.
    """
    table = read(path)
    keys = [key for key in table.columns if key not in FIXED]
    mask = pd.Series(bool(set(keys) <= in_use.keys()), table.index)
    for key in keys:
        mask &= table[key] == in_use.get(key)
    used = int(table[mask]["trial"].iloc[0]) if mask.any() else None
    folder = output / "tables"
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / "trials.csv", table)
    figures.draw_search(table, objective, used, log_keys, output / "figures" / "search", notice)
    text = markdown(table, objective, used, keys)
    heading = f"**{notice}**\n\n" if notice else ""
    page = folder / "search.md"
    page.write_text(f"# {title}\n\n{heading}`{command}`\n\n{text}", "utf-8", newline="\n")
    record = {"title": title, "notice": notice, "report": command, "objective": objective, **origin}
    sealed.seal(output, {**record, TRIALS: sha256(path)})
    return page


def is_written(output: Path, path: Path) -> bool:
    """Whether a folder has the report of the trials in a table."""
    return path.is_file() and sealed.read(output).get(TRIALS) == sha256(path)


def ranked(table: pd.DataFrame, objective: str) -> pd.DataFrame:
    """The complete trials, the best first; of equal ones the earlier."""
    complete = table[table["status"] == "ok"]
    return complete.sort_values("result", ascending=objective != "success", kind="stable", ignore_index=True)


def markdown(table: pd.DataFrame, objective: str, used: int | None, keys: list[str]) -> str:
    """The best trials and that of the values in use as a Markdown table, headed by a sentence on them."""
    metric = METRICS[objective]
    order = ranked(table, objective)
    results, numbers = order["result"].tolist(), order["trial"].tolist()
    failed = len(table) - len(order)
    lead = [f"{len(table)} trials, {failed} of which failed." if failed else f"{len(table)} trials."]
    lead.append(f"The best, trial {numbers[0]}, has {_told(results[0], objective)}.")
    rows = list(range(min(SHOWN, len(order))))
    if used in numbers:
        place = numbers.index(used)
        near = abs(results[place] - results[0]) <= (metric.margin or 0.0)
        lead.append(
            f"The values in use, trial {used}, come in place {place + 1} with {_told(results[place], objective)}, "
            f"{'within' if near else 'outside'} the margin of {metric.margin:g} {metric.unit} that would not matter."
        )
        rows = sorted({*rows, place})
    lead.append("The best of many trials owes a part of its lead to chance.")
    heads = ["place", "trial", f"{metric.name} ({metric.unit})", *keys]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for row in rows:
        trial = f"{numbers[row]} (in use)" if numbers[row] == used else str(numbers[row])
        cells = [str(row + 1), trial, number(results[row], 3), *(_shown(order[key].iloc[row]) for key in keys)]
        lines.append(f"| {' | '.join(cells)} |")
    return " ".join(lead) + "\n\n" + "\n".join(lines) + "\n"


def _told(result: float, objective: str) -> str:
    metric = METRICS[objective]
    return f"a {metric.name} of {number(result, 3)} {metric.unit}"


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
