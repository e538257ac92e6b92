"""The reports of all experiments of the paper -> one: what holds, what does not, and what it took.

It shows the figures that the experiments' own reports have drawn, and tests their claims again.
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from affmap.report import blocks, build, content, page, sentences
from affmap.report.blocks import Block
from affmap.report.figures import CAPTIONS
from affmap.report.sections import deviations
from affmap.results import manifest, provenance
from affmap.results.claims import Claim, Score
from affmap.results.numbers import NOTHING, number, p_value, points
from affmap.results.scores import as_table, score
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results, write_csv
from affmap.settings.messages import ConfigError

TITLE = "Affordances and active motor control: the paper's experiments"

FIGURES = ("results", "trajectories", "maps", "growth", "failures", "world")
"""Those shown of each experiment, where it has them."""


class Chapter(NamedTuple):
    """One experiment."""

    title: str
    results: Results
    settings: ReportSettings
    claims: Sequence[Claim]
    output: Path
    """Folder of its own report."""
    missing: str
    """A sentence on settings that have not been run; empty where all have."""


@dataclass(frozen=True)
class PaperReport:
    """The report of all experiments: PDF, HTML, the figures of their own reports, and a table of claims.

    Raises:
        ConfigError: the report of an experiment is not that of its results.
    """

    output: Path
    chapters: Sequence[Chapter]
    """The experiments in their order."""
    command: str
    """The command line that gives this report."""
    notice: str | None
    """A warning to the reader, or None."""

    def __post_init__(self) -> None:
        for chapter in self.chapters:
            made = {record["digest"] for record in chapter.results.provenance.values()}
            if manifest.stage_digests(chapter.output) != made:
                raise ConfigError(
                    f"{chapter.output} holds no report of these results; run affmap-report for them first."
                )

    @property
    def record(self) -> dict[str, Any]:
        """See `build.Report`."""
        experiments = {
            chapter.output.name: {
                "title": chapter.title,
                "missing": chapter.missing,
                "settings": {name: getattr(chapter.settings, name) for name in sorted(ReportSettings.model_fields)},
                **provenance.summarize(chapter.results.settings, chapter.results.provenance),
            }
            for chapter in self.chapters
        }
        return {"title": TITLE, "notice": self.notice, "report": self.command, "experiments": experiments}

    @property
    def page(self) -> Path:
        """The PDF."""
        return self.output / "report.pdf"

    def draw(self) -> None:
        """See `build.Report`."""
        scores = [score(chapter.results, chapter.claims) for chapter in self.chapters]
        _write_tables(self.output / "tables", self.chapters, scores)
        drawn = [_copy_figures(chapter, self.output / "figures") for chapter in self.chapters]
        content = _blocks(self.chapters, scores, drawn, self.record)
        page.write(self.output, {"title": TITLE, "notice": self.notice or "", "blocks": content})


def _write_tables(folder: Path, chapters: Sequence[Chapter], scores: Sequence[Sequence[Score]]) -> None:
    tables = []
    for chapter, found in zip(chapters, scores, strict=True):
        table = as_table(found)
        table.insert(0, "experiment", chapter.output.name)
        table["missing"] = chapter.missing
        tables.append(table)
    write_csv(folder / "claims.csv", pd.concat(tables))
    rows = _rows(chapters, scores)
    marked = [row | {"statement": row["statement"] + (" (So far.)" if row["detail"] else "")} for row in rows]
    build.write_text(folder / "claims.md", content.claims_markdown(marked))


def _rows(chapters: Sequence[Chapter], scores: Sequence[Sequence[Score]]) -> list[dict[str, str]]:
    """One row for each claim."""
    return [_short(item, chapter) for chapter, some in zip(chapters, scores, strict=True) for item in some]


def _copy_figures(chapter: Chapter, folder: Path) -> dict[str, str]:
    """Take over figures of an experiment's own report, into a folder of its own; returns name -> caption."""
    target = folder / chapter.output.name
    shutil.rmtree(target, ignore_errors=True)  # a figure may have been drawn in other formats
    target.mkdir(parents=True, exist_ok=True)
    captions: dict[str, str] = json.loads((chapter.output / "figures" / CAPTIONS).read_text("utf-8"))
    shown = {name: captions[name] for name in FIGURES if name in captions}
    for name in shown:
        for path in (chapter.output / "figures").glob(f"{name}.*"):
            shutil.copyfile(path, target / path.name)
    return shown


def _blocks(
    chapters: Sequence[Chapter],
    scores: Sequence[Sequence[Score]],
    drawn: Sequence[Mapping[str, str]],
    record: dict[str, Any],
) -> list[Block]:
    found: list[Block] = [
        blocks.alert(f"{chapter.title}: {chapter.missing}") for chapter in chapters if chapter.missing
    ]
    together = [item for some in scores for item in some]
    found += [
        blocks.paragraph(
            f"{sentences.verdict_count(together, 'its experiments')} How this was decided, and every part of these "
            "claims, is said below the experiments; the p of a claim of several parts is the largest of theirs. The "
            "pages of the experiments' own reports play their runs and tell the codes of their maps. Claims near a "
            "bound were tested once more, with 100 fresh members: see the last part but one."
        ),
        blocks.claims(_rows(chapters, scores)),
        blocks.bullets(sentences.remarks(together)),
        blocks.heading("What was run, and what it took"),
        *_costs(chapters),
    ]
    for chapter, some, captions in zip(chapters, scores, drawn, strict=True):
        found += _experiment(chapter, some, captions)
    return [
        *found,
        blocks.heading("How it was decided"),
        blocks.paragraph(content.RULE),
        blocks.paragraph(content.RANGES),
        blocks.claims([row for some in scores for row in content.claim_rows(some)]),
        blocks.heading("Where this differs from the paper, and why"),
        deviations([chapter.results for chapter in chapters]),
        blocks.heading("What did not reproduce in the reference run, and why"),
        blocks.points(points((Path(__file__).parent / "causes.md").read_text("utf-8"))),
        blocks.heading("Provenance"),
        content.origins(list(record["experiments"].values()), record["report"]),
        blocks.paragraph("Every stage is listed in the experiments' own reports, and in provenance.json."),
    ]


def _short(item: Score, chapter: Chapter) -> dict[str, str]:
    """A claim in a row; where it has several parts, the largest p of all is that of the whole."""
    counting = [part for part in item.parts if part.counts]
    single = counting[0] if len(counting) == 1 else None
    p = [part.outcome.p for part in counting]
    return {
        "name": item.claim.name,
        "statement": item.claim.statement,
        "detail": "so far: not all settings have been run" if chapter.missing else "",
        "effect": sentences.effect(single.outcome, single.unit) if single else f"{len(counting)} parts",
        "p": NOTHING if None in p else p_value(max(value for value in p if value is not None)),
        "opposite": p_value(single.outcome.p_opposite) if single else NOTHING,
        "verdict": item.verdict.value,
    }


def _costs(chapters: Sequence[Chapter]) -> list[Block]:
    """Process minutes of each experiment and kind of stage."""
    tables = provenance.costs([chapter.results for chapter in chapters])
    rows = [
        [chapter.title, str(len(chapter.results.runs)), *(_minutes(cost) for cost in costs), _total(costs)]
        for chapter, costs in zip(chapters, tables, strict=True)
    ]
    everything = [cost for costs in tables for cost in costs]
    each = [[cost for cost in everything if cost.stage == stage.stage] for stage in tables[0]]
    rows.append(["All", "", *(_total(costs) for costs in each), _total(everything)])
    records = [record for chapter in chapters for record in chapter.results.provenance.values()]
    cores = sorted({record["machine"]["cores"] for record in records})
    return [
        blocks.paragraph(
            "Minutes on the clock of every process, all attempts together; in brackets the number of "
            "processes. What two experiments share is counted with the first. A process has one thread unless "
            f"configured otherwise; the machine had {' or '.join(map(str, cores))} cores, and other processes may "
            "have been running beside these."
        ),
        blocks.table(
            ["Experiment", "Runs", *(cost.stage.capitalize() for cost in tables[0]), "Together"], rows, wide=0
        ),
    ]


def _minutes(cost: provenance.Cost) -> str:
    return f"{number(cost.seconds / 60, 1)} ({cost.folders})" if cost.folders else NOTHING


def _total(costs: Sequence[provenance.Cost]) -> str:
    return number(sum(cost.seconds for cost in costs) / 60, 1)


def _experiment(chapter: Chapter, scores: Sequence[Score], captions: Mapping[str, str]) -> list[Block]:
    return [
        blocks.heading(chapter.title),
        *([blocks.alert(chapter.missing)] if chapter.missing else []),
        blocks.paragraph(sentences.setting(chapter.results)),
        blocks.bullets(
            [
                *sentences.findings(scores),
                *sentences.bounds(chapter.results, chapter.settings),
                *sentences.mixtures(chapter.results, chapter.settings),
                *sentences.uncrossable(chapter.results, chapter.settings),
                sentences.spikes(chapter.results),
            ]
        ),
        *content.figures([*captions], captions, f"{chapter.output.name}/"),
        *content.medians(chapter.results, chapter.settings, level=2),
        *content.baselines(chapter.results, chapter.settings, level=2),
    ]
