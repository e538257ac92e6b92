"""The directives of a report's page, as tests read them."""

from affmap.report import page
from affmap.report.content import Content
from affmap.results.setting import ReportSettings
from affmap.results.tables import Results


def content_of(results: Results, settings: ReportSettings) -> Content:
    """What a page can say of results without claims and figures."""
    return Content("Title", None, results, (), settings, (), {}, {})


def table_of(markdown: str) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the only table of a text."""
    (table,) = page.parse(markdown)
    heads, *rows = ([page.plain(cell) for cell in row] for row in (table["head"], *table["rows"]))
    return heads, rows
