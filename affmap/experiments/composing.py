"""Tests of models trained on one property at a time that fly where several overlap, for Experiment VI's claims.

Models are the values of a factor; each of them flies in easy, hard and crowded worlds of Experiment V. A member's score
is its mean over its runs; tests are paired by member.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from affmap.results import claims, statistics
from affmap.results.claims import SIGNED_RANK, Criterion, Test
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import LAYOUT, Factor, Setting
from affmap.results.statistics import Order, Outcome, undecided
from affmap.results.tables import Results

EASY, HARD, CROWDED = "procedural_easy", "procedural_hard", "procedural_crowded_hard"
"""Layouts."""

NAMES = {EASY: "easy", HARD: "hard", CROWDED: "crowded"}

MARGIN = 0.05
"""Difference of shares that would not matter."""

OUTLIER = 2.0
"""nats above the median of the members: a member whose validation loss is higher has failed to learn something."""


@dataclass(frozen=True)
class Models:
    """Results of several models, the values of a factor."""

    results: Results
    factor: Factor

    def runs(self, model: str, layout: str) -> pd.DataFrame:
        """Runs of a model in a layout; none if it was not flown there."""
        return claims.runs_with(self.results, self.factor, model, layout)

    def scores(self, model: str, layout: str, metric: str = "success") -> Floats:
        """Means of a metric over the runs of each member, `[M]`; empty if the model was not flown there."""
        return claims.member_scores(self.results, metric, self.factor, model, layout).to_numpy()

    def losses(self, model: str) -> Floats:
        """Validation losses of the members after the last epoch, `[M]`, nats; empty if the model was not trained."""
        table: pd.DataFrame = self.results.last_epoch
        if self.factor.column not in table:
            return np.empty(0)
        return table[table[self.factor.column] == model].sort_values("member")["validation_nll"].to_numpy(float)

    def setting(self, model: str, layout: str) -> Setting | None:
        """The setting of a model in a layout; None if it was not flown there."""
        return next(iter(self.results.where({self.factor.key: model, LAYOUT.key: layout})), None)

    def bound(self, agent: str, layout: str) -> Floats:
        """Shares of successful runs of an agent without a learned model, by member, `[M]`; empty if it did not fly."""
        runs = self.results.baseline_runs
        runs = runs[(runs["planner"] == agent) & (runs["layout"] == layout)]
        return runs.groupby("member")["success"].mean().to_numpy(float) if len(runs) else np.empty(0)

    def compared(self, layout: str, first: str, second: str, test: Test, name: str, metric: str = "success") -> Outcome:
        """Test the scores of two models in a layout; `name` is that of the test, for an outcome without scores."""
        one, other = (self.scores(model, layout, metric) for model in (first, second))
        if not len(one) or len(one) != len(other):
            return undecided(name, 0, f"needs runs of {' and '.join(map(self.results.name, (first, second)))}")
        return test(one, other)

    def minus(self, first: str, second: str) -> str:
        """The difference of two models in words."""
        return f"{self.results.name(first)} minus {self.results.name(second)}"

    def beats(
        self, first: str, second: str, metrics: Sequence[str] = ("success", "prediction_error")
    ) -> list[Criterion]:
        """Test whether more runs of the first model succeed in hard and in crowded worlds, and errors are lower."""
        words: dict[str, tuple[Order, str]] = {
            "success": ("higher", "more runs succeed"),
            "prediction_error": ("lower", "errors are lower"),
        }
        criteria = []
        for layout in (HARD, CROWDED):
            for metric in metrics:
                order, says = words[metric]

                def test(one: Floats, other: Floats, order: Order = order, metric: str = metric) -> Outcome:
                    return statistics.paired(one, other, order, METRICS[metric].statistic)

                outcome = self.compared(layout, first, second, test, SIGNED_RANK, metric)
                name = f"{NAMES[layout]}, {METRICS[metric].name.removeprefix('prediction ')}"
                one, other = map(self.results.name, (first, second))
                statement = f"In {NAMES[layout]} worlds {says} with {one} than with {other}."
                effect_of = self.minus(first, second)
                criteria.append(Criterion(name, effect_of, METRICS[metric].unit, outcome, statement))
        return criteria

    def nearly(self, model: str, layout: str, level: float, agent: str = "oracle") -> Criterion:
        """Test whether a model succeeds at least `level` as often as an agent that knows the physics."""
        bound, shares, whose = self.bound(agent, layout), self.scores(model, layout), BOUNDS[agent]
        if bound.any():
            share = float(bound.mean())
            outcome = claims.with_note(statistics.at_least(shares / share, level), [f"{whose}: {number(share)}"])
        else:
            outcome = undecided(f"95 % interval from {level:g} up", 0, f"needs runs of {whose}")
        says = f"In {NAMES[layout]} worlds the share of successful runs is at least {level:g} of that of {whose}."
        return Criterion(NAMES[layout], f"share of successful runs divided by that of {whose}", "ratio", outcome, says)

    def errors(self, model: str, median: float, mean: float) -> list[Criterion]:
        """Test that the prediction errors in hard worlds are below levels, over the runs of each member."""
        errors = self.runs(model, HARD).groupby("member")["prediction_error"]
        return [
            Criterion(
                "median",
                "median error of a member's runs",
                "nats",
                statistics.below(errors.median().to_numpy(float), median),
                f"Half of a member's runs have an error below {number(median, 0)} nats.",
            ),
            Criterion(
                "mean",
                "mean error of a member's runs",
                "nats",
                statistics.below(errors.mean().to_numpy(float), mean),
                f"The mean error of a member's runs is below {number(mean, 0)} nats.",
            ),
        ]

    def no_outliers(self, model: str, beside: str) -> list[Criterion]:
        """Test that no member of a model is an outlier in validation; the note tells the losses of another, too."""
        losses, others = self.losses(model), self.losses(beside)
        inside = (losses <= np.median(losses) + OUTLIER).astype(float) if len(losses) else losses
        outcome = statistics.at_least(inside, 1.0)
        if len(losses):
            notes = [f"from {number(float(losses.min()))} to {number(float(losses.max()))} nats"]
            if len(others):
                notes.append(
                    f"{self.results.name(beside)}: from {number(float(others.min()))} to {number(float(others.max()))}"
                )
            outcome = claims.with_note(outcome, notes)
        return [Criterion("", f"share of members less than {OUTLIER:g} nats above the median", "share", outcome)]

    def alike(self, first: str, second: str) -> list[Criterion]:
        """Test that two models succeed equally often in hard worlds, up to a margin."""

        def test(one: Floats, other: Floats) -> Outcome:
            return statistics.same(one, other, MARGIN)

        outcome = self.compared(HARD, first, second, test, f"95 % interval within ±{MARGIN:g}")
        return [Criterion("", self.minus(first, second), METRICS["success"].unit, outcome)]

    def no_loss(self, first: str, second: str) -> list[Criterion]:
        """Test that the first model succeeds as often as the second in easy worlds, up to a margin."""

        def test(one: Floats, other: Floats) -> Outcome:
            return statistics.at_least(one - other, -MARGIN)

        outcome = self.compared(EASY, first, second, test, f"95 % interval from {-MARGIN:g} up")
        return [Criterion("", self.minus(first, second), METRICS["success"].unit, outcome)]


BOUNDS = {"oracle": "the oracle", "seen": "an oracle that knows what views show"}
"""Agent that knows the physics -> its name in a sentence."""
