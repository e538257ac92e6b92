"""The content of a report about one experiment as blocks (`blocks.py`): results, tests, origin; all cells are text."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from affmap.report import blocks, build, sentences
from affmap.report.blocks import Block
from affmap.report.drawing.colors import name_of, readable
from affmap.results import provenance, scores
from affmap.results.claims import Score
from affmap.results.files import EVERYWHERE
from affmap.results.halo import UNCERTAIN, WIDTH, beyond, halo
from affmap.results.metrics import METRICS
from affmap.results.numbers import NOTHING, number, p_value, span
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, Factor, ReportSettings
from affmap.results.statistics import LEVEL
from affmap.results.tables import Results

RULE = (
    "Tests are paired by member; a member's score is its mean over its runs. Trends over context sizes: Page's "
    "trend test (Wilcoxon's signed-rank test where only two sizes were run); two conditions: Wilcoxon's "
    f"signed-rank test. A claim holds when the one-sided p in its direction is below {LEVEL}, does not "
    "hold when the one-sided p in the opposite direction is, and is not decided otherwise. A claim of a size (a level, "
    "or being the same up to a margin) has no p; its 95 % interval decides. Effects are means over members with BCa "
    "bootstrap intervals; those of likelihoods in tests with a p, whose tails are heavy, are medians over members with "
    "exact intervals. The p values are not corrected for the number of claims. sd: standard deviation of a member's "
    "own map. A claim of several parts holds when all do; parts that are called learned ask for more than the paper "
    "claims, and do not count."
)

MAIN_FIGURES = "The first figure has the parts of the paper's own, the second shows moments of single runs."

LOOK_CLOSER = "Runs step by step, maps point by point"

MORE_FIGURES = (
    "The figures show affordance maps of more members and context sizes where there are any, the worlds, where "
    "exploration has been, and how runs ended."
)

STEPS = (
    "Validation losses of single steps by what happens in them, at the end of training: the median step and the mean "
    "of all steps, medians over members. A step that neither begins nor ends in fog is free, or touches a surface at "
    "its end. Every step that enters fog, is inside of it or leaves it has noise on its change of position, which "
    "costs some nats however well it is predicted. A model that is sure of a free step and enters fog instead is "
    "surprised by hundreds of nats; so a few steps can decide the mean loss."
)

HALO = (
    "The halo of fog: the share of places outside of it that models take for fog. There a step that begins at rest "
    f"with closed throttles has a predicted deviation above {UNCERTAIN:g} u, and really none; means over members. "
    "Planners keep away from such places as they do from fog."
)

BASELINES = (
    "These agents fly the same runs, from the same starts to the same goals. The oracle plans as the others do, but "
    "with the true physics in place of the model: where it fails, a better model would not help. “Straight” pushes "
    "towards the goal whatever is in between, “random” opens its throttles at random: what they reach takes no "
    "planning."
)

RANGES = (
    "The paper prints no result as text; the ticks of its figures' axes are the only numbers. What lies inside them "
    "is consistent with the paper, not more; a star marks what lies outside. Whether the paper's likelihoods include "
    "the constant log 2π (1.84 nats for two coordinates) is unknown; ours are the full density."
)


def experiment(results: Results, scores: Sequence[Score], settings: ReportSettings) -> list[Block]:
    """What was found and what was run: the head of a report."""
    costs = [[cost.stage, str(cost.folders), number(cost.seconds, 0)] for cost in provenance.costs([results])[0]]
    return [
        blocks.heading("Summary"),
        *([blocks.paragraph(sentences.verdict_count(scores))] if scores else []),
        blocks.bullets(
            [
                *sentences.changes(results, settings),
                *sentences.bounds(results, settings),
                *sentences.mixtures(results, settings),
                *sentences.uncrossable(results, settings),
                *sentences.remarks(scores),
            ]
        ),
        blocks.heading("What was run"),
        blocks.paragraph(sentences.setting(results)),
        blocks.table(["Stage", "Folders", "Seconds in total, all attempts together"], costs),
    ]


def figures(names: Sequence[str], captions: Mapping[str, str], folder: str = "") -> list[Block]:
    """Those of the figures `names` that were drawn and captioned, in a part of the folder of figures."""
    return [blocks.figure(f"{folder}{name}", captions[name]) for name in names if name in captions]


def tests(scores: Sequence[Score], results: Results) -> list[Block]:
    """The claims and what the tests say about them; nothing where the paper claims nothing."""
    if not scores:
        return []
    return [
        blocks.heading("The paper's claims"),
        blocks.bullets([*sentences.findings(scores), sentences.spikes(results)]),
        blocks.paragraph(RULE),
        blocks.claims(claim_rows(scores)),
    ]


def medians(results: Results, settings: ReportSettings, level: int = 1) -> list[Block]:
    """The middle of each setting's results beside the paper's axes."""
    own = _own_factor(results)
    rest = [factor for factor in (PLANNER, LAYOUT, own) if factor and factor != results.x]
    values = [name_of(results.x, value, settings) for value in results.x_values]
    axes = ["Paper's axis"] if settings.axes else []
    header = ["", *(factor.label.capitalize() for factor in rest), "Values", *values, *axes]
    title = "Medians and means" if settings.outcome == "success" else "Medians"
    if settings.axes:
        title = (
            "Medians, means and the paper's axes" if settings.outcome == "success" else "Medians and the paper's axes"
        )
    return [blocks.heading(title, level), blocks.table(header, _median_rows(results, settings))]


def predictions(results: Results, settings: ReportSettings) -> list[Block]:
    """Validation losses by kind of step, and the places outside of fog that models take for fog."""
    table = results.steps
    factor = results.training_factor
    others = [column for column in results.trainings if column != factor.column]
    last = table[table["epoch"] == table.groupby(results.trainings)["epoch"].transform("max")]
    values = list(dict.fromkeys(last[factor.column]))
    keys = [*(column for column in others if last[column].nunique() > 1), "world", "kind"]
    if last["world"].nunique() == 2:  # a world, and all of it
        last = last[last["world"] == EVERYWHERE]
        keys.remove("world")
    rows = []
    for names, group in last.groupby(keys, sort=False):
        centers = group.groupby(factor.column)[["median", "mean"]].median().reindex(values)
        cells = [f"{number(row['median'])}, {number(row['mean'])}" for _, row in centers.iterrows()]
        rows.append([*(readable(str(name), settings) for name in names), span(group["steps"]), *cells])
    heads = [*(key.capitalize() for key in keys), "Steps", *(name_of(factor, value, settings) for value in values)]
    return [
        blocks.heading("What the models predict"),
        blocks.paragraph(STEPS),
        blocks.table(heads, rows),
        *_halo(results, settings),
    ]


def _halo(results: Results, settings: ReportSettings) -> list[Block]:
    """How many places outside fog are taken for fog, by context size; nothing where maps show no fog."""
    painted = {size: setting for size in results.context_sizes if (setting := results.setting(size))}
    worlds = {size: results.map_layout(setting) for size, setting in painted.items()}
    if not any(circle.effect == "fog" for world in worlds.values() for circle in world.circles):
        return []
    rows = [[f"up to {WIDTH:g} u outside fog"], ["farther away"]]
    for size, setting in painted.items():
        place = results.deviations(setting), worlds[size], results.vehicle_radius(setting)
        for row, shares in zip(rows, (halo(*place), beyond(*place)), strict=True):
            row.append(f"{np.mean(shares):.0%}")
    return [
        blocks.paragraph(HALO),
        blocks.table(["Places", *(CONTEXT_SIZE.format(size) for size in painted)], rows),
    ]


def baselines(results: Results, settings: ReportSettings, level: int = 1) -> list[Block]:
    """What agents without a learned model reach in the same runs; nothing where there are none."""
    runs = results.baseline_runs
    if runs.empty:
        return []
    metrics = list(dict.fromkeys(["prediction_error", settings.outcome, "reached", "steps_touching"]))
    heads = [f"{scores.statistic(metric)} {METRICS[metric].name} ({METRICS[metric].unit})" for metric in metrics]
    rows = [
        [str(agent), readable(str(layout), settings), str(len(group))]
        + [number(scores.center(group[metric], metric)) for metric in metrics]
        for (agent, layout), group in runs.groupby([PLANNER.column, LAYOUT.column], sort=False)
    ]
    return [
        blocks.heading("Agents without a learned model", level),
        blocks.paragraph(BASELINES),
        blocks.table(["Agent", "Layout", "Runs", *heads], rows),
    ]


def _own_factor(results: Results) -> Factor | None:
    """The factor that colours tell apart where it is neither planner, nor layout."""
    return None if results.color in (PLANNER, LAYOUT) else results.color


def _median_rows(results: Results, settings: ReportSettings) -> list[list[str]]:
    """One row per metric, planner and layout, one column per x value; a star where it is outside the paper's axis."""
    table = scores.centers(results, settings)
    outside = table["paper_low"].notna() & ~table["inside"].fillna(True).astype(bool) & table["center"].notna()
    table["shown"] = table["center"].map(number) + outside.map({True: " *", False: ""})
    own = _own_factor(results)
    rest = [factor for factor in (PLANNER, LAYOUT, own) if factor and factor != results.x]
    keys = [factor.column for factor in rest]
    table = table.astype(dict.fromkeys(keys, object)).fillna(dict.fromkeys(keys, ""))
    rows = []
    for _, group in table.groupby(["metric", *keys], sort=False):
        first = group.iloc[0]
        label = f"{first['statistic']} {METRICS[first['metric']].name} ({first['unit']})"
        known = group[results.x.column].notna() & (group[results.x.column] != "")
        if known.all():
            centers = [*group.set_index(results.x.column)["shown"].reindex(results.x_values, fill_value=NOTHING)]
        else:  # of trainings that all of the x axis shares
            centers = [first["shown"]] * len(results.x_values)
        values = [name_of(f, first[f.column], settings) if first[f.column] != "" else NOTHING for f in rest]
        axis = []
        if settings.axes:
            low, high = (number(first[key], 1) for key in ("paper_low", "paper_high"))
            axis = [f"{low} to {high}" if group["paper_low"].notna().all() else NOTHING]
        rows.append([label, *values, span(group["number"]), *centers, *axis])
    return rows


def claim_rows(scores: Sequence[Score]) -> list[dict[str, str]]:
    """One row per claim, or per part followed by the whole where a claim has several."""
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


def claims_markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows of claims, as `claim_rows` makes them, as a Markdown table."""
    heads = ["claim", "statement", "effect [95 % interval]", "p", "p opposite", "verdict"]
    keys = ("name", "statement", "effect", "p", "opposite", "verdict")
    return build.markdown_table(heads, [[row[key] for key in keys] for row in rows])


def origins(records: Sequence[Mapping[str, Any]], command: str) -> Block:
    """Where results come from, out of what `provenance.summarize` returned; each value once."""
    lines = [("Command:", command)]
    for name in ("git", "versions", "machine"):
        values = provenance.distinct([value for record in records for value in record[name]])
        lines += [(f"{name.capitalize()}:", _plain(value)) for value in values]
    return blocks.points(lines)


def stages(record: Mapping[str, Any], factors: Sequence[Factor] = ()) -> Block:
    """Every stage that results come from, out of what `provenance.summarize` returned; with its values of factors."""
    rows = [
        [
            stage["stage"],
            stage["digest"][:12],
            str(stage["started"]),
            number(stage["seconds"], 0),
            provenance.setting_of(stage["differs"], factors),
        ]
        for stage in record["stages"]
    ]
    return blocks.table(["Stage", "Digest", "Started", "Seconds", "Setting"], rows, wide=4)


def _plain(value: Any) -> str:
    return ", ".join(f"{key} {item}" for key, item in value.items()) if isinstance(value, dict) else str(value)
