"""Sentences of a report, generated from the results: no verdict and no number is written here."""

from collections.abc import Sequence

import numpy as np

from affmap.report.drawing.colors import name_of, names_of, readable
from affmap.results import provenance
from affmap.results.claims import Score, holm
from affmap.results.metrics import METRICS
from affmap.results.numbers import NOTHING, counted, interval, listed, number, span
from affmap.results.scores import center
from affmap.results.setting import CONTEXT_SIZE, LAYOUT, PLANNER, PLANNERS, ReportSettings, short_name
from affmap.results.statistics import LEVEL, Outcome, Verdict
from affmap.results.tables import Results, read_runs

AXES = (
    "The paper reports its results as figures only; the ticks of their axes are the only numbers. Values within an "
    "axis are consistent with the paper, no more; values outside are starred. It is unknown whether the paper's "
    "likelihoods include the constant log 2π (1.84 nats for two coordinates); ours do."
)

_COUNTS = {
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.DOES_NOT_HOLD: ("does not hold", "do not hold"),
    Verdict.NOT_DECIDED: ("is not decided", "are not decided"),
    Verdict.NOT_TESTED: ("is not tested", "are not tested"),
}
"""Verdict -> verb phrase for one claim, and for several."""


def effect(outcome: Outcome, unit: str) -> str:
    """Effect with its interval and unit."""
    return interval(outcome.effect, outcome.low, outcome.high, unit)


def verdict_count(scores: Sequence[Score]) -> str:
    """Numbers and names of the claims with each verdict; verdicts without a claim are left out."""
    parts = []
    for verdict, verbs in _COUNTS.items():
        if names := [score.claim.name for score in scores if score.verdict == verdict]:
            parts.append(f"{len(names)} {verbs[len(names) > 1]} ({', '.join(names)})")
    return f"Of {counted(len(scores), 'claim')}, {listed(parts)}."


def correction(scores: Sequence[Score]) -> str:
    """Claims that hold, but not with p values that are corrected for the number of claims; empty if none has a p."""
    corrected = holm(scores)
    count = sum(p is not None for p in corrected)
    if not count:
        return ""
    lost = [
        score.claim.name
        for score, p in zip(scores, corrected, strict=True)
        if score.verdict is Verdict.HOLDS and p is not None and p >= LEVEL
    ]
    change = f"{listed(lost)} would not be decided" if lost else "the same claims hold"
    return f"With Holm's correction for the {counted(count, 'claim')} with a p value, {change}."


FEW = 6
"""As many names on the x axis are all told, of more those at its ends."""


def changes(results: Results, settings: ReportSettings) -> list[str]:
    """Typical values at the ends of the x axis, or of a few names on it, by metric and value shown by colour."""
    sentences = []
    for metric in ("validation_nll", "prediction_error", settings.outcome):
        trained = metric == "validation_nll"
        table = results.last_epoch if trained else results.runs
        factor = LAYOUT if trained and results.color.column not in results.trainings else results.color
        x = CONTEXT_SIZE if trained and results.x.column not in results.trainings else results.x
        values = results.layouts if factor == LAYOUT else results.color_values
        for value in (value for value in values if value in set(table[factor.column])):
            scores = table[table[factor.column] == value].astype({metric: float}).groupby(x.column, sort=False)[metric]
            centers = scores.mean() if metric == "success" else scores.median()
            if centers.isna().all():  # of an agent that predicts nothing
                continue
            named = isinstance(results.x_values[0], str) and x == results.x and len(centers) <= FEW
            shown = [value for value in results.x_values if value in centers] if named else centers.index[[0, -1]]
            names = names_of(x, shown, settings)
            ends = [f"{number(centers[end])} {METRICS[metric].unit} at {names[end]}" for end in shown]
            who = f" ({name_of(factor, value, settings)})" if table[factor.column].nunique() > 1 else ""
            kind = "Share of successful runs" if metric == "success" else f"Median {METRICS[metric].name}"
            sentences.append(f"{kind}{who}: {', '.join(dict.fromkeys(ends))}.".replace(" share at", " at"))
    return sentences


def diverged(results: Results) -> list[str]:
    """Number of members whose last validation loss is not a finite number, by training; empty if there are none."""
    factor, last = results.training_factor, results.last_epoch
    lost = (~np.isfinite(last["validation_nll"])).groupby(last[factor.column], sort=False).agg(["sum", "size"])
    parts = [f"{some} of {every} at {factor.format(value)}" for value, some, every in lost.itertuples() if some]
    if not parts:
        return []
    return [
        f"Trainings have diverged, and end with a validation loss that is not a finite number: {listed(parts)}. Their "
        "numbers are missing from figures and medians, and their maps are grey."
    ]


def bounds(results: Results, settings: ReportSettings) -> list[str]:
    """Results of agents without a learned model, one sentence each."""
    runs, metric = results.baseline_runs, settings.outcome
    sentences = []
    for agent, of_agent in runs.groupby(PLANNER.column, sort=False):
        groups = of_agent.groupby(LAYOUT.column, sort=False)[metric]
        centers = {readable(str(name), settings): number(center(values, metric)) for name, values in groups}
        where = [f"{value} ({name})" if len(centers) > 1 else value for name, value in centers.items()]
        unit = "" if METRICS[metric].unit == "share" else f" {METRICS[metric].unit}"
        kind = "share of successful runs" if metric == "success" else f"median {METRICS[metric].name}"
        sentences.append(f"Agent “{agent}”, without a learned model: {kind} {', '.join(where)}{unit}.")
    return sentences


def findings(scores: Sequence[Score]) -> list[str]:
    """Verdicts of the tests with their effects, one sentence per claim."""
    sentences = []
    for score in scores:
        parts = [part for part in score.parts if part.outcome.effect is not None]
        effects = "; ".join(f"{part.name} {effect(part.outcome, part.unit)}".strip() for part in parts)
        sentences.append(f"{score.claim.name}, {score.verdict}: “{score.claim.statement}” ({effects or NOTHING})")
    return sentences


def spikes(results: Results, height: float = 2.0) -> str:
    """Number of spikes in the curves: member-epochs whose validation loss exceeds that of their neighbours."""
    training = results.trainings
    table = results.validation.sort_values([*training, "member", "epoch"])
    around = table.groupby([*training, "member"])["validation_nll"].transform(
        lambda losses: losses.rolling(7, center=True, min_periods=1).median()
    )
    above = table["validation_nll"] - around
    last = table["epoch"] == table.groupby(training)["epoch"].transform("max")
    return (
        f"In {int((above > height).sum())} of {len(table)} member-epochs the validation loss lies more than "
        f"{height:g} nats above the member's running median over 7 epochs (the largest by {number(above.max(), 1)}); "
        f"{int((above[last] > height).sum())} of these are last epochs."
    )


def uncrossable(results: Results, settings: ReportSettings) -> list[str]:
    """Number of runs in worlds without a passable route; empty if there are none."""
    blocked = results.runs[~results.runs["crossable"].astype(bool)]
    if blocked.empty:
        return []
    counts = results.runs.assign(blocked=~results.runs["crossable"].astype(bool)).groupby("layout")["blocked"].sum()
    named = [f"{int(counts[layout])} ({readable(layout, settings)})" for layout in results.layouts if counts[layout]]
    if settings.outcome == "success":
        share, end = blocked["success"].astype(bool).mean(), "succeed (a force field may carry the vehicle through)"
    else:
        share, end = blocked["reached"].astype(bool).mean(), "reach the goal (fog stops no vehicle)"
    return [
        f"In {listed(named)} of {len(results.runs)} runs the world has no route from start to goal along which the "
        "vehicle can steer freely past obstacles and fog and against force fields. These runs are included in all "
        f"numbers, as successes or failures like all others; {share:.0%} of them {end}."
    ]


def mixtures(results: Results, settings: ReportSettings) -> list[str]:
    """Properties of the worlds that are drawn at random, one sentence per layout.

    Without fog a run succeeds by arriving, so the success in worlds with fog is reported separately.
    """
    sentences = []
    for layout in results.layouts:
        settings_of_layout = results.where({LAYOUT.key: layout})
        last = max(settings_of_layout, key=lambda setting: results.x_values.index(setting.values[results.x.key]))
        worlds = results.run_layouts(last)
        if not results.has_own_layouts(last):
            continue
        effects = [{circle.effect for circle in world.circles} - {"none"} for world in worlds]
        every = set().union(*effects)
        if len(every) < 2:  # nothing is mixed
            continue
        whole = sum(each == every for each in effects)
        parts = [f"{whole} {'has' if whole == 1 else 'have'} all {len(every)} properties"]
        foggy = np.array(["fog" in each for each in effects])
        if 0 < foggy.sum() < len(foggy):
            share = read_runs(last)["success"].to_numpy()[foggy].mean()
            at = name_of(results.x, last.values[results.x.key], settings)
            without = (~foggy).sum()
            others = f"in the others {number(share)} of the runs at {at} succeed"
            parts.append(f"{without} {'has' if without == 1 else 'have'} no fog ({others})")
        sentences.append(f"Of the {len(worlds)} random worlds “{readable(layout, settings)}” {listed(parts)}.")
    return sentences


def remarks(scores: Sequence[Score], stated: bool = False) -> list[str]:
    """Remarks on verdicts, each with the claims that it concerns, and these with their statements if `stated`."""
    claims: dict[str, list[str]] = {}
    for score in scores:
        if score.claim.remark:
            statement = f" (“{score.claim.statement.rstrip('.')}”)" if stated else ""
            claims.setdefault(score.claim.remark, []).append(f"{score.claim.name}{statement}")
    return [f"On {listed(names)}: {remark}." for remark, names in claims.items()]


def setting(results: Results) -> str:
    """Context sizes, members, epochs, layouts, planners and costs of the experiment."""
    members = results.last_epoch.groupby("context_size")["member"].nunique()
    epochs = span(results.last_epoch["epoch"].unique())
    sizes = ", ".join(map(str, results.context_sizes))
    planners = " and ".join(_planner(kind) for kind in results.planners)
    others = [
        f"{factor.label} {', '.join(str(value) for value in values)}; "
        for factor, values in ((results.x, results.x_values), (results.color, results.color_values))
        if factor not in (CONTEXT_SIZE, PLANNER, LAYOUT)
    ]
    worlds = dict.fromkeys(world.name for job in results.settings for world in results.training_layouts(job))
    memory = max(record["peak_memory_mib"] for record in results.provenance.values())
    seconds = sum(cost.seconds for cost in provenance.costs([results])[0])
    return (
        f"Context sizes {sizes}; {''.join(others)}{span(members)} members each, trained for {epochs} epochs in "
        f"{_quoted(list(worlds))}; planners: {planners}; {len(results.runs)} runs of control in total, in "
        f"{_quoted(results.layouts)}. In total, all stages took {number(seconds / 60, 1)} process minutes, including "
        f"repeated attempts and stages shared with other experiments; the largest process used {number(memory, 0)} MiB."
    )


def _planner(kind: str) -> str:
    """Planner with its method."""
    return f"{short_name(kind)} ({PLANNERS[kind].method})" if kind in PLANNERS else kind


def _quoted(names: Sequence[str]) -> str:
    return listed([f"“{name}”" for name in names])
