"""The report of all experiments of the paper, or of all beyond it: verdicts on claims, figures and costs.

It shows the figures of the experiments' own reports, and tests their claims again.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from affmap.report import build, citation, page, sentences
from affmap.report.content import Content, alert, claim_rows, claims_markdown, claims_table, deviations, origins
from affmap.report.experiment import PARTS, Room
from affmap.report.figures import CAPTIONS, figures_of
from affmap.report.markdown import bullets, escape, fill, text_table
from affmap.results import manifest, provenance
from affmap.results.claims import Score, holm
from affmap.results.numbers import NOTHING, listed, number, p_value
from affmap.results.scores import as_table, score
from affmap.results.setting import ReportSettings
from affmap.results.statistics import FEW_MEMBERS, LEVEL
from affmap.results.tables import Results, write_csv
from affmap.settings.messages import ConfigError

_HERE = Path(__file__).parent


class Volume(StrEnum):
    """A report of several experiments; the name of its folder and of its page."""

    PAPER = "paper"
    BEYOND = "beyond"

    @property
    def chapter(self) -> Path:
        """Template of an experiment's chapter; beyond the paper, with introduction and predictions."""
        return _HERE / ("chapter.md" if self is Volume.PAPER else "chapter_beyond.md")

    @property
    def heading(self) -> str:
        """Title of the report."""
        subject = "the paper's experiments" if self is Volume.PAPER else "beyond the paper"
        return f"Affordances and active motor control: {subject}"


class Chapter(NamedTuple):
    """One experiment."""

    title: str
    results: Results
    settings: ReportSettings
    room: Room
    output: Path
    """Folder of its own report."""
    missing: str
    """Sentence on settings that have not been run; empty if all have."""


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
    """Command line that makes this report."""
    notice: str | None
    """Warning to the reader, or None."""
    volume: Volume = Volume.PAPER
    """Which experiments these are."""

    def __post_init__(self) -> None:
        for chapter in self.chapters:
            digests = {record["digest"] for record in chapter.results.provenance.values()}
            problems = manifest.problems(chapter.output)
            if manifest.stage_digests(chapter.output) != digests:
                problems = [f"{chapter.output} holds no report of these results."]
            if problems:
                raise ConfigError("\n".join([*problems, "Run affmap-report for it first."]))

    @property
    def record(self) -> dict[str, Any]:
        """Settings and provenance of all experiments, see `build.Report`."""
        experiments = {
            chapter.output.name: {
                "title": chapter.title,
                "missing": chapter.missing,
                "settings": {name: getattr(chapter.settings, name) for name in sorted(ReportSettings.model_fields)},
                **provenance.summarize(chapter.results.settings, chapter.results.provenance),
            }
            for chapter in self.chapters
        }
        return {"title": self.volume.heading, "notice": self.notice, "report": self.command, "experiments": experiments}

    @property
    def page(self) -> Path:
        """The PDF."""
        return self.output / "report.pdf"

    def draw(self, folder: Path) -> None:
        """Write tables and page, see `build.Report`."""
        scores = [score(chapter.results, chapter.room.claims) for chapter in self.chapters]
        _write_tables(folder / "tables", self.chapters, scores)
        content = PaperContent(self, scores)
        page.write(folder, fill(_HERE / f"{self.volume}.md", content, (_HERE, PARTS)), self.notice, {})


@dataclass(frozen=True)
class PaperContent:
    """The directives of the page, see `affmap.report.content`."""

    report: PaperReport
    scores: Sequence[Sequence[Score]]
    """Scores of each chapter's claims."""

    @property
    def _every(self) -> list[Score]:
        """Scores of all claims, in order."""
        return [each for some in self.scores for each in some]

    def title(self) -> str:
        """Title of the report."""
        return self.report.volume.heading

    def notice(self) -> str:
        """Warning to the reader, and a note on incomplete chapters."""
        missing = [f"{chapter.title}: {chapter.missing}" for chapter in self.report.chapters if chapter.missing]
        return "\n\n".join(map(alert, filter(None, [self.report.notice, *missing])))

    def byline(self) -> str:
        """Authors, version, commits and date of the results, and where to find the paper."""
        records = list(self.report.record["experiments"].values())
        versions = provenance.distinct([each.get("affmap") for record in records for each in record["versions"]])
        commits = provenance.distinct([commit for record in records for commit in record["git"]])
        dates = sorted(str(stage["started"])[:10] for record in records for stage in record["stages"])
        made = [
            f"affmap {listed(versions)}" if versions else "affmap",
            *([f"commit{'s' * (len(commits) > 1)} {listed(commits)}"] if commits else []),
            f"results of {dates[-1]}",
        ]
        by = f"{escape(citation.authors())} ({escape(', '.join(made))})"
        return f"{by}\n\nThe paper: {citation.paper()}. {escape(citation.request())}"

    def verdicts(self) -> str:
        """Numbers of claims that hold, do not hold, and are not decided."""
        return escape(sentences.verdict_count(self._every))

    def correction(self) -> str:
        """Claims that hold, but not with p values that are corrected for the number of claims."""
        return escape(sentences.correction(self._every))

    def remarks(self) -> str:
        """Choices made after a verdict had been seen."""
        return bullets(map(escape, sentences.remarks(self._every, stated=True)))

    def claims(self) -> str:
        """Table of the claims, a row each."""
        return claims_table(_rows(self.report.chapters, self.scores))

    def tests(self) -> str:
        """Table of the claims with all their parts."""
        return claims_table([row for some in self.scores for row in claim_rows(some)])

    def level(self) -> str:
        """Level of significance of the tests."""
        return f"{LEVEL}"

    def few(self) -> str:
        """Number of members below which intervals are Student's."""
        return f"{FEW_MEMBERS}"

    def axes(self) -> str:
        """Explanation of the paper's axes."""
        return escape(sentences.AXES)

    def costs(self) -> str:
        """Process minutes of each experiment and kind of stage."""
        chapters = self.report.chapters
        tables = provenance.costs([chapter.results for chapter in chapters])
        rows = [
            [chapter.title, str(len(chapter.results.runs)), *(_minutes(cost) for cost in costs), _total(costs)]
            for chapter, costs in zip(chapters, tables, strict=True)
        ]
        everything = [cost for costs in tables for cost in costs]
        each = [[cost for cost in everything if cost.stage == stage.stage] for stage in tables[0]]
        rows.append(["All", "", *(_total(costs) for costs in each), _total(everything)])
        return text_table(["Experiment", "Runs", *(cost.stage.capitalize() for cost in tables[0]), "Together"], rows)

    def cores(self) -> str:
        """Number of cores of the machines."""
        records = [record for chapter in self.report.chapters for record in chapter.results.provenance.values()]
        return " or ".join(map(str, sorted({record["machine"]["cores"] for record in records})))

    def chapters(self) -> str:
        """The experiments, one after the other."""
        return "\n\n".join(map(self._chapter, self.report.chapters, self.scores))

    def _chapter(self, chapter: Chapter, scores: Sequence[Score]) -> str:
        folder = Path(os.path.relpath(chapter.output / "figures", self.report.output)).as_posix()
        captions = json.loads((chapter.output / "figures" / CAPTIONS).read_text("utf-8"))
        known = figures_of(*chapter.room.figures)
        about = Content(
            chapter.title, chapter.missing, chapter.results, scores, chapter.settings, known, captions, {}, folder
        )
        return fill(self.report.volume.chapter, about, chapter.room.folders)

    def deviations(self) -> str:
        """Deviations from the paper, with reasons."""
        return deviations([chapter.results for chapter in self.report.chapters])

    def origins(self) -> str:
        """Command, commits, versions and machines."""
        record = self.report.record
        return origins(list(record["experiments"].values()), record["report"])


def _write_tables(folder: Path, chapters: Sequence[Chapter], scores: Sequence[Sequence[Score]]) -> None:
    tables = []
    for chapter, chapter_scores in zip(chapters, scores, strict=True):
        table = as_table(chapter_scores)
        table.insert(0, "experiment", chapter.output.name)
        table["missing"] = chapter.missing
        tables.append(table)
    whole = pd.concat(tables)
    every = [each for some in scores for each in some]
    corrected = dict(zip((each.claim.name for each in every), holm(every), strict=True))
    whole["p_holm"] = whole["claim"].map(corrected).astype(float)
    write_csv(folder / "claims.csv", whole)
    rows = _rows(chapters, scores)
    rows_so_far = [row | {"statement": row["statement"] + (" (So far.)" if row["detail"] else "")} for row in rows]
    build.write_text(folder / "claims.md", claims_markdown(rows_so_far))


def _rows(chapters: Sequence[Chapter], scores: Sequence[Sequence[Score]]) -> list[dict[str, str]]:
    """One row for each claim."""
    items = [(item, chapter) for chapter, some in zip(chapters, scores, strict=True) for item in some]
    corrected = holm([item for item, _ in items])
    return [_short(item, chapter, p) for (item, chapter), p in zip(items, corrected, strict=True)]


def _short(item: Score, chapter: Chapter, corrected: float | None) -> dict[str, str]:
    """Row of a claim."""
    counting = [part for part in item.parts if part.counts]
    single = counting[0] if len(counting) == 1 else None
    return {
        "name": item.claim.name,
        "statement": item.claim.statement,
        "detail": "so far: not all settings have been run" if chapter.missing else "",
        "effect": sentences.effect(single.outcome, single.unit) if single else f"{len(counting)} parts",
        "p": p_value(item.p),
        "holm": p_value(corrected),
        "opposite": p_value(single.outcome.p_opposite) if single else NOTHING,
        "verdict": item.verdict.value,
    }


def _minutes(cost: provenance.Cost) -> str:
    return f"{number(cost.seconds / 60, 1)} ({cost.folders})" if cost.folders else NOTHING


def _total(costs: Sequence[provenance.Cost]) -> str:
    return number(sum(cost.seconds for cost in costs) / 60, 1)
