"""Scores of agents that learn online, a committee of models each, for the claims of Experiment VIII."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from affmap.results import claims, statistics
from affmap.results.claims import Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.setting import LEARNING, Setting
from affmap.results.statistics import Outcome
from affmap.results.tables import Results, score_matrix

OFFLINE, RANDOM, SEEKING = "offline", "random", ("deviation", "disagreement", "divergence")
"""Kinds of learning."""

ONLINE = (RANDOM, *SEEKING)

Test = Callable[[Floats, Floats], Outcome]
"""A test of two scores `[A]`."""


@dataclass(frozen=True)
class Online:
    """Results of a sweep over kinds of learning, by agent.

    An agent's score is that of its committee, since its models share all experience: the mean, or the median of losses,
    which have heavy tails. Agents that learned offline are the same members, in groups of the same size.
    """

    results: Results

    @cached_property
    def committee(self) -> int:
        """K, models of an agent."""
        for setting in self.results.settings:
            learning = self.results.provenance[setting.train[0]]["config"].get("learning")
            if learning is not None:
                return min(int(learning["committee"]), self.results.runs["member"].nunique())
        return 1

    def losses(self, kind: str) -> Floats:
        """Validation loss of each agent after its last round, `[A]` in nats."""
        table = self.results.last_epoch
        own = table[table[LEARNING.column] == kind] if LEARNING.column in table else table.iloc[:0]
        return self._by_agent(own.drop_duplicates("member").set_index("member")["validation_nll"], np.median)

    def scores(self, kind: str, metric: str, layout: str) -> Floats:
        """Mean of a metric over the runs of each agent in a layout, `[A]`."""
        runs = claims.select_runs(self.results, layout)
        runs = runs[runs[LEARNING.column] == kind] if LEARNING.column in runs else runs.iloc[:0]
        return self._by_agent(score_matrix(runs, metric).iloc[:, 0], np.mean) if len(runs) else np.empty(0)

    def in_fog(self, kind: str) -> Floats:
        """Share of the steps of each agent's exploration that ended in fog, `[A]`."""
        setting = self.setting(kind)
        experience = self.results.experience(setting) if setting else None
        return np.empty(0) if experience is None else experience.in_fog.mean(1).astype(float)

    def setting(self, kind: str) -> Setting | None:
        """The first setting of a kind of learning."""
        return next(iter(self.results.where({LEARNING.key: kind})), None)

    def compared(
        self, kinds: Sequence[str], than: str, unit: str, score: Callable[[str], Floats], test: Test, says: str
    ) -> list[Criterion]:
        """Test the scores of each of some kinds beside those of another.

        Args:
            kinds: kinds of learning.
            than: the other kind.
            unit: of the scores.
            score: scores `[A]` of a kind.
            test: the test, of both scores.
            says: the statement of a part, after its kind.
        """
        criteria = []
        for kind in kinds:
            first, second = score(kind), score(than)
            if len(first) == len(second) > 0:
                outcome = claims.with_note(test(first, second), [self.note])
            else:
                outcome = statistics.undecided(claims.SIGNED_RANK, 0, f"needs agents of {kind} and of {than}")
            criteria.append(Criterion(kind, f"{kind} minus {than}", unit, outcome, f"{kind.capitalize()}: {says}"))
        return criteria

    def level(self, kind: str, unit: str, scores: Floats, test: Callable[[Floats], Outcome], says: str) -> Criterion:
        """Test the level of the scores `[A]` of a kind."""
        outcome = claims.with_note(test(scores), [self.note if len(scores) else f"needs agents of {kind}"])
        return Criterion(kind, "share", unit, outcome, says)

    @property
    def note(self) -> str:
        """A note for tests whose members are agents."""
        return f"a member is an agent of {self.committee} models"

    def _by_agent(self, scores: "pd.Series[float]", center: Callable[..., Floats]) -> Floats:
        """Scores of members, by their seeds, as those of their committees: `[A]`."""
        values = scores.sort_index().to_numpy(float)
        whole = len(values) % self.committee == 0
        return np.asarray(center(values.reshape(-1, self.committee), axis=1)) if whole else np.empty(0)


def not_higher(margin: float) -> Test:
    """The test that first scores are at most `margin` above second ones, by the interval of their differences."""
    return lambda first, second: statistics.below(first - second, margin)


def lower(first: Floats, second: Floats) -> Outcome:
    """Test that first losses are lower than second ones."""
    return statistics.paired(first, second, "lower", METRICS["validation_nll"].statistic)
