"""The claims of Experiment IV, uncertainty avoidance: fog where Experiment I has obstacles."""

from functools import partial

import numpy as np
import pandas as pd

from affmap.experiments import encoding
from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.statistics import Outcome
from affmap.results.tables import Results, score_matrix

CLOSE_TO_ONE = 0.8
"""Share of runs. The paper says "relatively close to 1", on an axis from 0 to 1: four of five runs, or more."""


def _loss(results: Results) -> list[Criterion]:
    return [_with_minus_without(results.last_epoch, "validation_nll")]


def _error(results: Results) -> list[Criterion]:
    return [_with_minus_without(claims.select_runs(results), "prediction_error")]


def _with_minus_without(table: pd.DataFrame, metric: str) -> Criterion:
    """Test whether a metric is lower with a context, on average over the sizes above 0, than without."""
    sizes = sorted(size for size in table["context_size"].unique() if size > 0)
    if not sizes or 0 not in table["context_size"].to_numpy():
        outcome = statistics.undecided(claims.SIGNED_RANK, 0, "needs C = 0 and a context size above 0")
    else:
        scores = score_matrix(table, metric)
        without = scores[0].to_numpy(float)
        effect = METRICS[metric].statistic
        each = {size: statistics.paired(scores[size].to_numpy(float), without, "lower", effect) for size in sizes}
        notes = [f"C = {size}: {claims.short(outcome, METRICS[metric].unit)}" for size, outcome in each.items()]
        mean = scores[sizes].to_numpy(float).mean(axis=1)
        outcome = claims.with_note(statistics.paired(mean, without, "lower", effect), notes)
    return Criterion("", "mean over C > 0 minus C = 0", METRICS[metric].unit, outcome)


def _success(results: Results) -> list[Criterion]:
    runs = claims.select_runs(results)
    outcome = _at_least(runs[runs["context_size"] > 0])
    shares = runs.groupby("context_size")["success"].mean()
    notes = [f"C = {size}: {number(share)}" for size, share in shares.items()]
    return [Criterion("", "mean over C > 0", METRICS["success"].unit, claims.with_note(outcome, notes))]


def _at_least(runs: pd.DataFrame) -> Outcome:
    shares = score_matrix(runs, "success").to_numpy(float).mean(axis=1) if len(runs) else np.empty(0)
    return statistics.at_least(shares, CLOSE_TO_ONE)


def _kinds(results: Results) -> list[Criterion]:
    maps = claims.largest_maps(results)
    pairs = {"a": ("free space", "border"), "b": ("free space", "fog"), "c": ("border", "fog")}
    criteria: list[Criterion] = []
    for name, (first, second) in pairs.items():
        contrast = partial(encoding.separation, kind=first, others=[second])
        says = f"The codes of {first} and of {second} are farther apart than the codes of either scatter."
        effect_of = f"distance between {first} and {second} minus scatter of codes"
        criteria += claims.encoded(maps, contrast, "higher", name, effect_of, says)
    return criteria


REMARK = (
    "fog acts at the vehicle's centre; as soon as the vehicle overlapped it, this claim held as well (lab log); the "
    "other reading was chosen because of Experiment V"
)

CLAIMS = (
    Claim("IV-1", "A context lowers the validation loss.", _loss),
    Claim("IV-2", "A context lowers the prediction error.", _error),
    Claim(
        "IV-3",
        f"With a context, the share of successful runs is close to 1: at least {CLOSE_TO_ONE:g}.",
        _success,
        REMARK,
    ),
    Claim("IV-4", "Free space, border and fog are encoded differently.", _kinds, claims.DECIDED_LATE),
)
