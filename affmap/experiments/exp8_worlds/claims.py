"""The claims of Experiment VIII in the four worlds of Experiment V, which agents explore in turn."""

from functools import partial

from affmap.experiments.online import (
    BETTER,
    DISAGREEMENT,
    INFORMATION,
    OFFLINE,
    RANDOM,
    Online,
    Test,
    as_good_after,
    as_offline,
    beats_random,
    claim,
)
from affmap.results import statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.tables import Results

EASY, HARD = "procedural_easy", "procedural_hard"
"""Layouts of control, as in Experiment V."""

SHARE = 0.03
"""A difference of shares of runs that would not matter."""

more: Test = partial(statistics.paired, order="higher")
"""The test that first scores are higher than second ones."""


def as_many(first: Floats, second: Floats) -> statistics.Outcome:
    """Test that first scores are at most `SHARE` below second ones, by the interval of their differences."""
    return statistics.at_least(first - second, -SHARE)


def _succeeds(number: int, kind: str, says: str, layout: str, than: str, test: Test) -> Claim:
    """The claim about success of a kind in a layout, beside that of another kind."""

    def criteria(results: Results, kind: str) -> list[Criterion]:
        online, metric = Online(results), METRICS["success"]
        score = partial(online.scores, metric=metric.name, layout=layout)
        return online.compared(kind, than, metric.unit, score, test)

    return claim(number, kind, says, criteria)


MORE = "in hard worlds more of their runs succeed than of the offline models."
MORE_THAN_RANDOM = "in hard worlds more of their runs succeed than of agents that explored at random."
AS_MANY = f"in easy worlds at most {SHARE:g} fewer of their runs succeed than of the offline models."
AS_GOOD = as_good_after(50_000, "48,000 with as many updates")

CLAIMS = (
    claim(35, DISAGREEMENT, AS_GOOD, as_offline),
    claim(36, INFORMATION, AS_GOOD, as_offline),
    claim(37, RANDOM, AS_GOOD, as_offline),
    claim(38, DISAGREEMENT, BETTER, beats_random),
    claim(39, INFORMATION, BETTER, beats_random),
    _succeeds(40, DISAGREEMENT, MORE, HARD, OFFLINE, more),
    _succeeds(41, INFORMATION, MORE, HARD, OFFLINE, more),
    _succeeds(42, DISAGREEMENT, MORE_THAN_RANDOM, HARD, RANDOM, more),
    _succeeds(43, INFORMATION, MORE_THAN_RANDOM, HARD, RANDOM, more),
    _succeeds(44, DISAGREEMENT, AS_MANY, EASY, OFFLINE, as_many),
    _succeeds(45, INFORMATION, AS_MANY, EASY, OFFLINE, as_many),
)
