"""The reports of all experiments of the paper -> one: what holds, what does not, and what it took.

It shows the figures that the experiments' own reports have drawn, and tests their claims again.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from affmap.report import blocks, captions, claims, content, provenance, rendering, sealed, sentences
from affmap.report.blocks import Block
from affmap.report.claims import Score
from affmap.report.document import check, deviations, write_text
from affmap.report.settings import ReportSettings
from affmap.report.tables import Results, write_csv
from affmap.report.text import NOTHING, number, p_value, points

TITLE = "Affordances and active motor control: the paper's experiments"

FIGURES = ("results", "trajectories", "maps", "growth", "failures", "world")
"""Those shown of each experiment, where it has them."""


class Part(NamedTuple):
    """One experiment."""

    title: str
    results: Results
    settings: ReportSettings
    output: Path
    """Folder of its own report."""
    missing: str
    """A sentence on what has not been run; empty where all is there."""


def write(output: Path, parts: Sequence[Part], *, command: str, notice: str | None) -> Path:
    """Write the report about all experiments.

    Args:
        output: folder for `report.pdf`, `report.html`, `figures/`, `tables/` and `provenance.json`; made where it is
            missing.
        parts: the experiments in their order.
        command: what a reader types to get this report.
        notice: warning to the reader, or None.

    Returns:
        The path of the PDF. Where it is there already, made from the same stages by the same code, nothing is done.

    Raises:
        ConfigError: the report of an experiment is not that of its results.
    """
    for part in parts:
        check(part.output, part.results)
    record = _record(parts, command, notice)
    path = output / "report.pdf"
    if sealed.is_sealed(output, record):
        return path
    scores = [claims.score(part.results, part.settings.claims) for part in parts]
    _write_tables(output / "tables", parts, scores)
    drawn = [_copy_figures(part, output / "figures") for part in parts]
    data = {"title": TITLE, "notice": notice or "", "blocks": _blocks(parts, scores, drawn, record)}
    rendering.write(output, data)
    sealed.seal(output, record)
    return path


def _record(parts: Sequence[Part], command: str, notice: str | None) -> dict[str, Any]:
    experiments = {
        part.output.name: {
            "title": part.title,
            "missing": part.missing,
            "settings": {name: getattr(part.settings, name) for name in sorted(ReportSettings.model_fields)},
            **provenance.summarize(part.results.jobs, part.results.provenance),
        }
        for part in parts
    }
    return {"title": TITLE, "notice": notice, "report": command, "experiments": experiments}


def _write_tables(folder: Path, parts: Sequence[Part], scores: Sequence[Sequence[Score]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    tables = []
    for part, found in zip(parts, scores, strict=True):
        table = claims.as_table(found)
        table.insert(0, "experiment", part.output.name)
        table["missing"] = part.missing
        tables.append(table)
    write_csv(folder / "claims.csv", pd.concat(tables))
    rows = _rows(parts, scores)
    marked = [row | {"statement": row["statement"] + (" (So far.)" if row["detail"] else "")} for row in rows]
    write_text(folder / "claims.md", content.claims_markdown(marked))


def _rows(parts: Sequence[Part], scores: Sequence[Sequence[Score]]) -> list[dict[str, str]]:
    """One row for each claim."""
    return [_short(item, part) for part, some in zip(parts, scores, strict=True) for item in some]


def _copy_figures(part: Part, folder: Path) -> list[str]:
    """Take over the figures of an experiment's own report, into a folder of its own; returns their names."""
    target = folder / part.output.name
    shutil.rmtree(target, ignore_errors=True)  # a figure may have been drawn in other formats
    target.mkdir(parents=True, exist_ok=True)
    names = [name for name in FIGURES if (part.output / "figures" / f"{name}.pdf").is_file()]
    for name in names:
        for path in (part.output / "figures").glob(f"{name}.*"):
            shutil.copyfile(path, target / path.name)
    return names


def _blocks(
    parts: Sequence[Part],
    scores: Sequence[Sequence[Score]],
    drawn: Sequence[Sequence[str]],
    record: dict[str, Any],
) -> list[Block]:
    found: list[Block] = [blocks.alert(f"{part.title}: {part.missing}") for part in parts if part.missing]
    together = [item for some in scores for item in some]
    found += [
        blocks.paragraph(
            f"{sentences.verdict_count(together, 'its experiments')} How this was decided, and every part of these "
            "claims, is said below the experiments; the p of a claim of several parts is the largest of theirs. The "
            "pages of the experiments' own reports play their runs and tell the codes of their maps."
        ),
        blocks.claims(_rows(parts, scores)),
        blocks.heading("What was run, and what it took"),
        *_costs(parts),
    ]
    for part, some, names in zip(parts, scores, drawn, strict=True):
        found += _experiment(part, some, names)
    return [
        *found,
        blocks.heading("How it was decided"),
        blocks.paragraph(content.RULE),
        blocks.paragraph(content.RANGES),
        blocks.claims([row for some in scores for row in content.claim_rows(some)]),
        blocks.heading("Where this differs from the paper, and why"),
        deviations([part.results for part in parts]),
        blocks.heading("What did not reproduce in the reference run, and why"),
        blocks.points(points((sealed.HERE / "causes.md").read_text("utf-8"))),
        blocks.heading("Provenance"),
        content.origins(list(record["experiments"].values()), record["report"]),
        blocks.paragraph("Every stage is listed in the experiments' own reports, and in provenance.json."),
    ]


def _short(item: Score, about: Part) -> dict[str, str]:
    """A claim in a row; where it has several parts, the largest p of all is that of the whole."""
    counting = [part for part in item.parts if part.counts]
    single = counting[0] if len(counting) == 1 else None
    p = [part.outcome.p for part in counting]
    return {
        "name": item.claim.name,
        "statement": item.claim.statement,
        "detail": "so far: not all settings have been run" if about.missing else "",
        "effect": sentences.effect(single.outcome, single.unit) if single else f"{len(counting)} parts",
        "p": NOTHING if None in p else p_value(max(value for value in p if value is not None)),
        "opposite": p_value(single.outcome.p_opposite) if single else NOTHING,
        "verdict": item.verdict.value,
    }


def _costs(parts: Sequence[Part]) -> list[Block]:
    """Process minutes of each experiment and kind of stage."""
    tables = provenance.costs([part.results for part in parts])
    rows = [
        [part.title, str(len(part.results.runs)), *(_minutes(cost) for cost in costs), _total(costs)]
        for part, costs in zip(parts, tables, strict=True)
    ]
    everything = [cost for costs in tables for cost in costs]
    each = [[cost for cost in everything if cost.stage == stage.stage] for stage in tables[0]]
    rows.append(["All", "", *(_total(costs) for costs in each), _total(everything)])
    records = [record for part in parts for record in part.results.provenance.values()]
    cores = sorted({record["machine"]["cores"] for record in records})
    return [
        blocks.paragraph(
            "Minutes on the clock of every process, all attempts together; in brackets the number of "
            "processes. What two experiments share is counted with the first. A process has one thread unless "
            f"configured otherwise; the machine had {' or '.join(map(str, cores))} cores, and other processes may "
            "have been running beside these."
        ),
        blocks.table(
            ["Experiment", "Runs", *(cost.stage.capitalize() for cost in tables[0]), "Together"], rows, wide=0
        ),
    ]


def _minutes(cost: provenance.Cost) -> str:
    return f"{number(cost.seconds / 60, 1)} ({cost.folders})" if cost.folders else NOTHING


def _total(costs: Sequence[provenance.Cost]) -> str:
    return number(sum(cost.seconds for cost in costs) / 60, 1)


def _experiment(part: Part, scores: Sequence[Score], names: Sequence[str]) -> list[Block]:
    texts = captions.captions(part.results, scores, part.settings)
    return [
        blocks.heading(part.title),
        *([blocks.alert(part.missing)] if part.missing else []),
        blocks.paragraph(sentences.setting(part.results)),
        blocks.bullets(
            [
                *sentences.findings(scores),
                *sentences.uncrossable(part.results, part.settings),
                sentences.spikes(part.results),
            ]
        ),
        *content.figures(names, names, texts, f"{part.output.name}/"),
        *content.medians(part.results, part.settings, level=2),
    ]
