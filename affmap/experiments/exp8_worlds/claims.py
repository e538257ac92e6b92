"""The claims of Experiment VIII in the four worlds of Experiment V, which agents explore in turn."""

from functools import partial

import numpy as np

from affmap.experiments.online import (
    BETTER,
    DISAGREEMENT,
    INFORMATION,
    OFFLINE,
    RANDOM,
    Online,
    as_good_after,
    as_offline,
    beats_random,
    claim,
)
from affmap.results import statistics
from affmap.results.claims import Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

EASY, HARD = "procedural_easy", "procedural_hard"
"""Layouts of control, as in Experiment V."""

SHARE = 0.03
"""A difference of shares of runs that would not matter."""


def _succeeds(results: Results, kind: str) -> list[Criterion]:
    online, metric = Online(results), METRICS["success"]

    def success(of: str) -> Floats:
        """Share of successful runs in both kinds of worlds, `[A]`."""
        scores = [online.scores(of, "success", layout) for layout in (EASY, HARD)]
        return np.mean(scores, axis=0) if len(scores[0]) == len(scores[1]) else np.empty(0)

    test = partial(statistics.at_least, level=-SHARE)
    return online.compared(kind, OFFLINE, metric.unit, success, lambda own, other: test(own - other))


AS_SAFE = f"at most {SHARE:g} fewer of their runs succeed in the worlds of Experiment V than of the offline models."
AS_GOOD = as_good_after(50_000, "192,000 with four times as many updates")

CLAIMS = (
    claim(28, DISAGREEMENT, AS_GOOD, as_offline),
    claim(29, INFORMATION, AS_GOOD, as_offline),
    claim(30, RANDOM, AS_GOOD, as_offline),
    claim(31, DISAGREEMENT, BETTER, beats_random),
    claim(32, INFORMATION, BETTER, beats_random),
    claim(33, DISAGREEMENT, AS_SAFE, _succeeds),
    claim(34, INFORMATION, AS_SAFE, _succeeds),
)
