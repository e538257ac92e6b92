"""One factor at a time: the same models, starts and goals under two or more values of one column of the runs.

Knows tables of runs only. A difference whose interval contains zero is within the noise between members.
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from affmap.report import statistics
from affmap.report.tables import Job, read_runs, score_matrix, write_csv, write_runs
from affmap.report.text import number

METRICS = {"prediction_error": "nats", "mean_distance": "u", "reached": "share"}
"""Metric -> unit."""


def write(output: Path, jobs: Sequence[Job], factor: str) -> Path:
    """Write `tables/runs.csv`, `tables/<factor>.csv` and `tables/<factor>.md` into `output`; returns the last."""
    runs = pd.concat([read_runs(job) for job in jobs], ignore_index=True)
    table = compare(runs, factor)
    folder = output / "tables"
    folder.mkdir(parents=True, exist_ok=True)
    write_runs(folder, runs)
    write_csv(folder / f"{factor}.csv", table)
    path = folder / f"{factor}.md"
    path.write_text(markdown(table), "utf-8", newline="\n")
    return path


def compare(runs: pd.DataFrame, factor: str) -> pd.DataFrame:
    """Compare every value of `factor` with the first one, for each planner, context size and metric.

    Returns:
        One row per comparison: means over members of either value, the mean difference (other minus first) with its
        95 % bootstrap interval over members, and whether the interval contains zero.

    Raises:
        ValueError: `factor` has a single value.
    """
    first, *others = runs[factor].unique()
    if not others:
        raise ValueError(f"the runs have one value of {factor!r}, {first!r}; there is nothing to compare it with")
    rows = []
    for (planner, context_size), group in runs.groupby(["planner", "context_size"]):
        for metric, unit in METRICS.items():
            scores = score_matrix(group, metric, [factor])  # [M, values]
            for other in others:
                difference = scores[other] - scores[first]
                low, high = statistics.interval(difference)
                rows.append(
                    {
                        "planner": planner,
                        "context_size": context_size,
                        "metric": metric,
                        "unit": unit,
                        "members": len(scores),
                        "factor": factor,
                        "a": first,
                        "b": other,
                        "mean_a": scores[first].mean(),
                        "mean_b": scores[other].mean(),
                        "difference": difference.mean(),
                        "low": low,
                        "high": high,
                        "within_noise": low <= 0 <= high,
                    }
                )
    return pd.DataFrame(rows)


def markdown(table: pd.DataFrame) -> str:
    """A table of `compare` as Markdown."""
    lines = [
        "| planner | context size | metric | " + f"{table['a'].iloc[0]} | other | difference [95 % interval] |",
        "|---|---|---|---|---|---|",
    ]
    for _, row in table.iterrows():
        interval = f"{number(row['low'], sign=True)}, {number(row['high'], sign=True)}"
        lines.append(
            f"| {row['planner']} | {row['context_size']} | {row['metric'].replace('_', ' ')} ({row['unit']}) | "
            f"{number(row['mean_a'])} | {row['b']}: {number(row['mean_b'])} | "
            f"{number(row['difference'], sign=True)} [{interval}] |"
        )
    return "\n".join(lines) + "\n"
