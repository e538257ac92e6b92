"""The claims of Experiment II, generalization: the models of Experiment I in worlds that they were not trained in."""

from functools import partial

from affmap.report.claims import parts
from affmap.report.claims.parts import METRICS, Claim, Pair, Part
from affmap.report.tables import Results

ORIGINAL, TWO, TWELVE = "original", "two_obstacles", "twelve_obstacles"
"""Layouts."""

NEW = {"a": (TWO, "2 obstacles"), "b": (TWELVE, "12 obstacles")}
"""Part -> layout, and what it is called."""


def _falls(results: Results, metric: str) -> list[Part]:
    return [
        parts.trend(
            parts.flown(results, layout),
            metric,
            "falls",
            f"EB in the world with {called}",
            part,
            f"{called}: the {metric.replace('_', ' ')} falls with the context size.",
        )
        for part, (layout, called) in NEW.items()
    ]


def _distances(results: Results) -> list[Part]:
    runs = parts.flown(results)
    return [
        Part(
            name,
            f"{lower.replace('_', ' ')} minus {higher.replace('_', ' ')}, mean over context sizes",
            METRICS["mean_distance"],
            parts.lower_with_sizes(runs, "mean_distance", Pair("layout", lower, higher)),
            statement,
        )
        for name, lower, higher, statement in (
            ("a", ORIGINAL, TWO, "The mean distance with 2 obstacles is larger than in the original world."),
            ("b", TWELVE, ORIGINAL, "The mean distance with 12 obstacles is smaller than in the original world."),
        )
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
    ),
)
