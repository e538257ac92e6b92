"""The claims of Experiment VIII with goals from the beginning, and a weight of the information gain beside them."""

from collections.abc import Callable
from functools import partial

import numpy as np

from affmap.experiments.online import Online
from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS, Statistic
from affmap.results.setting import make_factor
from affmap.results.tables import Results

WORLD = "original"
"""The layout of experience and control."""

WEIGHT = make_factor("learning.information_weight")
ALONE, CURIOUS = 0, 10
"""Weights of agents that have goals alone, and of those that should lose few of them."""

LOSS, DISTANCE, KEPT = -9.27, 0.45, 0.9
"""0.1 nats above the loss of Experiment VIII's offline models; 0.02 u above their mean distance; a share of goals."""

GOALS, LOSSES = "goals per 1,000 steps", METRICS["validation_nll"]


def distances(online: Online, weight: float) -> Floats:
    """Mean distance from the goal in the control of each agent, `[A]` in u."""
    return online.scores(weight, "mean_distance", WORLD)


def goals(online: Online, weight: float) -> Floats:
    """Goals that each agent reached per 1,000 steps of its experience, `[A]`."""
    setting = online.setting(weight)
    experience = online.results.experience(setting) if setting else None
    if experience is None or experience.goals is None:
        return np.empty(0)
    return np.asarray(1000 * experience.goals.mean(1))


Score = Callable[[Online, float], Floats]


def _falls(results: Results, score: Score, unit: str, statistic: Statistic = "mean") -> list[Criterion]:
    online = Online(results, WEIGHT)
    scores = [score(online, weight) for weight in sorted(map(float, online.kinds))]
    if len({len(each) for each in scores}) != 1 or not len(scores[0]):
        outcome = statistics.undecided(claims.TREND, 0, "needs agents with goals, as many of each weight")
    else:
        outcome = claims.with_note(statistics.trend(np.transpose(scores), "falls", statistic), [online.note])
    return [Criterion("", "largest weight minus none", unit, outcome)]


def _below(results: Results, score: Score, unit: str, level: float) -> list[Criterion]:
    online = Online(results, WEIGHT)
    found = online.level(ALONE, unit, score(online, ALONE), partial(statistics.below, level=level))
    return [each._replace(effect_of="goals alone") for each in found]


def _keeps(results: Results) -> list[Criterion]:
    online = Online(results, WEIGHT)
    found = online.compared(
        CURIOUS, ALONE, GOALS, partial(goals, online), lambda own, other: statistics.at_least(own - KEPT * other, 0)
    )
    return [each._replace(effect_of=f"weight {CURIOUS} minus {KEPT:g} of goals alone") for each in found]


def _learns_more(results: Results) -> list[Criterion]:
    online = Online(results, WEIGHT)
    test = partial(statistics.paired, order="lower", statistic=LOSSES.statistic)
    return online.compared(CURIOUS, ALONE, LOSSES.unit, online.losses, test)


CLAIMS = (
    Claim(
        "VIII-46",
        "Goals alone: after 10,000 steps agents predict as well as models that learned offline from 48,000 with as "
        f"many updates; their loss is below {LOSS:g} nats.".replace("-", "\N{MINUS SIGN}"),
        partial(_below, score=Online.losses, unit=LOSSES.unit, level=LOSS),
    ),
    Claim(
        "VIII-47",
        f"Goals alone: after that agents fly as well as these; their mean distance is below {DISTANCE:g} u.",
        partial(_below, score=distances, unit=METRICS["mean_distance"].unit, level=DISTANCE),
    ),
    Claim(
        "VIII-48",
        "Curiosity: the larger the weight of the information gain, the lower the loss.",
        partial(_falls, score=Online.losses, unit=LOSSES.unit, statistic=LOSSES.statistic),
    ),
    Claim(
        "VIII-49",
        "Curiosity: the larger the weight, the fewer goals are reached meanwhile.",
        partial(_falls, score=goals, unit=GOALS),
    ),
    Claim(
        "VIII-50",
        f"Curiosity: with a weight of {CURIOUS} agents reach at least {KEPT:g} as many goals as with goals alone.",
        _keeps,
    ),
    Claim("VIII-51", f"Curiosity: with a weight of {CURIOUS} their loss is lower than with goals alone.", _learns_more),
)
