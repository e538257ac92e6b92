"""The claims of Experiment VI, codes that compose: trained on one property at a time, flown where several overlap.

Claims, levels and predictions were written before the first full run; see `expected.md`.
"""

import numpy as np

from affmap.experiments.composing import CROWDED, HARD, Models
from affmap.experiments.exp6.overlap import error_by_properties
from affmap.results import claims, statistics
from affmap.results.claims import SIGNED_RANK, Claim, Criterion
from affmap.results.numbers import number
from affmap.results.setting import make_factor
from affmap.results.statistics import undecided
from affmap.results.tables import Results

MODEL = make_factor("model.transition")
"""The transition model, a file of `conf/model/transition`."""

PAPER, SPLIT, ADDITIVE, HYPER, GIVEN = "mlp", "split", "additive", "hyper", "split_channels"

NEARLY_ORACLE = {HARD: 0.95, CROWDED: 0.9}
"""Layout -> share of the oracle's successful runs."""


def _models(results: Results) -> Models:
    return Models(results, MODEL)


def _better(results: Results) -> list[Criterion]:
    """Test the split model against the paper's; notes give the composition index."""
    criteria = _models(results).beats(SPLIT, PAPER)
    return [
        each._replace(outcome=claims.with_note(each.outcome, [_index(results, layout)]))
        if each.name.endswith("success")
        else each
        for each, layout in zip(criteria, (HARD, HARD, CROWDED, CROWDED), strict=True)
    ]


def _index(results: Results, layout: str) -> str:
    """The composition index in words: the part of the way from the paper's model to the oracle."""
    models = _models(results)
    oracle, split, paper = models.bound("oracle", layout), *(models.scores(each, layout) for each in (SPLIT, PAPER))
    if not len(oracle) or not len(split) or not len(paper) or oracle.mean() <= paper.mean():
        return ""
    index = float((split.mean() - paper.mean()) / (oracle.mean() - paper.mean()))
    return f"{number(index)} of the way from {results.name(PAPER)} to the oracle (composition index)"


def _nearly_oracle(results: Results) -> list[Criterion]:
    return [_models(results).nearly(SPLIT, layout, level) for layout, level in NEARLY_ORACLE.items()]


def _costs_less(results: Results) -> list[Criterion]:
    """Test the cost of overlaps: the error where several properties act minus the error where one does."""
    costs = {}
    for model in (SPLIT, PAPER):
        setting = _models(results).setting(model, HARD)
        if setting is not None:
            errors = error_by_properties(results, setting)
            costs[model] = (errors["several"] - errors["one"]).to_numpy(float)
    if len(costs) < 2:
        outcome = undecided(SIGNED_RANK, 0, f"needs runs of {results.name(SPLIT)} and {results.name(PAPER)}")
    else:
        outcome = statistics.paired(costs[SPLIT], costs[PAPER], "lower", "median")
        medians = [
            f"{results.name(model)}: {number(float(np.nanmedian(cost)), sign=True)} nats"
            for model, cost in costs.items()
        ]
        outcome = claims.with_note(outcome, medians)
    effect_of = f"cost with {results.name(SPLIT)} minus cost with {results.name(PAPER)}"
    return [Criterion("", effect_of, "nats", outcome)]


CLAIMS = (
    Claim(
        "VI-1",
        "Where properties overlap, blocks that act in turn (split) do better than the paper's perceptron (MLP).",
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
        lambda results: _models(results).errors(SPLIT, median=-11, mean=-9),
    ),
    Claim(
        "VI-4",
        "No member of the split model is an outlier in validation.",
        lambda results: _models(results).no_outliers(SPLIT, beside=PAPER),
    ),
    Claim(
        "VI-5",
        "Overlaps in hard worlds add less to the errors of the split model than to the perceptron's.",
        _costs_less,
    ),
    Claim(
        "VI-6",
        "In easy worlds the split model loses nothing: at most 0.05 of the runs.",
        lambda results: _models(results).no_loss(SPLIT, PAPER),
    ),
    Claim(
        "VI-7",
        "Blocks learned from one picture do as well in hard worlds as blocks given by channel, up to 0.05.",
        lambda results: _models(results).alike(SPLIT, GIVEN),
    ),
    Claim(
        "VI-8",
        "Blocks that act in turn do better than blocks whose effects are added to free motion (additive).",
        lambda results: _models(results).beats(SPLIT, ADDITIVE),
    ),
    Claim(
        "VI-9",
        "Blocks that act in turn do better than weights that are linear in the code (hyper).",
        lambda results: _models(results).beats(SPLIT, HYPER),
    ),
)
