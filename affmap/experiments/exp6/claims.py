"""The claims of Experiment VI, codes that compose: trained on one property at a time, flown where several overlap.

Claims, levels and predictions were written before the first full run; see `expected.md`.
"""

import numpy as np
import pandas as pd

from affmap.experiments.exp6.overlap import error_by_properties
from affmap.results import claims, statistics
from affmap.results.claims import SIGNED_RANK, Claim, Criterion, Test
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import LAYOUT, make_factor
from affmap.results.statistics import Order, Outcome, undecided
from affmap.results.tables import Results, score_matrix

EASY, HARD, CROWDED = "procedural_easy", "procedural_hard", "procedural_crowded_hard"
"""Layouts."""

MODEL = make_factor("model.transition")
"""The transition model, a file of `conf/model/transition`."""

PAPER, SPLIT, ADDITIVE, HYPER, GIVEN = "mlp", "split", "additive", "hyper", "split_channels"

NEARLY_ORACLE = {HARD: 0.95, CROWDED: 0.9}
"""Layout -> share of the oracle's successful runs."""

MARGIN = 0.05
"""Difference of shares that would not matter."""

OUTLIER = 2.0
"""nats above the median of the members: a member whose validation loss is higher has failed to learn something."""

NAMES = {EASY: "easy", HARD: "hard", CROWDED: "crowded"}


def _runs(results: Results, model: str, layout: str) -> pd.DataFrame:
    """Runs of a model in a layout; none if it was not flown there."""
    runs = claims.select_runs(results, layout)
    return runs[runs[MODEL.column] == model] if MODEL.column in runs else runs.iloc[:0]


def _scores(results: Results, model: str, layout: str, metric: str) -> Floats:
    """Means of a metric over the runs of each member, `[M]`; empty if the model was not flown there."""
    runs = _runs(results, model, layout)
    return score_matrix(runs, metric).to_numpy(float)[:, 0] if len(runs) else np.empty(0)


def _oracle(results: Results, layout: str) -> float | None:
    """Share of the oracle's successful runs, None if it did not fly there."""
    runs = results.baseline_runs
    runs = runs[(runs["planner"] == "oracle") & (runs["layout"] == layout)]
    return float(runs["success"].mean()) if len(runs) else None


def _compared(
    results: Results, layout: str, first: str, second: str, test: Test, name: str, metric: str = "success"
) -> Outcome:
    """Test the scores of two models in a layout; `name` is that of the test, for an outcome without scores."""
    one, other = (_scores(results, model, layout, metric) for model in (first, second))
    if not len(one) or len(one) != len(other):
        return undecided(name, 0, f"needs runs of {first} and {second}")
    return test(one, other)


def _paired(results: Results, layout: str, metric: str, first: str, second: str, order: Order) -> Outcome:
    def test(one: Floats, other: Floats) -> Outcome:
        return statistics.paired(one, other, order, METRICS[metric].statistic)

    return _compared(results, layout, first, second, test, SIGNED_RANK, metric)


def _beats(results: Results, first: str, second: str) -> list[Criterion]:
    """Test whether more runs of the first model succeed in hard and in crowded worlds, and errors are lower."""
    criteria = []
    compared: list[tuple[str, Order, str]] = [
        ("success", "higher", "more runs succeed"),
        ("prediction_error", "lower", "errors are lower"),
    ]
    for layout in (HARD, CROWDED):
        for metric, order, words in compared:
            outcome = _paired(results, layout, metric, first, second, order)
            name = f"{NAMES[layout]}, {METRICS[metric].name.removeprefix('prediction ')}"
            says = f"In {NAMES[layout]} worlds {words} with {first} than with {second}."
            criteria.append(Criterion(name, f"{first} minus {second}", METRICS[metric].unit, outcome, says))
    return criteria


def _better(results: Results) -> list[Criterion]:
    """Test the split model against the paper's; notes give the composition index."""
    criteria = _beats(results, SPLIT, PAPER)
    return [
        each._replace(outcome=claims.with_note(each.outcome, [_index(results, layout)]))
        if each.unit == METRICS["success"].unit
        else each
        for each, layout in zip(criteria, (HARD, HARD, CROWDED, CROWDED), strict=True)
    ]


def _index(results: Results, layout: str) -> str:
    """The composition index in words: the part of the way from the paper's model to the oracle."""
    oracle = _oracle(results, layout)
    split, paper = (_scores(results, model, layout, "success") for model in (SPLIT, PAPER))
    if oracle is None or not len(split) or not len(paper) or oracle <= paper.mean():
        return ""
    return f"composition index {number(float((split.mean() - paper.mean()) / (oracle - paper.mean())))}"


def _nearly_oracle(results: Results) -> list[Criterion]:
    criteria = []
    for layout, level in NEARLY_ORACLE.items():
        oracle, shares = _oracle(results, layout), _scores(results, SPLIT, layout, "success")
        if oracle:
            outcome = claims.with_note(statistics.at_least(shares / oracle, level), [f"oracle: {number(oracle)}"])
        else:
            outcome = undecided(f"95 % interval from {level:g} up", 0, "needs runs of the oracle")
        says = f"In {NAMES[layout]} worlds at least {level:g} of the oracle's share of runs succeed."
        criteria.append(
            Criterion(NAMES[layout], "share of successful runs divided by the oracle's", "ratio", outcome, says)
        )
    return criteria


def _errors(results: Results) -> list[Criterion]:
    """Test the levels of the prediction error in hard worlds, over the runs of each member."""
    errors = _runs(results, SPLIT, HARD).groupby("member")
    median, mean = (errors["prediction_error"].agg(each).to_numpy(float) for each in ("median", "mean"))
    return [
        Criterion(
            "median",
            "median error of a member's runs",
            "nats",
            statistics.below(median, -11.0),
            "Half of a member's runs have an error below −11 nats.",
        ),
        Criterion(
            "mean",
            "mean error of a member's runs",
            "nats",
            statistics.below(mean, -9.0),
            "The mean error of a member's runs is below −9 nats.",
        ),
    ]


def _no_outliers(results: Results) -> list[Criterion]:
    losses = _losses(results, SPLIT)
    inside = (losses <= np.median(losses) + OUTLIER).astype(float) if len(losses) else losses
    outcome = statistics.at_least(inside, 1.0)
    if len(losses):
        paper = _losses(results, PAPER)
        notes = [f"from {number(float(losses.min()))} to {number(float(losses.max()))} nats"]
        if len(paper):
            notes.append(f"{PAPER}: from {number(float(paper.min()))} to {number(float(paper.max()))}")
        outcome = claims.with_note(outcome, notes)
    return [Criterion("", f"share of members less than {OUTLIER:g} nats above the median", "share", outcome)]


def _losses(results: Results, model: str) -> Floats:
    """Validation losses of the members after the last epoch, `[M]`, nats."""
    table: pd.DataFrame = results.last_epoch
    if MODEL.column not in table:
        return np.empty(0)
    return table[table[MODEL.column] == model].sort_values("member")["validation_nll"].to_numpy(float)


def _costs_less(results: Results) -> list[Criterion]:
    """Test the cost of overlaps: the error where several properties act minus the error where one does."""
    costs = {}
    for model in (SPLIT, PAPER):
        setting = next(iter(results.where({MODEL.key: model, LAYOUT.key: HARD})), None)
        if setting is not None:
            errors = error_by_properties(results, setting)
            costs[model] = (errors["several"] - errors["one"]).to_numpy(float)
    if len(costs) < 2:
        outcome = undecided(SIGNED_RANK, 0, f"needs runs of {SPLIT} and {PAPER}")
    else:
        outcome = statistics.paired(costs[SPLIT], costs[PAPER], "lower", "median")
        medians = [f"{model}: {number(float(np.nanmedian(cost)), sign=True)} nats" for model, cost in costs.items()]
        outcome = claims.with_note(outcome, medians)
    return [Criterion("", f"cost with {SPLIT} minus cost with {PAPER}", "nats", outcome)]


def _learned_as_given(results: Results) -> list[Criterion]:
    def test(learned: Floats, given: Floats) -> Outcome:
        return statistics.same(learned, given, MARGIN)

    outcome = _compared(results, HARD, SPLIT, GIVEN, test, f"95 % interval within ±{MARGIN:g}")
    return [Criterion("", f"{SPLIT} minus {GIVEN}", METRICS["success"].unit, outcome)]


def _no_loss(results: Results) -> list[Criterion]:
    def test(split: Floats, paper: Floats) -> Outcome:
        return statistics.at_least(split - paper, -MARGIN)

    outcome = _compared(results, EASY, SPLIT, PAPER, test, f"95 % interval from {-MARGIN:g} up")
    return [Criterion("", f"{SPLIT} minus {PAPER}", METRICS["success"].unit, outcome)]


CLAIMS = (
    Claim(
        "VI-1",
        "Where properties overlap, blocks that act in turn (split) do better than the paper's perceptron (mlp).",
        _better,
    ),
    Claim(
        "VI-2",
        "The split model succeeds nearly as often as the oracle: 0.95 of it in hard, 0.9 in crowded worlds.",
        _nearly_oracle,
    ),
    Claim(
        "VI-3",
        "In hard worlds the errors of the split model are below −11 nats in the median and −9 in the mean.",
        _errors,
    ),
    Claim("VI-4", "No member of the split model is an outlier in validation.", _no_outliers),
    Claim(
        "VI-5",
        "Overlaps in hard worlds add less to the errors of the split model than to the perceptron's.",
        _costs_less,
    ),
    Claim("VI-6", "In easy worlds the split model loses nothing: at most 0.05 of the runs.", _no_loss),
    Claim(
        "VI-7",
        "Blocks learned from one picture do as well in hard worlds as blocks given by channel, up to 0.05.",
        _learned_as_given,
    ),
    Claim(
        "VI-8",
        "Blocks that act in turn do better than blocks whose effects are added to free motion (additive).",
        lambda results: _beats(results, SPLIT, ADDITIVE),
    ),
    Claim(
        "VI-9",
        "Blocks that act in turn do better than weights that are linear in the code (hyper).",
        lambda results: _beats(results, SPLIT, HYPER),
    ),
)
