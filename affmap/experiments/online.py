"""Scores of agents that learn online, a committee of models each, for the claims of Experiment VIII."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.setting import LEARNING, Factor, Setting, Value
from affmap.results.statistics import Outcome
from affmap.results.tables import Results

OFFLINE, RANDOM, DEVIATION, DISAGREEMENT, INFORMATION = "offline", "random", "deviation", "disagreement", "information"
"""Kinds of learning."""

NATS = 0.1
"""A difference of losses that would not matter."""

Test = Callable[[Floats, Floats], Outcome]
"""A test of two scores `[A]`."""


@dataclass(frozen=True)
class Online:
    """Results of a sweep over kinds of learning, by agent.

    An agent's score is that of its committee, since its models share all experience: the mean, or the median of losses,
    which have heavy tails. Agents that learned offline are the same members, in groups of the same size.
    """

    results: Results
    factor: Factor = LEARNING
    """That which makes agents differ; its values are their kinds."""

    @property
    def kinds(self) -> list[Value]:
        """The kinds of agents, in the order of the sweep."""
        return list(dict.fromkeys(each.values[self.factor.key] for each in self.results.settings))

    @cached_property
    def committee(self) -> int:
        """K, models of an agent."""
        for setting in self.results.settings:
            learning = self.results.provenance[setting.train[0]]["config"].get("learning")
            if learning is not None:
                return min(int(learning["committee"]), self.results.runs["member"].nunique())
        return 1

    def losses(self, kind: Value) -> Floats:
        """Validation loss of each agent after its last round, `[A]` in nats."""
        table = self.results.last_epoch
        own = table[table[self.factor.column] == kind] if self.factor.column in table else table.iloc[:0]
        return self._by_agent(own.drop_duplicates("member").set_index("member")["validation_nll"], np.median)

    def scores(self, kind: Value, metric: str, layout: str) -> Floats:
        """Mean of a metric over the runs of each agent in a layout, `[A]`."""
        scores = claims.member_scores(self.results, metric, self.factor, kind, layout)
        return self._by_agent(scores, np.mean) if len(scores) else np.empty(0)

    def in_fog(self, kind: Value) -> Floats:
        """Share of the steps of each agent's exploration that ended in fog, `[A]`."""
        setting = self.setting(kind)
        experience = self.results.experience(setting) if setting else None
        return np.empty(0) if experience is None else experience.in_fog.mean(1).astype(float)

    def setting(self, kind: Value) -> Setting | None:
        """The first setting of a kind."""
        return next(iter(self.results.where({self.factor.key: kind})), None)

    def compared(
        self, kind: Value, than: Value, unit: str, score: Callable[[Any], Floats], test: Test
    ) -> list[Criterion]:
        """Test the scores of a kind beside those of another.

        Args:
            kind: a kind of agents.
            than: the other kind.
            unit: of the scores.
            score: scores `[A]` of a kind.
            test: the test, of both scores.
        """
        first, second = score(kind), score(than)
        if len(first) == len(second) > 0:
            outcome = claims.with_note(test(first, second), [self.note])
        else:
            outcome = statistics.undecided(claims.SIGNED_RANK, 0, f"needs agents of {kind} and of {than}")
        return [Criterion("", f"{kind} minus {than}", unit, outcome)]

    def level(self, kind: Value, unit: str, scores: Floats, test: Callable[[Floats], Outcome]) -> list[Criterion]:
        """Test the level of the scores `[A]` of a kind."""
        outcome = claims.with_note(test(scores), [self.note if len(scores) else f"needs agents of {kind}"])
        return [Criterion("", str(kind), unit, outcome)]

    @property
    def note(self) -> str:
        """A note for tests whose members are agents."""
        return f"a member is an agent of {self.committee} models"

    def _by_agent(self, scores: "pd.Series[float]", center: Callable[..., Floats]) -> Floats:
        """Scores of members, by their seeds, as those of their committees: `[A]`."""
        values = scores.sort_index().to_numpy(float)
        whole = len(values) % self.committee == 0
        return np.asarray(center(values.reshape(-1, self.committee), axis=1)) if whole else np.empty(0)


def claim(number: int, kind: str, says: str, test: Callable[..., list[Criterion]]) -> Claim:
    """The claim that this can be said of agents of a kind, by a test of `Results` and the kind."""
    return Claim(f"VIII-{number}", f"{kind.capitalize()}: {says}", partial(test, kind=kind))


def not_higher(margin: float) -> Test:
    """The test that first scores are at most `margin` above second ones, by the interval of their differences."""
    return lambda first, second: statistics.below(first - second, margin)


def as_offline(results: Results, kind: str) -> list[Criterion]:
    """Test that the loss of a kind is at most `NATS` higher than that of the offline models."""
    online = Online(results)
    return online.compared(kind, OFFLINE, METRICS["validation_nll"].unit, online.losses, not_higher(NATS))


def beats_random(results: Results, kind: str) -> list[Criterion]:
    """Test that the loss of a kind is lower than that of agents that explore at random."""
    online, metric = Online(results), METRICS["validation_nll"]
    test = partial(statistics.paired, order="lower", statistic=metric.statistic)
    return online.compared(kind, RANDOM, metric.unit, online.losses, test)


def as_good_after(steps: int, offline: str) -> str:
    """What `as_offline` tests of agents that have made so many steps, with the experience of the offline models."""
    return (
        f"after {steps:,} steps agents predict as well as models that learned offline from {offline}; their loss is at "
        f"most {NATS:g} nats higher."
    )


BETTER = "agents predict better than those that explored at random for as many steps."
"""What `beats_random` tests."""
