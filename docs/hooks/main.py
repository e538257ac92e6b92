"""What the site takes from elsewhere when it is built, so that it cannot go stale (MkDocs calls the `on_` functions).

A line `{{ what arguments }}` of a page becomes

| line | becomes |
|---|---|
| `{{ table exp1/tables/claims.md }}` | a table of `runs/reference`; with ` | text`, its rows that contain the text |
| `{{ source affmap.gaussian.nll }}` | a function; with ` | text | text`, its lines that contain one of them |
| `{{ readme Glossary }}` | a section of the README, with its links to places of the site |
| `{{ tried }}` | the table of what the tests try |

Blocks of ```` ```math ```` and `` $`...`$ `` are LaTeX and become MathML, which browsers draw without help. Figures and
reports of `runs/reference` are part of the site as `reference/...`, notebooks and the reports of experiments are pages.
"""

import csv
import inspect
import json
import re
from collections.abc import Callable, Iterator
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pygments.formatters import HtmlFormatter

from affmap.report.markdown import text_table

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "runs/reference"

README = ROOT / "README.md"
PLACES = {
    r"docs/(.+?)": r"\1",
    r"notebooks/(\w+)\.ipynb": r"notebooks/\1.md",
    r"runs/reference/(\w+)/report\.md": r"experiments/\1.md",
    r"runs/reference/(.+?)": r"reference/\1",
}
"""Links of the README -> where the site has the same."""

ROOMS = sorted(
    path.parent.name
    for path in (ROOT / "affmap/experiments").glob("*/page.md")
    if (REFERENCE / path.parent.name / "report.md").is_file()
)
"""Experiments with a page of their own and a published report, which is a page of the site."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill the experiments into the navigation."""
    for entry in config.nav or []:
        if "Experiments" in entry:
            entry["Experiments"] = [f"experiments/{name}.md" for name in ROOMS]
    return config


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add what lies outside `docs`, and the colours of code."""
    for path in [*REFERENCE.rglob("figures/*.png"), *REFERENCE.glob("*/report.pdf"), REFERENCE / "bench/bench.png"]:
        place = f"reference/{path.relative_to(REFERENCE).as_posix()}"
        files.append(File.generated(config, place, abs_src_path=str(path)))
    for name in ROOMS:
        text = (
            (REFERENCE / name / "report.md").read_text("utf-8").replace("](figures/", f"](../reference/{name}/figures/")
        )
        report = f"\n[The report as PDF](../reference/{name}/report.pdf)\n"
        files.append(File.generated(config, f"experiments/{name}.md", content=text + report))
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        files.append(File.generated(config, f"notebooks/{path.name}", abs_src_path=str(path)))
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content="\n\n".join(_notebook(path))))
    style = HtmlFormatter(style="default").get_style_defs(".highlight")
    files.append(File.generated(config, "code.css", content=style))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in tables, source lines and formulas that stand by themselves."""
    markdown = re.sub(r"^\{\{ (\w+)(?: (.+))? \}\}$", _filled, markdown, flags=re.M)
    return re.sub(r"^```math\n(.+?)^```$", _formula, markdown, flags=re.M | re.S)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the formulas in sentences into MathML."""
    return re.sub(r"\$<code>(.*?)</code>\$", lambda found: convert(unescape(found[1])), html)


def _filled(line: re.Match[str]) -> str:
    macro = MACROS.get(line[1])
    if not macro:
        return line[0]  # a directive of reports that a page shows
    return macro(*(line[2].split(" | ") if line[2] else ()))


def _formula(block: re.Match[str]) -> str:
    return f'<div class="formula">{convert(" ".join(block[1].split()), display="block")}</div>'


def table(path: str, *texts: str) -> str:
    """A Markdown table of the reference run, or those of its rows that contain all of some texts."""
    head, line, *rows = [row for row in (REFERENCE / path).read_text("utf-8").splitlines() if row.startswith("|")]
    chosen = [row for row in rows if all(text in row for text in texts)]
    if not chosen:
        raise ValueError(f"{path} has no row with {', '.join(texts)}.")
    return "\n".join([head, line, *chosen])


def source(name: str, *texts: str) -> str:
    """A function, or those of its lines that contain one of some texts, under the name of its file."""
    module, path = _split(name)
    thing: Any = import_module(module)
    for part in path.split("."):
        thing = getattr(thing, part)
    lines, _ = inspect.getsourcelines(getattr(thing, "fget", thing))
    chosen = [line for line in lines if not texts or any(text in line for text in texts)]
    missing = [text for text in texts if not any(text in line for line in chosen)]
    if missing:
        raise ValueError(f"{name} has no line with {', '.join(missing)}.")
    indent = min(len(line) - len(line.lstrip()) for line in chosen if line.strip())
    code = "".join(line[indent:] if line.strip() else line for line in chosen)
    return f"`{module.replace('.', '/')}.py`, `{path}`:\n\n```python\n{code}```"


def readme(heading: str) -> str:
    """The text below a heading of the README; for pages in the folder `docs` itself."""
    found = re.search(rf"^## {re.escape(heading)}\n(.+?)(?=^## |\Z)", README.read_text("utf-8"), re.M | re.S)
    if not found:
        raise ValueError(f"README.md has no heading {heading}.")
    text = found[1].strip()
    for pattern, place in PLACES.items():
        text = re.sub(rf"\]\({pattern}\)", rf"]({place})", text)
    return text


def tried() -> str:
    """Attacks on affmap that the tests try, how often, and the outcome: `docs/tried.csv`, which they write."""
    with (ROOT / "docs/tried.csv").open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return text_table(heads, [(attack, f"{int(times):,}", outcome) for attack, times, outcome in rows])


def _split(name: str) -> tuple[str, str]:
    """A dotted name as that of its module and the rest."""
    parts = name.split(".")
    depth = max(d for d in range(1, len(parts)) if ROOT.joinpath(*parts[:d]).with_suffix(".py").is_file())
    return ".".join(parts[:depth]), ".".join(parts[depth:])


def _notebook(path: Path) -> Iterator[str]:
    """The cells of a notebook, and what they have put out, as Markdown."""
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        text = "".join(cell["source"])
        yield text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"
        for output in cell.get("outputs", []):
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                picture = "".join(data["image/png"]).strip()
                yield f'<img alt="what the cell draws" src="data:image/png;base64,{picture}">'
            else:
                yield f"```text\n{''.join(data['text/plain']).rstrip()}\n```"


MACROS: dict[str, Callable[..., str]] = {"table": table, "source": source, "readme": readme, "tried": tried}
