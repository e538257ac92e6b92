"""The directives of an experiment's page: results, tests and their origin as Markdown."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from affmap.env.effects import EFFECTS
from affmap.report import sentences
from affmap.report.drawing.colors import name_of, names_of, readable
from affmap.report.markdown import bullets, escape, table, text_table
from affmap.report.painted import first_settings
from affmap.results import provenance, scores
from affmap.results.blocks import together
from affmap.results.claims import Score
from affmap.results.files import EVERYWHERE
from affmap.results.halo import UNCERTAIN, WIDTH, beyond, halo
from affmap.results.metrics import METRICS
from affmap.results.numbers import NOTHING, number, p_value, span
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Factor, ReportSettings
from affmap.results.statistics import FEW_MEMBERS, LEVEL
from affmap.results.tables import Results
from affmap.settings import ConfigError

DEVIATIONS = Path(__file__).parent / "deviations.md"
"""Differences from the paper, with placeholders for values of the configuration."""


@dataclass(frozen=True)
class Content:
    """Contents of an experiment's page: `{{ name argument }}` stands for the Markdown that the method `name` returns.

    A method returns an empty text if the results have nothing to show.
    """

    heading: str
    warning: str | None
    results: Results
    scores: Sequence[Score]
    settings: ReportSettings
    figures: Collection[str]
    """Names of all figures, drawn or not."""
    captions: Mapping[str, str]
    """Name of a figure -> its caption, for all figures that were drawn."""
    record: Mapping[str, Any]
    """Result of `provenance.summarize`, with the command as `report`."""
    folder: str = "figures"
    """Folder of the figures, relative to the page."""

    def title(self) -> str:
        """Title of the experiment."""
        return escape(self.heading)

    def notice(self) -> str:
        """A warning to the reader, such as that of a smoke run."""
        return alert(self.warning)

    def verdicts(self) -> str:
        """Numbers of claims that hold, do not hold, are not decided, and are not tested."""
        return escape(sentences.verdict_count(self.scores)) if self.scores else ""

    def summary(self) -> str:
        """Main results, one sentence each."""
        results, settings = self.results, self.settings
        return bullets(
            escape(sentence)
            for sentence in (
                *sentences.changes(results, settings),
                *sentences.diverged(results),
                *sentences.bounds(results, settings),
                *sentences.mixtures(results, settings),
                *sentences.uncrossable(results, settings),
                *sentences.remarks(self.scores),
            )
        )

    def setting(self) -> str:
        """Context sizes, members, epochs, layouts and costs."""
        return escape(sentences.setting(self.results))

    def costs(self) -> str:
        """Number of folders and seconds of each kind of stage."""
        (costs,) = provenance.costs([self.results])
        rows = [[cost.stage, str(cost.folders), number(cost.seconds, 0)] for cost in costs]
        return text_table(["Stage", "Folders", "Seconds in total, all attempts together"], rows)

    def findings(self) -> str:
        """Claims with their verdicts and effects, one sentence each."""
        return bullets(map(escape, sentences.findings(self.scores)))

    def spikes(self) -> str:
        """Frequency of spikes in the validation losses."""
        return escape(sentences.spikes(self.results))

    def level(self) -> str:
        """Level of significance of the tests."""
        return f"{LEVEL}"

    def few(self) -> str:
        """Number of members below which intervals are Student's."""
        return f"{FEW_MEMBERS}"

    def claims(self) -> str:
        """Table of the claims, their parts, tests and verdicts."""
        return claims_table(claim_rows(self.scores)) if self.scores else ""

    def figure(self, name: str) -> str:
        """Figure with its caption."""
        if name not in self.figures:
            raise ConfigError(f"there is no figure {name!r}; there are: {', '.join(sorted(self.figures))}.")
        if name not in self.captions:
            return ""
        return f"![{name}]({self.folder}/{name}.png)\n\n*{escape(self.captions[name])}*"

    def player(self) -> str:
        """Place of the player of runs, in HTML only."""
        return "<!-- player -->"

    def explorer(self) -> str:
        """Place of the explorer of affordance maps, in HTML only."""
        return "<!-- explorer -->"

    def medians(self) -> str:
        """Medians and means of each setting beside the paper's axes; values outside the axes are starred."""
        results, settings = self.results, self.settings
        others = _other_factors(results)
        values = [name_of(results.x, value, settings) for value in results.x_values]
        axes = ["Paper's axis"] if settings.axes else []
        heads = ["", *(factor.label.capitalize() for factor in others), "Values", *values, *axes]
        return text_table(heads, _median_rows(results, settings, others))

    def axes(self) -> str:
        """Explanation of the paper's axes; empty if these are not known."""
        return escape(sentences.AXES) if self.settings.axes else ""

    def steps(self) -> str:
        """Validation losses by kind of step, at the end of training."""
        results, settings = self.results, self.settings
        factor = results.training_factor
        others = [column for column in results.trainings if column != factor.column]
        steps = results.steps
        last = steps[steps["epoch"] == steps.groupby(results.trainings)["epoch"].transform("max")]
        values = list(dict.fromkeys(last[factor.column]))
        keys = [*(column for column in others if last[column].nunique() > 1), "world", "kind"]
        if last["world"].nunique() == 2:  # one world, and the same steps as "everywhere"
            last = last[last["world"] == EVERYWHERE]
            keys.remove("world")
        labels = {factor.column: factor.label for factor in (results.x, results.color)}
        rows = []
        for names, group in last.groupby(keys, sort=False):
            centers = group.groupby(factor.column)[["median", "mean"]].median().reindex(values)
            cells = [f"{number(row['median'])}, {number(row['mean'])}" for _, row in centers.iterrows()]
            rows.append([*(readable(str(name), settings) for name in names), span(group["steps"]), *cells])
        heads = [
            *(labels.get(key, key).capitalize() for key in keys),
            "Steps",
            *(name_of(factor, value, settings) for value in values),
        ]
        return text_table(heads, rows)

    def uncertain(self) -> str:
        """Predicted standard deviation above which a position counts as mistaken for fog, u."""
        return f"{UNCERTAIN:g}"

    def halo(self) -> str:
        """Share of positions outside fog that each training's models mistake for fog; empty if maps show no fog."""
        results, factor = self.results, self.results.training_factor
        values = results.context_sizes if factor == CONTEXT_SIZE else results.x_values
        settings = {value: results.where({factor.key: value})[0] for value in values}
        layouts = {value: results.map_layout(setting) for value, setting in settings.items()}
        if not any(circle.effect == "fog" for layout in layouts.values() for circle in layout.circles):
            return ""
        rows = [[f"up to {WIDTH:g} u outside fog"], ["farther away"]]
        for value, setting in settings.items():
            place = results.deviations(setting), layouts[value], results.vehicle_radius(setting)
            for row, shares in zip(rows, (halo(*place), beyond(*place)), strict=True):
                row.append(f"{np.mean(shares):.0%}")
        return text_table(["Places", *names_of(factor, values, self.settings).values()], rows)

    def blocks(self) -> str:
        """Share of the members in which one block has the largest part in two effects; empty without blocks."""
        results, factor = self.results, self.results.training_factor
        settings = first_settings((setting for setting in results.settings if setting.blocks), "blocks")
        if not settings:
            return ""
        columns = [together(results.shares(setting)) for setting in settings]
        heads = [name_of(factor, setting.values[factor.key], self.settings) for setting in settings]
        rows = [
            [" and ".join(EFFECTS[effect].label for effect in pair), *(f"{column[pair]:.0%}" for column in columns)]
            for pair in columns[0].index
        ]
        return text_table(["Largest part in one block", *heads], rows)

    def baselines(self) -> str:
        """Results of agents without a learned model on the same runs; empty if there are none."""
        runs, settings = self.results.baseline_runs, self.settings
        if runs.empty:
            return ""
        metrics = list(dict.fromkeys(["prediction_error", settings.outcome, "reached", "steps_touching"]))
        heads = [f"{scores.statistic(metric)} {METRICS[metric].name} ({METRICS[metric].unit})" for metric in metrics]
        rows = [
            [str(agent), readable(str(layout), settings), str(len(group))]
            + [number(scores.center(group[metric], metric)) for metric in metrics]
            for (agent, layout), group in runs.groupby([PLANNER.column, LAYOUT.column], sort=False)
        ]
        return text_table(["Agent", "Layout", "Runs", *heads], rows)

    def deviations(self) -> str:
        """Deviations from the paper, with reasons."""
        return deviations([self.results])

    def origins(self) -> str:
        """Command, commit, versions and machine."""
        return origins([self.record], self.record["report"])

    def stages(self) -> str:
        """Table of all stages behind the results."""
        factors = [self.results.x, self.results.color]
        rows = [
            [
                stage["stage"],
                stage["digest"][:12],
                str(stage["started"]),
                number(stage["seconds"], 0),
                provenance.setting_of(stage["differs"], factors),
            ]
            for stage in self.record["stages"]
        ]
        return text_table(["Stage", "Digest", "Started", "Seconds", "Setting"], rows)


def alert(warning: str | None) -> str:
    """Paragraph that stands out, empty without a warning."""
    return f"**{escape(warning)}**" if warning else ""


def deviations(reports: Sequence[Results]) -> str:
    """List of deviations from the paper, with reasons."""
    return bullets(f"**{title}** {text}" for title, text in provenance.fill(DEVIATIONS.read_text("utf-8"), reports))


def origins(records: Sequence[Mapping[str, Any]], command: str) -> str:
    """List of the command, commits, versions, machines and modules of users behind some results, each value once.

    Args:
        records: results of `provenance.summarize`.
        command: the command that makes the report.
    """
    lines = [("Command", command)]
    for name in ("git", "versions", "machine"):
        values = provenance.distinct([value for record in records for value in record[name]])
        lines += [(name.capitalize(), _plain(value)) for value in values]
    outside = provenance.distinct([each for record in records for each in record.get("extensions", ())])
    lines += [("Not of affmap", _describe_origin(each)) for each in outside]
    return bullets(f"**{name}:** {escape(text)}" for name, text in lines)


def claim_rows(scores: Sequence[Score]) -> list[dict[str, str]]:
    """One row per claim, or per part followed by the whole where a claim has several; all cells are text."""
    rows = []
    for item in scores:
        several = len(item.parts) > 1
        for part in item.parts:
            outcome = part.outcome
            remark = "" if several else item.claim.remark
            details = [part.effect_of, f"{outcome.test}, {outcome.members} members", outcome.note, remark]
            rows.append(
                {
                    "name": f"{item.claim.name} {part.name}".strip(),
                    "statement": part.statement if several else item.claim.statement,
                    "detail": "; ".join(filter(None, details)),
                    "effect": sentences.effect(outcome, part.unit),
                    "p": p_value(outcome.p),
                    "opposite": p_value(outcome.p_opposite),
                    "verdict": outcome.verdict.value,
                }
            )
        if several:
            detail = "; ".join(filter(None, ["all parts that count", item.claim.remark]))
            whole = {"name": item.claim.name, "statement": item.claim.statement, "detail": detail}
            rows.append(whole | {"effect": NOTHING, "p": NOTHING, "opposite": NOTHING, "verdict": item.verdict.value})
    return rows


_HEADS = {
    "name": "claim",
    "statement": "statement",
    "effect": "effect [95 % interval]",
    "p": "p",
    "holm": "p, Holm",
    "opposite": "p opposite",
    "verdict": "verdict",
}
"""Cell of a row -> its column; rows of single experiments have no Holm's correction, which is over all of them."""


def claims_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows of claims, as `claim_rows` makes them, as a Markdown table with details in italics."""
    marked = [{key: escape(text) for key, text in row.items()} for row in rows]
    for row in marked:
        row["name"] = f"**{row['name']}**"
        row["statement"] += f" *{row['detail']}*" if row["detail"] else ""
    return _table(marked)


def claims_markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows of claims as a Markdown table without details, for the file `claims.md`."""
    return _table(rows)


def _table(rows: Sequence[Mapping[str, str]]) -> str:
    heads = {key: head for key, head in _HEADS.items() if any(key in row for row in rows)}
    return table(list(heads.values()), [[row[key] for key in heads] for row in rows])


def _other_factors(results: Results) -> list[Factor]:
    """Planner, layout and the factor shown by colour, except the one on the x axis."""
    return [factor for factor in dict.fromkeys((PLANNER, LAYOUT, results.color)) if factor != results.x]


def _median_rows(results: Results, settings: ReportSettings, others: Sequence[Factor]) -> list[list[str]]:
    """One row per metric and values of the other factors, one column per x value."""
    centers = scores.centers(results, settings)
    outside = centers["paper_low"].notna() & ~centers["inside"].fillna(True).astype(bool) & centers["center"].notna()
    centers["cell"] = centers["center"].map(number) + outside.map({True: " *", False: ""})
    keys = [factor.column for factor in others]
    centers = centers.astype(dict.fromkeys(keys, object)).fillna(dict.fromkeys(keys, ""))
    rows = []
    for _, group in centers.groupby(["metric", *keys], sort=False):
        first = group.iloc[0]
        label = f"{first['statistic']} {METRICS[first['metric']].name} ({first['unit']})"
        by_x = group[results.x.column].notna() & (group[results.x.column] != "")
        if by_x.all():
            cells = [*group.set_index(results.x.column)["cell"].reindex(results.x_values, fill_value=NOTHING)]
        else:  # of trainings that all of the x axis shares, but for policies, which have their own
            shared = {each.values[results.x.key] for each in results.settings if "policy" not in each.folders}
            cells = [first["cell"] if value in shared else NOTHING for value in results.x_values]
        values = [name_of(f, first[f.column], settings) if first[f.column] != "" else NOTHING for f in others]
        axis = []
        if settings.axes:
            low, high = (number(first[key], 1) for key in ("paper_low", "paper_high"))
            axis = [f"{low} to {high}" if group["paper_low"].notna().all() else NOTHING]
        rows.append([label, *values, span(group["number"]), *cells, *axis])
    return rows


def _describe_origin(origin: Mapping[str, str]) -> str:
    """The name of something from outside and its module, with the version of its package where it has one."""
    package = f" of {origin['distribution']} {origin['version']}" if "distribution" in origin else ""
    return f"{origin['name']}, by the module {origin['module']}{package}"


def _plain(value: Any) -> str:
    return ", ".join(f"{key} {item}" for key, item in value.items()) if isinstance(value, dict) else str(value)
