"""The pages of the experiments: their published reports."""

from collections.abc import Iterator
from pathlib import Path

from places import REFERENCE, ROOT


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each experiment with a page of its own and a published report."""
    for room in sorted((ROOT / "affmap/experiments").glob("*/page.md")):
        name = room.parent.name
        report = REFERENCE / name / "report.md"
        if report.is_file():
            text = report.read_text("utf-8").replace("](figures/", f"](../reference/{name}/figures/")
            yield f"experiments/{name}.md", f"{text}\n[The report as PDF](../reference/{name}/report.pdf)\n"


def files() -> list[Path]:
    """What pages show of the published run."""
    return [*REFERENCE.rglob("figures/*.png"), *REFERENCE.glob("*/report.pdf"), REFERENCE / "bench/bench.png"]
