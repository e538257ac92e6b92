"""The report of an experiment, made from completed stages: tables, figures and a page.

The same stages give the same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from affmap.results import provenance
from affmap.results.claims import Claim, Score
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results, write_csv, write_runs

_HERE = Path(__file__).parent

PARTS = _HERE / "parts"
"""Folder of the texts that any page may include."""


@dataclass(frozen=True)
class Room:
    """An experiment's own claims, texts and figures; the default is for experiments without a folder of their own."""

    claims: Sequence[Claim] = ()
    """Claims that are tested."""
    page: Path = _HERE / "page.md"
    """The page, see `affmap.report.markdown`."""
    folders: Sequence[Path] = (PARTS,)
    """Folders of the texts that the page includes, searched in this order."""
    figures: Sequence[str] = ("affmap.report.figures",)
    """Packages of the figures, see `affmap.report.figures`."""


@dataclass(frozen=True)
class ExperimentReport:
    """The report of an experiment: Markdown, PDF, HTML, figures and tables.

    Raises:
        ConfigError: settings differ in more than two keys.
    """

    output: Path
    results: Results
    settings: ReportSettings
    room: Room
    """The experiment's own claims, page and figures."""
    name: str
    """Name of the experiment."""
    title: str
    command: str
    """Command line that makes this report."""
    notice: str | None
    """Warning on every figure and page, such as that of a smoke run; or None."""

    def __post_init__(self) -> None:
        self.results.check_factors()  # before anything is written

    @property
    def record(self) -> dict[str, Any]:
        """Settings and provenance of the report, see `build.Report`."""
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

    def draw(self, folder: Path) -> None:
        """Write tables, figures and page, see `build.Report`."""
        from affmap.report import figures, page  # drawing takes seconds to import
        from affmap.report.content import Content
        from affmap.report.explorer.maps import explorer
        from affmap.report.markdown import fill
        from affmap.report.player.runs import player
        from affmap.results.scores import score

        results, settings = self.results, self.settings
        scores = score(results, self.room.claims)
        self._write_tables(folder / "tables", scores)
        drawn = figures.draw_all(self.room.figures, results, settings, folder / "figures", self.notice)
        known = figures.figures_of(*self.room.figures)
        content = Content(self.title, self.notice, results, scores, settings, known, drawn, self.record)
        widgets = {"player": player(results, settings), "explorer": explorer(results, settings)}
        text = fill(self.room.page, content, self.room.folders)
        page.write(folder, text, self.notice, {name: widget for name, widget in widgets.items() if widget})

    def _write_tables(self, folder: Path, scores: Sequence[Score]) -> None:
        from affmap.report.build import write_text
        from affmap.report.content import claim_rows, claims_markdown
        from affmap.results.scores import as_table, medians

        results = self.results
        write_runs(folder, self.name, results.runs)
        write_csv(folder / "validation.csv", results.validation)
        write_csv(folder / "steps.csv", results.steps)
        if results.baselines:
            write_csv(folder / "baselines.csv", results.baseline_runs)
        write_csv(folder / "medians.csv", medians(results, self.settings))
        if scores:
            write_csv(folder / "claims.csv", as_table(scores))
            write_text(folder / "claims.md", claims_markdown(claim_rows(scores)))
