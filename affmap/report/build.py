"""Writer of all reports: draws a folder again when it is out of date, writes and checks its manifest."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from affmap.report.markdown import code, escape
from affmap.results import manifest
from affmap.settings.messages import ConfigError
from affmap.store.files import named_errors

KINDS = {"compare": "a comparison", "trials": "a search", "experiments": "a report of the paper", "jobs": "a report"}
"""Key of a manifest that identifies the kind of report -> the name of the kind."""


class Report(Protocol):
    """One kind of report, about some results."""

    @property
    def output(self) -> Path:
        """Its folder: `report.pdf` and `report.html` where it has pages, `figures`, `tables`, `provenance.json`."""
        ...

    @property
    def record(self) -> Mapping[str, Any]:
        """Everything that the report depends on, except the code that draws it, as a plain value for the manifest."""
        ...

    @property
    def notice(self) -> str | None:
        """A notice on every figure, such as that of a smoke run or of a part; None for results."""
        ...

    @property
    def page(self) -> Path:
        """The file to open first."""
        ...

    def draw(self, folder: Path) -> None:
        """Write tables, figures and pages into an empty folder beside `output`, from where they are moved."""
        ...


def write(report: Report) -> Path:
    """Write a report and its manifest; returns the file to open first.

    Does nothing if the folder already holds this report, of the same results and by the same code. An interruption
    leaves the earlier report, or one without a manifest, which the next call makes anew.

    Raises:
        ConfigError: the folder holds a report of another kind.
    """
    record = report.record
    there, kind = _kind(manifest.read_intact(report.output)), _kind(record)
    if there not in (None, kind):
        raise ConfigError(f"{report.output} holds {KINDS[there]}; say output=runs/<name> for {KINDS[kind]}.")
    if not manifest.is_current(report.output, record):
        drawn = report.output.with_name(f".{report.output.name}.drawn")
        shutil.rmtree(drawn, ignore_errors=True)
        drawn.mkdir(parents=True)
        try:
            report.draw(drawn)
            manifest.write(report.output, record, drawn)
        finally:
            shutil.rmtree(drawn, ignore_errors=True)
    return report.page


def check(report: Report) -> None:
    """Check that the folder of a report holds it, whatever code drew it.

    Raises:
        ConfigError: the folder holds a report of other results, or none.
    """
    if not manifest.same_results(manifest.read(report.output), report.record):
        kind = KINDS[_kind(report.record)]
        raise ConfigError(f"{report.output} holds no {kind[2:]} of these results; run affmap-report for them first.")


def markdown_page(path: Path, title: str, notice: str | None, command: str, text: str) -> None:
    """Write a page in Markdown: title, notice, the command that makes it, and its text."""
    heading = f"**{escape(notice)}**\n\n" if notice else ""
    write_text(path, f"# {escape(title)}\n\n{heading}{code(command)}\n\n{text}")


def write_text(path: Path, text: str) -> None:
    """Write a text with the same bytes on every machine."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with named_errors(path):
        path.write_text(text, "utf-8", newline="\n")


def _kind(record: Mapping[str, Any]) -> Any:
    """Key of `KINDS` that a manifest has; None for an empty manifest."""
    return next((key for key in KINDS if key in record), "jobs") if record else None
