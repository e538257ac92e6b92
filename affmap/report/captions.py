"""The report's sentences. What states a result is made from the results: no verdict and no number is written here."""

from collections.abc import Sequence

from affmap.report.claims import METRICS, Score
from affmap.report.figures import EXAMPLE_RULE, choose_examples
from affmap.report.panels import NUM_DEVIATIONS
from affmap.report.statistics import Outcome, Verdict
from affmap.report.tables import PLANNERS, Results
from affmap.report.text import NOTHING, number

_COUNTS = {
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.DOES_NOT_HOLD: ("does not hold", "do not hold"),
    Verdict.NOT_DECIDED: ("is not decided", "are not decided"),
}
"""What one claim does, and what several do."""


def effect(outcome: Outcome, unit: str) -> str:
    """An effect with its interval and unit."""
    if outcome.effect is None:
        return NOTHING
    size = number(outcome.effect, sign=True)
    if outcome.low is None or outcome.high is None:
        return f"{size} {unit}"
    return f"{size} [{number(outcome.low, sign=True)}, {number(outcome.high, sign=True)}] {unit}"


def verdict_count(scores: Sequence[Score]) -> str:
    """How many claims hold, do not hold, and are not decided, with their names."""
    words = []
    for verdict, (one, many) in _COUNTS.items():
        names = [score.claim.name for score in scores if score.verdict == verdict]
        listed = f" ({', '.join(names)})" if names else ""
        words.append(f"{len(names)} {one if len(names) == 1 else many}{listed}")
    return f"Of the paper's {len(scores)} claims about this experiment, {words[0]}, {words[1]}, and {words[2]}."


def changes(results: Results) -> list[str]:
    """The medians at the smallest and the largest context size, a sentence per metric."""
    sizes = results.context_sizes
    sentences = []
    for metric, unit in METRICS.items():
        label = metric.replace("_", " ").replace("nll", "NLL")
        for planner in [None] if metric == "validation_nll" else results.planners:
            table = results.last_epoch if planner is None else results.runs[results.runs["planner"] == planner]
            medians = table.groupby("context_size")[metric].median()
            values = [
                f"{number(medians[size])} {unit} at C = {size}" for size in (sizes[0], sizes[-1]) if size in medians
            ]
            who = "" if planner is None else f" ({PLANNERS[planner]})"
            sentences.append(f"Median {label}{who}: {', '.join(dict.fromkeys(values))}.")
    return sentences


def findings(scores: Sequence[Score]) -> list[str]:
    """What the tests say, a sentence per claim."""
    sentences = []
    for score in scores:
        parts = [part for part in score.parts if part.outcome.effect is not None]
        effects = "; ".join(f"{part.name} {effect(part.outcome, score.claim.unit)}".strip() for part in parts)
        verb = _COUNTS[score.verdict][0]
        sentences.append(f"{score.claim.name} {verb}: {score.claim.statement} ({effects or NOTHING})")
    return sentences


def spikes(results: Results, height: float = 2.0) -> str:
    """How smooth the curves are: member-epochs whose validation loss stands out from their neighbours'."""
    table = results.validation.sort_values(["context_size", "member", "epoch"])
    around = table.groupby(["context_size", "member"])["validation_nll"].transform(
        lambda losses: losses.rolling(7, center=True, min_periods=1).median()
    )
    above = table["validation_nll"] - around
    last = table["epoch"] == table.groupby("context_size")["epoch"].transform("max")
    return (
        f"In {int((above > height).sum())} of {len(table)} member-epochs the validation loss lies more than "
        f"{height:g} nats above the member's running median over 7 epochs (the largest by {number(above.max(), 1)}); "
        f"{int((above[last] > height).sum())} of these are last epochs."
    )


def captions(results: Results, scores: Sequence[Score]) -> dict[str, str]:
    """Name of a figure -> its caption."""
    return {
        "figure4": _figure4(results, scores),
        "figure5": _figure5(results),
        "maps": (
            "Affordance maps: several members at the largest context size, and one member at each context size. "
            "Every map has its own colours (its own principal components, fitted to the positions the vehicle can "
            "reach): colours can be compared within a map, not between maps, because codes of different members "
            "and sizes mean different things. Constant channels are a neutral grey, so a context size of 1 or 2 "
            "uses fewer colours."
        ),
        "world": (
            f"The world “{results.world.name}”, {results.world.size[0]:g} u wide and {results.world.size[1]:g} u high: "
            "obstacles (grey), borders (frame), the squares that starts and goals are drawn from (red, dashed), and "
            "the vehicle to scale (green)."
        ),
        "exploration": (
            f"Where the data set, validation included, has been: {int(results.exploration.counts.sum())} recorded "
            f"positions; {results.exploration.coverage:.1%} of the cells whose centre is free were visited. "
            "Free cells without a visit are red."
        ),
        "outcomes": _outcomes(results),
    }


def _figure4(results: Results, scores: Sequence[Score]) -> str:
    says = {score.claim.name: f"claim {score.claim.name} {_COUNTS[score.verdict][0]}" for score in scores}
    members = results.last_epoch["member"].nunique()
    counts = results.runs.groupby(["context_size", "planner"]).size()
    per_box = f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
    code = "The largest context size is 0, so there is no map."
    if results.maps:
        size = max(results.maps)
        code = (
            f"Affordance map of member {results.maps[size].member[0]} at C = {size}: the context code at each "
            f"position, three principal components as red, green and blue, obstacles outlined; {says['I-8']}."
        )
    return (
        f"As the paper's Figure 4. (A) Validation loss: mean and standard deviation (shade) over {members} members; "
        f"{says['I-1']}. (B) {code} (C) Prediction error and (D) mean distance to the goal "
        f"in control, {per_box} runs a box; {', '.join(says[f'I-{index}'] for index in range(2, 8))}. "
        "Boxes: median and quartiles; whiskers end at the last point within 1.5 interquartile ranges, points "
        "beyond are not drawn. EB: evolutionary-based, GB: gradient-based. Dotted lines: lowest and highest tick "
        "of the paper's axis, where it is in view."
    )


def _figure5(results: Results) -> str:
    examples = choose_examples(results)
    if not examples:
        return ""
    stories = []
    for example in examples:
        runs = results.runs
        of_setting = (runs["context_size"] == example.context_size) & (runs["planner"] == "cem")
        run = runs[of_setting & (runs["member"] == example.member) & (runs["run"] == example.run)].iloc[0]
        end = f"reaches the goal after {run['steps_to_reach']} steps" if run["reached"] else "does not reach the goal"
        stories.append(
            f"With context size {example.context_size} (step {example.step} shown) this run touches a surface in "
            f"{run['steps_touching']} steps, {end}, and has a mean distance of {number(run['mean_distance'])} u."
        )
    return (
        "As the paper's Figure 5. One moment of a run with evolutionary-based planning. Shown is not the best run "
        f"but, by a rule: {EXAMPLE_RULE}; here member {examples[0].member}, run {examples[0].run}. "
        f"{' '.join(stories)} The circles show "
        f"{NUM_DEVIATIONS} standard deviations of the predicted positions along the plan."
    )


def _outcomes(results: Results) -> str:
    shares = results.runs.groupby(["planner", "context_size"])["reached"].mean()
    parts = []
    for planner in results.planners:
        values = shares[planner]
        ends = [f"{values[size]:.0%} of the runs at C = {size}" for size in (values.index[0], values.index[-1])]
        parts.append(f"{PLANNERS[planner]} reaches the goal in {' and '.join(dict.fromkeys(ends))}")
    return (
        "(A) Share of runs that reached the goal, with 95 % bootstrap intervals over members: "
        f"{'; '.join(parts)}. (B) Steps of a run in which the vehicle touched an obstacle or a border. The paper "
        "reports neither here."
    )
