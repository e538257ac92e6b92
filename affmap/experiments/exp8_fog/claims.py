"""The claims of Experiment VIII in fog, which stays unpredictable however long an agent studies it."""

from functools import partial

from affmap.experiments.online import (
    BETTER,
    DEVIATION,
    DISAGREEMENT,
    INFORMATION,
    RANDOM,
    Online,
    as_good_after,
    as_offline,
    beats_random,
    claim,
)
from affmap.results import statistics
from affmap.results.claims import Criterion
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

WORLD = "fog"
"""The layout of experience and control."""

FEW, TIMES, SUCCEEDS = 0.1, 2, 0.95
"""Share of steps in fog, a multiple of that of random flights, share of successful runs."""

UNIT = "share of steps"


def _avoids(results: Results, kind: str) -> list[Criterion]:
    online = Online(results)
    return online.level(kind, UNIT, online.in_fog(kind), partial(statistics.below, level=FEW))


def _fooled(results: Results, kind: str) -> list[Criterion]:
    online = Online(results)
    test = partial(statistics.at_least, level=0)
    found = online.compared(kind, RANDOM, UNIT, online.in_fog, lambda own, other: test(own - TIMES * other))
    return [each._replace(effect_of=f"{kind} minus {TIMES} times {RANDOM}") for each in found]


def _succeeds(results: Results, kind: str) -> list[Criterion]:
    online, metric = Online(results), METRICS["success"]
    scores = online.scores(kind, "success", WORLD)
    return online.level(kind, metric.unit, scores, partial(statistics.at_least, level=SUCCEEDS))


LEAVES = f"where models differ is not where fog is; agents spend less than {100 * FEW:.0f} % of their steps in fog."
DRAWN = f"agents are drawn to noise; they are in fog at least {TIMES} times as often as agents that explore at random."
SAFE = f"after 10,000 steps at least {SUCCEEDS:g} of their runs avoid fog and reach the goal."
AS_GOOD = as_good_after(10_000, "48,000 with as many updates")

CLAIMS = (
    claim(19, DISAGREEMENT, LEAVES, _avoids),
    claim(20, INFORMATION, LEAVES, _avoids),
    claim(21, DEVIATION, DRAWN, _fooled),
    claim(22, DISAGREEMENT, BETTER, beats_random),
    claim(23, INFORMATION, BETTER, beats_random),
    claim(24, DISAGREEMENT, AS_GOOD, as_offline),
    claim(25, INFORMATION, AS_GOOD, as_offline),
    claim(26, DISAGREEMENT, SAFE, _succeeds),
    claim(27, INFORMATION, SAFE, _succeeds),
)
