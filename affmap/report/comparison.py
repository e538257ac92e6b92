"""One factor at a time: the same models, starts and goals under two or more values of one column of the runs.

Knows tables of runs only. Two values count as the *same* when the 95 % interval of their difference lies within a
margin set beforehand, as *different* when it leaves out zero and reaches beyond the margin; else nothing is decided.
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from affmap.report import figures, statistics
from affmap.report.tables import PLANNERS, Job, read_runs, score_matrix, write_csv, write_runs
from affmap.report.text import NOTHING, number

MARGINS = {"prediction_error": ("nats", 0.5), "mean_distance": ("u", 0.05), "reached": ("share", 0.05)}
"""Metric -> unit, and the difference that would not matter: small against the differences between context sizes."""


def write(output: Path, jobs: Sequence[Job], factor: str, notice: str | None) -> Path:
    """Write `tables/runs.csv`, `tables/<factor>.csv` and `.md`, and `figures/<factor>.png` and `.pdf`, into `output`.

    `notice` is a warning to the reader that heads Markdown and figure, or None. Returns the path of the Markdown.
    """
    runs = pd.concat([read_runs(job) for job in jobs], ignore_index=True)
    table = compare(runs, factor)
    folder = output / "tables"
    folder.mkdir(parents=True, exist_ok=True)
    write_runs(folder, runs)
    write_csv(folder / f"{factor}.csv", table)
    figures.draw_lookups(table, runs, output / "figures", notice)
    path = folder / f"{factor}.md"
    heading = f"**{notice}**\n\n" if notice else ""
    path.write_text(heading + markdown(table, factor), "utf-8", newline="\n")
    return path


def compare(runs: pd.DataFrame, factor: str) -> pd.DataFrame:
    """Compare every value of `factor` with the first one, for each planner, context size and metric.

    `factor` is a column of numbers in `runs`.

    Returns:
        One row per comparison: means and medians over runs of either value, the mean difference (other minus first)
        with its 95 % bootstrap interval over members (none with fewer than 5), the margin, and the verdict.

    Raises:
        ValueError: `factor` has a single value.
    """
    first, *others = runs[factor].unique()
    if not others:
        raise ValueError(f"the runs have one value of {factor!r}, {first:g}; there is nothing to compare it with")
    rows = []
    for (planner, context_size), group in runs.groupby(["planner", "context_size"]):
        for metric, (unit, margin) in MARGINS.items():
            scores = score_matrix(group, metric, [factor])  # [M, values]
            medians = group.groupby(factor)[metric].median()
            for other in others:
                difference = scores[other] - scores[first]
                enough = len(difference) >= statistics.MIN_MEMBERS
                low, high = statistics.interval(difference) if enough else (None, None)
                rows.append(
                    {
                        "planner": PLANNERS[str(planner)],
                        "context_size": context_size,
                        "metric": metric,
                        "unit": unit,
                        "members": len(scores),
                        "a": first,
                        "b": other,
                        "mean_a": scores[first].mean(),
                        "mean_b": scores[other].mean(),
                        "median_a": medians[first],
                        "median_b": medians[other],
                        "difference": difference.mean(),
                        "low": low,
                        "high": high,
                        "margin": margin,
                        "verdict": verdict(low, high, margin),
                    }
                )
    return pd.DataFrame(rows)


def verdict(low: float | None, high: float | None, margin: float) -> str:
    """What an interval of a difference says: "same", "different" or "not decided"."""
    if low is None or high is None:
        return "not decided"
    if -margin <= low and high <= margin:
        return "same"
    return "different" if low > 0 or high < 0 else "not decided"


def markdown(table: pd.DataFrame, factor: str) -> str:
    """A table of `compare` as Markdown."""
    name = factor.replace("_", " ")
    lines = [
        f"| planner | context size | metric | {name} | mean | median | difference [95 % interval] | margin | verdict |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for _, row in table.iterrows():
        interval = f" [{number(row['low'], sign=True)}, {number(row['high'], sign=True)}]"
        lines.append(
            f"| {row['planner']} | {row['context_size']} | {row['metric'].replace('_', ' ')} ({row['unit']}) | "
            f"{row['a']:g}, {row['b']:g} | {number(row['mean_a'])}, {number(row['mean_b'])} | "
            f"{number(row['median_a'])}, {number(row['median_b'])} | "
            f"{number(row['difference'], sign=True)}{interval if pd.notna(row['low']) else NOTHING} | "
            f"±{row['margin']:g} | {row['verdict']} |"
        )
    return "\n".join(lines) + "\n"
