"""Completed stages -> one folder with the report: PDF, figures, tables and provenance.

`report.typ` beside this file is the PDF's layout, `deviations.typ` its section on what differs from the paper. Neither
knows a result; the same stages give the same bytes.
"""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import typst

from affmap.report import captions, claims, figures, provenance, statistics
from affmap.report.captions import effect
from affmap.report.claims import Score
from affmap.report.tables import Job, Results, write_csv, write_runs
from affmap.report.text import NOTHING, number, p_value

_HERE = Path(__file__).parent

_PLANNER_NAMES = {"cem": "EB (evolutionary-based)", "gradient": "GB (gradient-based)"}

_RULE = (
    "Tests are paired by member; a member's score is its mean over its runs. Trends over context sizes: Page's "
    "trend test (Wilcoxon's signed-rank test where only two sizes were run); two conditions: Wilcoxon's "
    f"signed-rank test. A claim holds when the one-sided p in its direction is below {statistics.LEVEL}, does not "
    "hold when the one-sided p in the opposite direction is, and is not decided otherwise. Intervals: BCa "
    "bootstrap of the mean over members. The p values are not corrected for the number of claims. sd: standard "
    "deviation of a member's own map. A claim of two parts holds when both do."
)

_RANGES = (
    "The paper prints no result as text; the ticks of its figures' axes are the only numbers. A median inside them "
    "is consistent with the paper, not more; a star marks those outside. Whether the paper's likelihoods include "
    "the constant log 2π (1.84 nats for two coordinates) is unknown; ours are the full density."
)


def write(output: Path, jobs: Sequence[Job], *, title: str, command: str, notice: str | None) -> Path:
    """Write the report about the given settings.

    Args:
        output: folder for `report.pdf`, `figures/`, `tables/` and `provenance.json`; made where it is missing.
        jobs: the settings and the folders of their completed stages.
        title: heads the document.
        command: what a reader types to get this report.
        notice: warning to the reader, put on every figure and page, such as that of a smoke run; or None.

    Returns:
        The path of the PDF. Where it is there already, made from the same stages by the same code, nothing is done.
    """
    results = Results(tuple(jobs))
    origin = {"title": title, "notice": notice, "report": command, "code": _code(), **provenance.summarize(results)}
    origin_text = json.dumps(origin, indent=1, ensure_ascii=False) + "\n"
    origin_path, path = output / "provenance.json", output / "report.pdf"
    if path.is_file() and origin_path.is_file() and origin_path.read_text("utf-8") == origin_text:
        return path  # the same stages, drawn by the same code
    scores = claims.score(results)
    _write_tables(output / "tables", results, scores)
    drawn = figures.draw_all(results, output / "figures", notice)
    texts = captions.captions(results, scores)
    data = {
        "title": title,
        "notice": notice or "",
        "figures": {name: {"caption": texts[name], "width": width} for name, width in drawn.items()},
        "deviations": provenance.fill((_HERE / "deviations.typ").read_text("utf-8"), results),
        **_sections(results, scores),
        **_origin(origin),
    }
    path.write_bytes(compile_document(data, output))
    _write_text(origin_path, origin_text)  # last: what is there when this is there is whole
    return path


def _code() -> str:
    """A digest of this package's own files."""
    files = sorted(path for path in _HERE.iterdir() if path.suffix in (".py", ".typ"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def compile_document(data: dict[str, Any], root: Path) -> bytes:
    """Set the PDF with Typst's embedded fonts only; `root` holds the `figures` folder."""
    compiler = typst.Compiler(
        (_HERE / "report.typ").read_bytes(), root=root, ignore_system_fonts=True, sys_inputs={"data": json.dumps(data)}
    )
    pdf = compiler.compile(format="pdf")
    assert isinstance(pdf, bytes)  # a list of them is for formats with a file per page
    return pdf


def claims_markdown(scores: Sequence[Score]) -> str:
    """The claims as a Markdown table."""
    lines = [
        "| claim | statement | effect [95 % interval] | p | p opposite | verdict |",
        "|---|---|---|---|---|---|",
    ]
    for row in _claim_rows(scores):
        cells = (row[key] for key in ("name", "statement", "effect", "p", "opposite", "verdict"))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _write_tables(folder: Path, results: Results, scores: Sequence[Score]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_runs(folder, results.runs)
    tables = {
        "validation": results.validation,
        "claims": claims.as_table(scores),
        "medians": claims.medians(results),
    }
    for name, table in tables.items():
        write_csv(folder / f"{name}.csv", table)
    _write_text(folder / "claims.md", claims_markdown(scores))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, "utf-8", newline="\n")


def _claim_rows(scores: Sequence[Score]) -> list[dict[str, str]]:
    """One row per claim, or per part followed by the whole where a claim has several; all cells are text."""
    rows = []
    for item in scores:
        several = len(item.parts) > 1
        for part in item.parts:
            outcome = part.outcome
            detail = [part.effect_of, f"{outcome.test}, {outcome.members} members", outcome.note]
            rows.append(
                {
                    "name": f"{item.claim.name} {part.name}".strip(),
                    "statement": part.statement if several else item.claim.statement,
                    "detail": "; ".join(filter(None, detail)),
                    "effect": effect(outcome, item.claim.unit),
                    "p": p_value(outcome.p),
                    "opposite": p_value(outcome.p_opposite),
                    "verdict": outcome.verdict.value,
                }
            )
        if several:
            whole = {"name": item.claim.name, "statement": item.claim.statement, "detail": "all parts together"}
            rows.append(whole | {"effect": NOTHING, "p": NOTHING, "opposite": NOTHING, "verdict": item.verdict.value})
    return rows


def _sections(results: Results, scores: Sequence[Score]) -> dict[str, Any]:
    """Texts and tables of the results; all cells are text."""
    return {
        "count": captions.verdict_count(scores),
        "changes": captions.changes(results),
        "findings": [*captions.findings(scores), captions.spikes(results)],
        "setting": _setting(results),
        "costs": [[stage, str(folders), number(seconds, 0)] for stage, folders, seconds in provenance.costs(results)],
        "rule": _RULE,
        "claims": _claim_rows(scores),
        "ranges": _RANGES,
        "context_sizes": results.context_sizes,
        "medians": _median_rows(results),
    }


def _median_rows(results: Results) -> list[list[str]]:
    """One row per metric and planner, one column per context size; medians outside the paper's axis have a star."""
    table = claims.medians(results)
    stars = table["inside"].map({True: "", False: " *"})
    table["shown"] = table["median"].map(number) + stars
    rows = []
    for _, group in table.groupby(["metric", "planner"], sort=False):
        first = group.iloc[0]
        label = f"{first['metric'].replace('_', ' ').replace('nll', 'NLL')} ({first['unit']})"
        medians = group.set_index("context_size")["shown"].reindex(results.context_sizes, fill_value=NOTHING)
        axis = f"{number(first['paper_low'], 1)} to {number(first['paper_high'], 1)}"
        rows.append([label, first["planner"] or NOTHING, _span(group["number"]), *medians, axis])
    return rows


def _setting(results: Results) -> str:
    """What was run, in a sentence."""
    members = results.last_epoch.groupby("context_size")["member"].nunique()
    epochs = results.last_epoch["epoch"].unique()
    sizes = ", ".join(map(str, results.context_sizes))
    planners = " and ".join(_PLANNER_NAMES[planner] for planner in results.planners)
    memory = max(record["peak_memory_mib"] for record in results.provenance.values())
    seconds = sum(seconds for _, _, seconds in provenance.costs(results))
    return (
        f"Context sizes {sizes}; {_span(members)} members each, trained for {_span(pd.Series(epochs))} epochs; "
        f"planners: {planners}; {len(results.runs)} runs of control in total, in the world “{results.world.name}”. "
        f"All stages together took {number(seconds / 60, 1)} process minutes; the largest process used "
        f"{number(memory, 0)} MiB."
    )


def _span(values: "pd.Series[int]") -> str:
    return str(values.min()) if values.min() == values.max() else f"{values.min()} to {values.max()}"


def _origin(origin: dict[str, Any]) -> dict[str, Any]:
    """The provenance as the PDF shows it; all cells are text."""
    lines = [["Command", origin["report"]]]
    lines += [[name.capitalize(), _plain(value)] for name in ("git", "versions", "machine") for value in origin[name]]
    rows = [
        [
            stage["stage"],
            stage["digest"][:12],
            str(stage["started"]),
            number(stage["seconds"], 0),
            _setting_of(stage["differs"]),
        ]
        for stage in origin["stages"]
    ]
    return {"provenance": lines, "stages": rows}


def _setting_of(differs: dict[str, Any]) -> str:
    """What tells a stage from the first of its kind; `provenance.json` has every difference."""
    names = {"model.context_size": "context size", "planner.kind": "planner", "lookup.spacing": "look-up"}
    return ", ".join(f"{name} {differs[key]}" for key, name in names.items() if key in differs) or NOTHING


def _plain(value: Any) -> str:
    return ", ".join(f"{key} {item}" for key, item in value.items()) if isinstance(value, dict) else str(value)
