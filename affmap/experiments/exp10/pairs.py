"""Scores of the agent and of its rivals, member by member, so that differences are paired."""

from typing import NamedTuple

import pandas as pd

from affmap.results import claims, statistics
from affmap.results.claims import Criterion, Test
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.setting import reader_name
from affmap.results.tables import Results, score_matrix

AGENT = "cem"
"""The affordance agent, by its name in the column of planners."""

HOME, UNSEEN = "original", ("two_obstacles", "twelve_obstacles")
"""Layouts: that of all experience, and others."""


class Pair(NamedTuple):
    """Scores of two controllers, of the members that both have."""

    first: Floats
    """`[M]`"""
    second: Floats
    """`[M]`"""


def scores(results: Results, name: str, layout: str, metric: str) -> "pd.Series[float]":
    """Mean of a metric over the runs of each member, of a controller in a layout; empty if it did not fly there."""
    for runs in (results.runs, results.baseline_runs):
        own = runs[(runs["planner"] == name) & (runs["layout"] == layout)]
        if len(own):
            return score_matrix(own, metric, ["planner"])[name]
    return pd.Series(dtype=float)


def paired(results: Results, first: str, second: str, layout: str, metric: str) -> Pair:
    """Scores of two controllers in a layout, of the members that both have."""
    one, other = (scores(results, name, layout, metric) for name in (first, second))
    both = one.index.intersection(other.index)
    return Pair(one[both].to_numpy(float), other[both].to_numpy(float))


def compared(results: Results, first: str, second: str, layout: str, metric: str, test: Test, says: str) -> Criterion:
    """Test a metric of two controllers in a layout; `says` is the statement, after names and layout."""
    pair, label = paired(results, first, second, layout, metric), reader_name(layout, results.names)
    names = [reader_name(name, results.names) for name in (first, second)]
    if len(pair.first):
        outcome = test(*pair)
    else:
        outcome = statistics.undecided(claims.SIGNED_RANK, 0, f"needs runs of {' and of '.join(names)} in {label}")
    rival = names[first == AGENT]
    says = f"{names[0]} beside {names[1]}, {label}: {says}"
    return Criterion(f"{rival}, {label}", " minus ".join(names), METRICS[metric].unit, outcome, says)


def lower(first: Floats, second: Floats) -> statistics.Outcome:
    """Test that the first scores are lower than the second ones."""
    return statistics.paired(first, second, "lower")


def at_most(margin: float) -> Test:
    """The test that first scores are at most `margin` above second ones, by the interval of their differences."""
    return lambda first, second: statistics.below(first - second, margin)
