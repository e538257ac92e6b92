"""The report of an experiment: what it is made of. `sections` writes it, from completed stages.

The same stages give the same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from affmap.results import provenance
from affmap.results.claims import Claim
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


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
        from affmap.report import sections  # drawing takes seconds to import

        sections.write(self)
