"""The pages of the experiments: their published reports."""

from collections.abc import Iterator
from pathlib import Path

from links import translate
from places import REFERENCE, ROOT

from affmap.experiments import by_number


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each experiment with a page of its own and a published report."""
    rooms = (path.parent.name for path in (ROOT / "affmap/experiments").glob("*/page.md"))
    for name in sorted(rooms, key=by_number):
        report = REFERENCE / name / "report.md"
        if report.is_file():
            text = f"{report.read_text('utf-8')}\n[The report as PDF](report.pdf)\n"
            yield f"experiments/{name}.md", translate(text, f"runs/reference/{name}", "experiments")


def files() -> list[Path]:
    """What pages show of the published run."""
    return [*REFERENCE.rglob("figures/*.png"), *REFERENCE.glob("*/report.pdf"), REFERENCE / "bench/bench.png"]
