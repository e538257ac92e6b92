"""Completed stages -> one folder with the report: PDF, HTML, figures, tables and provenance.

The same stages give the same bytes. `deviations.md` says what differs from the paper; it knows no result.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from affmap.report import (
    blocks,
    captions,
    claims,
    comparison,
    content,
    explorers,
    figures,
    players,
    provenance,
    rendering,
    sealed,
)
from affmap.report.claims import Score
from affmap.report.groups import make_groups
from affmap.report.settings import ReportSettings
from affmap.report.tables import Results, write_csv, write_runs
from affmap.settings import ConfigError


def write(
    output: Path,
    results: Results,
    settings: ReportSettings,
    *,
    name: str,
    title: str,
    command: str,
    notice: str | None,
) -> Path:
    """Write the report about an experiment.

    Args:
        output: folder for `report.pdf`, `report.html`, `figures/`, `tables/` and `provenance.json`; made where it is
            missing.
        results: the completed stages.
        settings: what is to be shown and tested.
        name: of the experiment.
        title: heads the document.
        command: what a reader types to get this report.
        notice: warning to the reader, put on every figure and page, such as that of a smoke run; or None.

    Returns:
        The path of the PDF. Where it is there already, made from the same stages by the same code, nothing is done.

    Raises:
        ConfigError: there are several planners and several layouts, or the folder holds a comparison.
    """
    if comparison.KEY in sealed.read(output):
        raise ConfigError(f"{output} holds a comparison; say output=runs/<name> for a report.")
    make_groups(results, settings)  # refuses what cannot be told apart, before anything is written
    record = {
        "name": name,
        "title": title,
        "notice": notice,
        "report": command,
        "settings": {name: getattr(settings, name) for name in sorted(ReportSettings.model_fields)},
        **provenance.summarize(results.jobs, results.provenance),
    }
    path = output / "report.pdf"
    if sealed.is_sealed(output, record):
        return path
    scores = claims.score(results, settings.claims)
    _write_tables(output / "tables", name, results, scores, settings)
    drawn = figures.draw_all(results, settings, output / "figures", notice)
    data = {
        "title": title,
        "notice": notice or "",
        "blocks": _blocks(results, scores, settings, drawn, record),
    }
    rendering.write(output, data)
    sealed.seal(output, record)
    return path


def check(output: Path, results: Results) -> None:
    """Make sure that the report in a folder is that of some results.

    Raises:
        ConfigError: it is not, or there is none.
    """
    if provenance.digests(output) != {record["digest"] for record in results.provenance.values()}:
        raise ConfigError(f"{output} holds no report of these results; run affmap-report for them first.")


def deviations(reports: Sequence[Results]) -> blocks.Block:
    """What differs from the paper in what was run, and why."""
    return blocks.points(provenance.fill((sealed.HERE / "deviations.md").read_text("utf-8"), reports))


def write_text(path: Path, text: str) -> None:
    """Write a text with the same bytes on every machine."""
    path.write_text(text, "utf-8", newline="\n")


def _write_tables(folder: Path, name: str, results: Results, scores: Sequence[Score], settings: ReportSettings) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_runs(folder, name, results.runs)
    write_csv(folder / "validation.csv", results.validation)
    write_csv(folder / "medians.csv", claims.medians(results, settings))
    if scores:
        write_csv(folder / "claims.csv", claims.as_table(scores))
        write_text(folder / "claims.md", content.claims_markdown(content.claim_rows(scores)))


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
        players.player(results, settings),
        *filter(None, [explorers.explorer(results, settings)]),
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
        content.stages(record),
    ]
