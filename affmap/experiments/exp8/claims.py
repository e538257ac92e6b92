"""The claims of Experiment VIII, learning by oneself. They are not the paper's, which asks the question they answer."""

from functools import partial

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
    not_higher,
)
from affmap.results import claims, statistics
from affmap.results.claims import Criterion
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

HOME, MOVED = "original", "one_moved"
"""Layouts: that of the experience, and the same after an obstacle has moved."""

LENGTH, SHARE = 0.02, 0.03
"""Differences that would not matter: of a mean distance (u), of a share of runs."""


def _as_near(results: Results, kind: str) -> list[Criterion]:
    metric = "mean_distance"
    online = Online(results)
    score = partial(online.scores, metric=metric, layout=HOME)
    return online.compared(kind, OFFLINE, METRICS[metric].unit, score, not_higher(LENGTH))


def _moved(results: Results, kind: str) -> list[Criterion]:
    online, metric = Online(results), "reached"
    before, after = (online.scores(kind, metric, layout) for layout in (HOME, MOVED))
    if len(before) == len(after) > 0:
        outcome = claims.with_note(statistics.at_least(after - before, -SHARE), [online.note])
    else:
        outcome = statistics.undecided("95 % interval", 0, f"needs runs in {HOME} and in {MOVED}")
    return [Criterion("", "moved minus as explored", METRICS[metric].unit, outcome)]


AS_NEAR = f"agents fly as well as the offline models; their mean distance is at most {LENGTH:g} u longer."
MOVED_ON = (
    f"when an obstacle has moved, agents need not learn anew; at most {SHARE:g} fewer of their runs reach the goal."
)
AS_GOOD = as_good_after(10_000, "48,000 with as many updates")

CLAIMS = (
    claim(10, DISAGREEMENT, AS_GOOD, as_offline),
    claim(11, INFORMATION, AS_GOOD, as_offline),
    claim(12, RANDOM, AS_GOOD, as_offline),
    claim(13, DISAGREEMENT, AS_NEAR, _as_near),
    claim(14, INFORMATION, AS_NEAR, _as_near),
    claim(15, DISAGREEMENT, BETTER, beats_random),
    claim(16, INFORMATION, BETTER, beats_random),
    claim(17, DISAGREEMENT, MOVED_ON, _moved),
    claim(18, INFORMATION, MOVED_ON, _moved),
)
