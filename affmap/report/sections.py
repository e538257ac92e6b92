"""The sections of an experiment's report: tables, figures, PDF and HTML.

`deviations.md` says what differs from the paper; it knows no result.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from affmap.report import blocks, build, content, figures, page
from affmap.report.experiment import ExperimentReport
from affmap.report.explorer.maps import explorer
from affmap.report.player.runs import player
from affmap.results import provenance
from affmap.results.claims import Score
from affmap.results.scores import as_table, medians, score
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results, write_csv, write_runs


def write(report: ExperimentReport) -> None:
    """Write tables, figures and pages into the report's folder."""
    output, results, settings = report.output, report.results, report.settings
    scores = score(results, report.claims)
    _write_tables(output / "tables", report.name, results, scores, settings)
    captions = figures.draw_all(results, settings, output / "figures", report.notice)
    content = _blocks(results, scores, settings, captions, report.record)
    page.write(output, {"title": report.title, "notice": report.notice or "", "blocks": content})


def deviations(reports: Sequence[Results]) -> blocks.Block:
    """What differs from the paper in what was run, and why."""
    return blocks.points(provenance.fill((Path(__file__).parent / "deviations.md").read_text("utf-8"), reports))


def _write_tables(folder: Path, name: str, results: Results, scores: Sequence[Score], settings: ReportSettings) -> None:
    write_runs(folder, name, results.runs)
    write_csv(folder / "validation.csv", results.validation)
    write_csv(folder / "steps.csv", results.steps)
    if results.baselines:
        write_csv(folder / "baselines.csv", results.baseline_runs)
    write_csv(folder / "medians.csv", medians(results, settings))
    if scores:
        write_csv(folder / "claims.csv", as_table(scores))
        build.write_text(folder / "claims.md", content.claims_markdown(content.claim_rows(scores)))


def _blocks(
    results: Results,
    scores: Sequence[Score],
    settings: ReportSettings,
    captions: Mapping[str, str],
    record: dict[str, Any],
) -> list[blocks.Block]:
    def shown(*names: str) -> list[blocks.Block]:
        return content.figures(names, captions)

    return [
        *content.experiment(results, scores, settings),
        blocks.heading("Results"),
        blocks.paragraph(content.MAIN_FIGURES),
        *shown("results", "trajectories"),
        blocks.heading(content.LOOK_CLOSER),
        player(results, settings),
        *filter(None, [explorer(results, settings)]),
        *content.tests(scores, results),
        *content.predictions(results, settings),
        *shown("steps"),
        *content.medians(results, settings),
        *content.baselines(results, settings),
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
