"""The claims of Experiment VI with circles of several radii in training.

They were written after Experiment VI's verdicts had been seen, and before any run of their own members.
"""

import numpy as np

from affmap.experiments.composing import CROWDED, HARD, NAMES, Models
from affmap.results import statistics
from affmap.results.claims import SIGNED_RANK, Claim, Criterion
from affmap.results.files import Floats
from affmap.results.halo import halo
from affmap.results.metrics import METRICS
from affmap.results.setting import make_factor
from affmap.results.statistics import undecided
from affmap.results.tables import Results

LEARNER = make_factor("learner")
"""A transition model and the worlds that it learns in, a file of `conf/learner`."""

PAPER, SPLIT, GIVEN = "mlp", "split", "given"
ONE_RADIUS = {PAPER: "mlp_one_radius", SPLIT: "split_one_radius"}
"""Model -> the same, trained with the paper's circles."""

BOUND = {HARD: ("oracle", 0.95), CROWDED: ("seen", 0.9)}
"""Layout -> the agent that bounds success, and the share of its successful runs; in crowded worlds fields of one kind
overlap, which no view shows."""


def _models(results: Results) -> Models:
    return Models(results, LEARNER)


def _radii_help(results: Results) -> list[Criterion]:
    criteria = []
    for model, one in ONE_RADIUS.items():
        for each in _models(results).beats(model, one, metrics=("success",)):
            criteria.append(each._replace(name=f"{results.name(model)}, {each.name.removesuffix(', success')}"))
    return criteria


def _nearly(results: Results, model: str) -> list[Criterion]:
    return [_models(results).nearly(model, layout, level, agent) for layout, (agent, level) in BOUND.items()]


def _halo_shrinks(results: Results) -> list[Criterion]:
    """Test the share of places just outside fog that members mistake for fog, in the map's world."""
    criteria = []
    for model, one in ONE_RADIUS.items():
        several, single = (_halo(results, each) for each in (model, one))
        if len(several) and len(single):
            outcome = statistics.paired(several, single, "lower", "mean")
        else:
            outcome = undecided(SIGNED_RANK, 0, f"needs runs of {results.name(model)} and {results.name(one)}")
        name = results.name(model)
        effect_of = _models(results).minus(model, one)
        criteria.append(Criterion(name, effect_of, "share", outcome, f"The halo is smaller: {name}."))
    return criteria


def _halo(results: Results, model: str) -> Floats:
    """Share of the places just outside fog that each member mistakes for fog, `[M]`; empty if the model did not fly."""
    setting = _models(results).setting(model, HARD)
    if setting is None:
        return np.empty(0)
    return halo(results.deviations(setting), results.map_layout(setting), results.vehicle_radius(setting))


def _unseen(results: Results) -> list[Criterion]:
    """Test the cost of overlaps that views do not show."""
    oracle, seen = (_models(results).bound(agent, CROWDED) for agent in ("oracle", "seen"))
    if len(oracle) and len(oracle) == len(seen):
        outcome = statistics.paired(oracle, seen, "higher", "mean")
    else:
        outcome = undecided(SIGNED_RANK, 0, "needs runs of both oracles")
    return [Criterion(NAMES[CROWDED], "oracle minus seen", METRICS["success"].unit, outcome)]


CLAIMS = (
    Claim(
        "VI-10",
        "Circles of several radii in training instead of one help in hard and in crowded worlds, both the paper's "
        "perceptron (MLP) and blocks that act in turn (split).",
        _radii_help,
    ),
    Claim(
        "VI-11",
        "With several radii the split model succeeds nearly as often as it can: 0.95 of the oracle in hard worlds, and "
        "in crowded ones 0.9 of an oracle that knows what views show.",
        lambda results: _nearly(results, SPLIT),
    ),
    Claim(
        "VI-12",
        "With several radii, blocks that are given by channel succeed nearly as often as they can: 0.95 of the oracle "
        "in hard worlds, and in crowded ones 0.9 of an oracle that knows what views show.",
        lambda results: _nearly(results, GIVEN),
    ),
    Claim(
        "VI-13",
        "In hard worlds the errors of the split model are below −11 nats in the median and −9 in the mean.",
        lambda results: _models(results).errors(SPLIT, median=-11, mean=-9),
    ),
    Claim(
        "VI-14",
        "No member of the split model is an outlier in validation.",
        lambda results: _models(results).no_outliers(SPLIT, beside=PAPER),
    ),
    Claim(
        "VI-15",
        "With several radii, too, blocks that act in turn do better than the perceptron.",
        lambda results: _models(results).beats(SPLIT, PAPER),
    ),
    Claim(
        "VI-16",
        "Blocks learned from one picture do as well in hard worlds as blocks given by channel, up to 0.05.",
        lambda results: _models(results).alike(SPLIT, GIVEN),
    ),
    Claim(
        "VI-17",
        "In easy worlds the split model loses nothing against the perceptron: at most 0.05 of the runs.",
        lambda results: _models(results).no_loss(SPLIT, PAPER),
    ),
    Claim("VI-18", "With several radii, fewer places just outside fog are mistaken for fog.", _halo_shrinks),
    Claim(
        "VI-19",
        "In crowded worlds even an oracle that knows the physics succeeds less often if it knows no more of the world "
        "than views show: overlapping fields of one kind look like one, and pull as several.",
        _unseen,
    ),
)
