"""The claims of Experiment VIII, learning by oneself. They are not the paper's, which asks the question they answer."""

from functools import partial

from affmap.experiments.online import OFFLINE, ONLINE, RANDOM, SEEKING, Online, lower, not_higher
from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

HOME, MOVED = "original", "one_moved"
"""Layouts: that of the experience, and the same after an obstacle has moved."""

NATS, LENGTH, SHARE = 0.1, 0.02, 0.03
"""Differences that would not matter: of a loss (nats), of a mean distance (u), of a share of runs."""


def _as_good(results: Results) -> list[Criterion]:
    unit = METRICS["validation_nll"].unit
    says = f"the loss is at most {NATS:g} nats higher."
    return Online(results).compared(ONLINE, OFFLINE, unit, Online(results).losses, not_higher(NATS), says)


def _as_near(results: Results) -> list[Criterion]:
    metric = "mean_distance"
    score = partial(Online(results).scores, metric=metric, layout=HOME)
    says = f"the mean distance is at most {LENGTH:g} u longer."
    return Online(results).compared(ONLINE, OFFLINE, METRICS[metric].unit, score, not_higher(LENGTH), says)


def _beats_random(results: Results) -> list[Criterion]:
    unit = METRICS["validation_nll"].unit
    return Online(results).compared(SEEKING, RANDOM, unit, Online(results).losses, lower, "the loss is lower.")


def _moved(results: Results) -> list[Criterion]:
    criteria, online = [], Online(results)
    for kind in ONLINE:
        before, after = (online.scores(kind, "reached", layout) for layout in (HOME, MOVED))
        says = f"{kind.capitalize()}: at most {SHARE:g} fewer of the runs reach the goal."
        if len(before) == len(after) > 0:
            outcome = claims.with_note(statistics.at_least(after - before, -SHARE), [online.note])
        else:
            outcome = statistics.undecided("95 % interval", 0, f"needs runs in {HOME} and in {MOVED}")
        criteria.append(Criterion(kind, "moved minus as explored", METRICS["reached"].unit, outcome, says))
    return criteria


CLAIMS = (
    Claim(
        "VIII-1",
        f"After 10,000 steps agents predict as well as with 48,000 offline: their loss is at most {NATS:g} nats "
        "higher.",
        _as_good,
    ),
    Claim(
        "VIII-2",
        f"They fly as well: their mean distance is at most {LENGTH:g} u longer.",
        _as_near,
    ),
    Claim(
        "VIII-3",
        "Agents that seek news predict better than agents that explore at random for as many steps.",
        _beats_random,
    ),
    Claim(
        "VIII-4",
        f"When an obstacle has moved, nobody has to learn anew: at most {SHARE:g} fewer of the runs reach the goal.",
        _moved,
    ),
)
