"""The claims of Experiment VIII in fog, which stays unpredictable however long an agent studies it."""

from functools import partial

from affmap.experiments.online import OFFLINE, ONLINE, RANDOM, Online, lower
from affmap.results import statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

WORLD = "fog"
"""The layout of experience and control."""

FEW, MOST, SUCCEEDS = 0.1, 0.5, 0.95
"""Shares of steps in fog, and of successful runs."""

NOT_FOOLED, FOOLED = ("disagreement", "divergence"), "deviation"


def _avoids(results: Results) -> list[Criterion]:
    online = Online(results)
    return [
        online.level(
            kind,
            "share of steps",
            online.in_fog(kind),
            partial(statistics.below, level=FEW),
            f"{kind.capitalize()}: less than {FEW:.0%} of the steps.",
        )
        for kind in NOT_FOOLED
    ]


def _fooled(results: Results) -> list[Criterion]:
    online = Online(results)
    test = partial(statistics.at_least, level=MOST)
    return [online.level(FOOLED, "share of steps", online.in_fog(FOOLED), test, "")._replace(name="")]


def _predicts(results: Results, than: str) -> list[Criterion]:
    online = Online(results)
    return online.compared(NOT_FOOLED, than, METRICS["validation_nll"].unit, online.losses, lower, "the loss is lower.")


def _succeeds(results: Results) -> list[Criterion]:
    online, metric = Online(results), METRICS["success"]
    return [
        online.level(
            kind,
            metric.unit,
            online.scores(kind, "success", WORLD),
            partial(statistics.at_least, level=SUCCEEDS),
            f"{kind.capitalize()}: at least {SUCCEEDS:g} of the runs succeed.",
        )
        for kind in ONLINE
    ]


CLAIMS = (
    Claim(
        "VIII-5",
        f"Where models disagree is not where fog is: agents that seek it spend less than {FEW:.0%} of their steps in "
        "fog.",
        _avoids,
    ),
    Claim(
        "VIII-6",
        f"Agents that seek large deviations are fooled: they spend more than {MOST:.0%} of their steps in fog.",
        _fooled,
    ),
    Claim(
        "VIII-7",
        "Agents that seek disagreement or divergence predict better than random ones after as many steps.",
        partial(_predicts, than=RANDOM),
    ),
    Claim(
        "VIII-8",
        "Agents that seek disagreement or divergence predict better than models that learned offline from 48,000 "
        "steps.",
        partial(_predicts, than=OFFLINE),
    ),
    Claim(
        "VIII-9",
        f"After 10,000 steps at least {SUCCEEDS:g} of the runs of all agents avoid fog and reach the goal.",
        _succeeds,
    ),
)
