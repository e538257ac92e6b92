"""One factor at a time: the same starts and goals under two or more values of one key of the configuration.

Knows tables of runs, and the configurations they were made with. Two values count as the *same* when the 95 % interval
of their difference lies within a margin set beforehand, as *different* when it leaves out zero and reaches beyond the
margin; otherwise the verdict is *not decided*.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from affmap.report import build
from affmap.report.markdown import escape_name
from affmap.report.markdown import table as markdown_table
from affmap.results import provenance, statistics
from affmap.results.metrics import METRICS
from affmap.results.numbers import NOTHING, number
from affmap.results.provenance import differences, leaves
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Setting, short_name, value_name
from affmap.results.statistics import Verdict
from affmap.results.tables import Results, read_provenance, read_runs, score_matrix, write_csv, write_runs
from affmap.settings import ConfigError

COMPARED = ("validation_nll", "prediction_error", "mean_distance", "reached", "success")
"""Metrics; the loss is that of a run's model."""

WORDS = {Verdict.HOLDS: "same", Verdict.DOES_NOT_HOLD: "different", Verdict.NOT_DECIDED: "not decided"}
"""Words for the verdicts on equality."""

COLUMNS = {
    "planner": (PLANNER.key, "planner.kind", "agent.kind", "agent"),
    "layout": (LAYOUT.key, "world"),
    "context_size": (CONTEXT_SIZE.key,),
}
"""Column that distinguishes settings in the table of runs -> keys of the configuration behind it."""


@dataclass(frozen=True)
class ComparisonReport:
    """A comparison of the values of one key: a table with intervals, and a figure.

    It has `tables/runs.csv`, `tables/<key>.csv` and `.md`, and `figures/<key>.png` and `.pdf`; in names of files and
    columns the dots of a key are underscores.

    Raises:
        ConfigError: a job has no such key, or other keys differ as well.
    """

    output: Path
    jobs: Sequence[Setting]
    """Completed settings."""
    key: str
    """A dotted key of the configuration."""
    name: str
    """Name of the experiment."""
    title: str
    command: str
    """Command line that makes this comparison."""
    notice: str | None
    """Warning at the top of Markdown and figure, or None."""

    def __post_init__(self) -> None:
        _check(self.jobs, self.key)

    @property
    def record(self) -> dict[str, Any]:
        """Compared key and provenance, see `build.Report`."""
        head = {"name": self.name, "title": self.title, "notice": self.notice, "report": self.command}
        return {"compare": self.key, **head, **provenance.summarize(self.jobs, read_provenance(self.jobs))}

    @property
    def page(self) -> Path:
        """The table in Markdown."""
        return self.output / "tables" / f"{self._factor}.md"

    @property
    def _factor(self) -> str:
        return self.key.replace(".", "_")

    def draw(self, folder: Path) -> None:
        """Write tables and figure, see `build.Report`.

        Raises:
            ConfigError: all jobs have the same value of the key.
        """
        from affmap.experiments.comparison.figures import draw_differences  # Matplotlib takes a second to import

        runs = [_with_loss(job).assign(**{self._factor: value_of(job, self.key)}) for job in self.jobs]
        table = compare(every := pd.concat(runs, ignore_index=True), self.key)
        write_runs(folder / "tables", self.name, every)
        write_csv(folder / "tables" / f"{self._factor}.csv", table)
        draw_differences(table, every, self.key, folder / "figures" / self._factor, self.notice)
        build.markdown_page(
            folder / "tables" / self.page.name, self.title, self.notice, self.command, markdown(table, self.key)
        )


def _with_loss(job: Setting) -> pd.DataFrame:
    """The runs of a job, with the validation loss of each run's model."""
    losses = Results((job,)).last_epoch.set_index("member")["validation_nll"]
    runs = read_runs(job)
    return runs.assign(validation_nll=runs["member"].map(losses))


def value_of(job: Setting, key: str) -> Any:
    """The value of a dotted key in the configuration of a job's control; of a group with a name, its name.

    A key at its neutral value is in no stage; its value is that which the sweep has set.

    Raises:
        ConfigError: there is no such key.
    """
    values = _values(job)
    known = (each for each in (key, f"{key}.name", f"{key}.kind") if each in values)
    value = next((values[each] for each in known), job.values.get(key))
    if value is None:
        raise ConfigError(
            f"report.compare is {key!r}, which runs of control do not depend on; they do on {sorted(values)}"
        )
    if isinstance(value, list):
        return ", ".join(str(item.get("name", item)) if isinstance(item, dict) else str(item) for item in value)
    return str(value).lower() if isinstance(value, bool) else value


def _values(job: Setting) -> dict[str, Any]:
    """Configuration that the runs of a job depend on, by dotted key."""
    return leaves(Results((job,)).provenance[job.control[0]]["config"])


def _check(jobs: Sequence[Setting], key: str) -> None:
    """Refuse jobs with further differences, which the table does not show and would silently average."""
    first_jobs: dict[tuple[Any, ...], Setting] = {}
    for job in jobs:
        first = first_jobs.setdefault((job.planner, job.layout, job.context_size, value_of(job, key)), job)
        if others := differences(_values(job), _values(first)):
            raise ConfigError(
                f"report.compare is {key!r}, but {', '.join(others)} differ, too; sweep over one key at a time."
            )


def compare(runs: pd.DataFrame, key: str) -> pd.DataFrame:
    """Compare every value of a key with the first one, for each planner, context size and metric.

    Args:
        runs: one row per run, with the values in a column that is named as the key, its dots being underscores.
        key: what to compare.

    Returns:
        One row per comparison: means and medians over runs of either value, the mean difference (other minus first)
        with its 95 % interval over members (none with fewer than 5, or where one lacks a number), the margin,
        and the verdict. Layouts have a column where there are several that are not what is compared; success has rows
        where it is not the same as having reached the goal, and the validation loss where models differ.

    Raises:
        ConfigError: the key has a single value.
    """
    factor = key.replace(".", "_")
    first, *others = runs[factor].unique()
    if not others:
        raise ConfigError(
            f"the runs have one value of {key!r}, {value_name(first)}; there is nothing to compare it with"
        )
    settings = [column for column, sources in COLUMNS.items() if key not in sources]
    if "layout" in settings and runs["layout"].nunique() == 1:
        settings.remove("layout")
    redundant = {"success"} if (runs["success"] == runs["reached"]).all() else set()
    if runs.groupby([*settings, "member"])["validation_nll"].nunique().max() <= 1:  # the models are the same
        redundant.add("validation_nll")
    metrics = [metric for metric in COMPARED if metric not in redundant]
    rows = []
    for setting, group in runs.groupby(settings):
        labels = dict(zip(settings, setting, strict=True))
        for metric in metrics:
            scores = score_matrix(group, metric, [factor])  # [M, values]
            medians = group.astype({metric: float}).groupby(factor)[metric].median()
            for other in others:
                difference = scores[other] - scores[first]
                enough = len(difference) >= statistics.MIN_MEMBERS and difference.notna().all()
                low, high = statistics.interval(difference) if enough else (None, None)
                rows.append(
                    {
                        **labels,
                        "metric": metric,
                        "unit": METRICS[metric].unit,
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
                        "margin": METRICS[metric].margin,
                        "verdict": verdict(low, high, METRICS[metric].margin),
                    }
                )
    table = pd.DataFrame(rows)
    return table.assign(planner=table["planner"].map(short_name)) if "planner" in table else table


def verdict(low: float | None, high: float | None, margin: float | None) -> str:
    """Verdict from the interval of a difference: "same", "different" or "not decided"."""
    if low is None or high is None or margin is None:
        return WORDS[Verdict.NOT_DECIDED]
    return WORDS[statistics.equivalence(low, high, margin)]


def markdown(table: pd.DataFrame, key: str) -> str:
    """Markdown table of the results of `compare`."""
    settings = [column for column in COLUMNS if column in table]
    heads = [*(column.replace("_", " ") for column in settings), "metric", key.replace(".", " ").replace("_", " ")]
    heads += ["mean", "median", "difference [95 % interval]", "margin", "verdict"]
    rows = []
    for _, row in table.iterrows():
        interval = f" [{number(row['low'], sign=True)}, {number(row['high'], sign=True)}]"
        rows.append(
            [
                *(escape_name(str(row[column])) for column in settings),
                f"{METRICS[row['metric']].name} ({row['unit']})",
                escape_name(f"{value_name(row['a'])}, {value_name(row['b'])}"),
                f"{number(row['mean_a'])}, {number(row['mean_b'])}",
                f"{number(row['median_a'])}, {number(row['median_b'])}",
                f"{number(row['difference'], sign=True)}{interval if pd.notna(row['low']) else f' {NOTHING}'}",
                f"±{row['margin']:g}",
                row["verdict"],
            ]
        )
    return markdown_table(heads, rows)
