"""The report of an experiment: tables, figures, PDF and HTML from completed stages.

The same stages give the same bytes. `deviations.md` says what differs from the paper; it knows no result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from affmap.report import blocks, build, captions, content, figures, page
from affmap.report.explorer.maps import explorer
from affmap.report.player.runs import player
from affmap.results import provenance
from affmap.results.claims import Claim, Score
from affmap.results.scores import as_table, medians, score
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results, write_csv, write_runs


@dataclass(frozen=True)
class ExperimentReport:
    """The report of an experiment: PDF, HTML, figures and tables.

    Raises:
        ConfigError: settings differ in more than two keys.
    """

    output: Path
    results: Results
    settings: ReportSettings
    claims: Sequence[Claim]
    """The paper's claims about the experiment; empty where it has none."""
    name: str
    """Name of the experiment."""
    title: str
    command: str
    """The command line that gives this report."""
    notice: str | None
    """A warning to the reader on every figure and page, such as that of a smoke run; or None."""

    def __post_init__(self) -> None:
        self.results.check_factors()  # before anything is written

    @property
    def record(self) -> dict[str, Any]:
        """See `build.Report`."""
        return {
            "name": self.name,
            "title": self.title,
            "notice": self.notice,
            "report": self.command,
            "settings": {name: getattr(self.settings, name) for name in sorted(ReportSettings.model_fields)},
            **provenance.summarize(self.results.settings, self.results.provenance),
        }

    @property
    def page(self) -> Path:
        """The PDF."""
        return self.output / "report.pdf"

    def draw(self) -> None:
        """See `build.Report`."""
        scores = score(self.results, self.claims)
        _write_tables(self.output / "tables", self.name, self.results, scores, self.settings)
        drawn = figures.draw_all(self.results, self.settings, self.output / "figures", self.notice)
        content = _blocks(self.results, scores, self.settings, drawn, self.record)
        page.write(self.output, {"title": self.title, "notice": self.notice or "", "blocks": content})


def deviations(reports: Sequence[Results]) -> blocks.Block:
    """What differs from the paper in what was run, and why."""
    return blocks.points(provenance.fill((Path(__file__).parent / "deviations.md").read_text("utf-8"), reports))


def _write_tables(folder: Path, name: str, results: Results, scores: Sequence[Score], settings: ReportSettings) -> None:
    write_runs(folder, name, results.runs)
    write_csv(folder / "validation.csv", results.validation)
    write_csv(folder / "medians.csv", medians(results, settings))
    if scores:
        write_csv(folder / "claims.csv", as_table(scores))
        build.write_text(folder / "claims.md", content.claims_markdown(content.claim_rows(scores)))


def _blocks(
    results: Results, scores: Sequence[Score], settings: ReportSettings, drawn: Sequence[str], record: dict[str, Any]
) -> list[blocks.Block]:
    texts = captions.captions(results, scores, settings)

    def shown(*names: str) -> list[blocks.Block]:
        return content.figures(names, drawn, texts)

    return [
        *content.experiment(results, scores, settings),
        blocks.heading("Results"),
        blocks.paragraph(content.MAIN_FIGURES),
        *shown("results", "trajectories"),
        blocks.heading(content.LOOK_CLOSER),
        player(results, settings),
        *filter(None, [explorer(results, settings)]),
        *content.tests(scores, results),
        *content.medians(results, settings),
        *([blocks.paragraph(content.RANGES)] if settings.axes else []),
        blocks.heading("Maps, worlds and outcomes"),
        blocks.paragraph(content.MORE_FIGURES),
        *shown("maps", "growth", "world", "exploration", "outcomes", "failures"),
        blocks.heading("Where this differs from the paper, and why"),
        deviations([results]),
        blocks.heading("Provenance"),
        content.origins([record], record["report"]),
        content.stages(record, [results.x, results.color]),
    ]
