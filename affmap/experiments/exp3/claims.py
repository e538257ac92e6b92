"""The claims of Experiment III, behavioral relevance: easy is Experiment I, hard has other looks, the same effects."""

import numpy as np

from affmap.experiments import encoding
from affmap.results import claims, statistics
from affmap.results.claims import NO_CONTEXT, NOWHERE, Claim, Criterion, Pair
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.statistics import Outcome
from affmap.results.tables import Results

EASY, HARD = "original", "three_looks"
"""Layouts."""

COMPARED = {"validation_nll": "loss", "prediction_error": "error", "mean_distance": "distance"}
"""Metric -> part."""

TRACE = 0.1
"""Share of an obstacle's distance from the free-space code; meaningless circles with less leave no trace."""


def _no_difference(results: Results) -> list[Criterion]:
    """Test equivalence: the paper's lack of a significant difference alone could be a lack of data."""
    criteria = []
    for metric, name in COMPARED.items():
        margin = METRICS[metric].margin
        assert margin is not None
        table = results.last_epoch if metric == "validation_nll" else claims.select_runs(results)
        table = table[table["context_size"] > 0]  # without a context both are the same model
        outcome = claims.same(table, metric, Pair("layout", HARD, EASY), margin)
        label, unit = METRICS[metric].name, METRICS[metric].unit
        says = f"On average over the context sizes the {label} is the same in both, up to {margin:g} {unit}."
        criteria.append(Criterion(name, "hard minus easy, mean over C > 0", unit, outcome, says))
    return criteria


def _no_trace(results: Results) -> list[Criterion]:
    largest = claims.largest_maps(results, HARD)
    size, outcome, learned = 0, NO_CONTEXT, NO_CONTEXT
    if largest is not None:
        size, maps, world, radius = largest
        trained, untrained = (
            _ratio(*encoding.meaningless_trace(codes, world, radius)) for codes in (maps, maps.untrained)
        )
        outcome = statistics.below(trained, TRACE) if len(trained) else NOWHERE
        learned = statistics.paired(trained, untrained, "lower") if len(trained) else NOWHERE
    ratio = "distance to the free-space code, beside or in meaningless circles relative to beside obstacles"
    says = f"Meaningless circles are less than {TRACE:g} times as far from the free-space code as obstacles."
    again = "Meaningless circles are nearer to the free-space code than in the same member's map before training."
    return [
        Criterion("a", f"{ratio}, C = {size}", "ratio", outcome, says),
        Criterion("a, learned", "trained minus untrained of the same ratio", "ratio", learned, again, counts=False),
    ]


def _ratio(first: Floats, second: Floats) -> Floats:
    """Ratio of distances `[M]`; NaN where a map is constant."""
    return np.divide(first, second, out=np.full(first.shape, np.nan), where=second > 0)


def _looks_vanish(results: Results) -> list[Criterion]:
    epochs, falls, less = _growth(results)
    says = "The codes of upper and lower obstacles become more alike from epoch to epoch."
    again = "After the last epoch the codes of upper and lower obstacles are more alike than before training."
    return [
        Criterion("a", f"distance at the same offsets, {epochs}", "sd", falls, says),
        Criterion("b", "distance at the same offsets, after the last epoch minus before training", "sd", less, again),
    ]


def _growth(results: Results) -> tuple[str, Outcome, Outcome]:
    """Epochs compared, the trend over all saved epochs, and the last epoch compared with the map before training."""
    maps = results.growth_maps
    if results.growth is None or maps is None or not len(maps.epochs):
        note = "needs the longer training, with maps after several epochs"
        return "epochs", statistics.undecided(claims.TREND, 0, note), statistics.undecided(claims.SIGNED_RANK, 0, note)
    place = results.map_layout(results.growth), results.vehicle_radius(results.growth)
    after = {epoch: encoding.look_difference(then, *place) for epoch, then in sorted(maps.snapshots.items())}
    epochs = f"epoch {max(after)} minus epoch {min(after)}"
    last = after[max(after)]
    if not len(last):
        return epochs, NOWHERE, NOWHERE
    trend = statistics.trend(np.stack(list(after.values()), axis=1), "falls")
    return epochs, trend, statistics.paired(last, encoding.look_difference(maps.untrained, *place), "lower")


CLAIMS = (
    Claim(
        "III-1",
        "Easy and hard do not differ in validation loss, prediction error and mean distance.",
        _no_difference,
    ),
    Claim("III-2", "The map of the hard condition has no trace of the meaningless information.", _no_trace),
    Claim("III-3", "As training goes on, upper and lower obstacles come to be encoded alike.", _looks_vanish),
)
