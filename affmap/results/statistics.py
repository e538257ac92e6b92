"""Tests of ordered settings, of paired ones and of levels, paired by member: pure functions of score matrices.

A claim of a *direction* holds when a one-sided test in it gives p < 0.05, does not hold
when the one-sided test in the opposite direction does, and is not decided otherwise. A claim of a *size* (at least a
level, or the same up to a margin) is decided by the 95 % interval over members and has no p value. Neither is decided
where there is too little to test, and neither is tested where nothing was run: then a note says what is missing. No
function returns a NaN or decides from one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from affmap.lazy import stats
from affmap.results.metrics import Statistic
from affmap.settings import ConfigError

LEVEL = 0.05
"""One-sided level of every test."""

MIN_MEMBERS = 5
"""With fewer, the signed-rank test cannot reach the level (0.5 ** 4 = 0.0625), and an interval means nothing."""

FEW_MEMBERS = 20
"""With fewer, bootstrap intervals are too short: 84 % of those of 5 normal scores hold their mean, 91 % with 10."""

Direction = Literal["falls", "rises"]
Order = Literal["lower", "higher"]
Scores = NDArray[np.floating]


def _check(value: str, values: Sequence[str]) -> None:
    """Make sure of a word of a claim: another one would turn its test around."""
    if value not in values:
        raise ConfigError(f"a test cannot be of {value!r}; choose one of: {', '.join(values)}.")


class Verdict(StrEnum):
    """The verdict of a test on a claim."""

    HOLDS = "holds"
    DOES_NOT_HOLD = "does not hold"
    NOT_DECIDED = "not decided"
    NOT_TESTED = "not tested"
    """Runs, maps or trainings that it is about are missing."""


@dataclass(frozen=True)
class Outcome:
    """The result of a test. Values that cannot be computed are None; then `note` says why."""

    test: str
    members: int
    verdict: Verdict
    effect: float | None = None
    """Mean or median over members of a difference, or mean of the score whose level is tested; the unit is theirs."""
    low: float | None = None
    """Lower end of the effect's 95 % interval over members."""
    high: float | None = None
    p: float | None = None
    """One-sided, in the direction of the claim."""
    p_opposite: float | None = None
    """One-sided, in the opposite direction."""
    note: str = ""


def trend(scores: ArrayLike, direction: Direction, statistic: Statistic = "mean") -> Outcome:
    """Test whether scores fall (or rise) along the settings: Page's trend test, members ranked within themselves.

    With two settings there is no trend to order, and the test is the signed-rank test of the two.

    Args:
        scores: `[M, S]`, S settings in ascending order.
        direction: of the scores from the first setting to the last, according to the claim.
        statistic: of the members' differences, as the effect.

    Returns:
        The outcome; its effect is last setting minus first, whatever the direction.
    """
    _check(direction, get_args(Direction))
    matrix = np.asarray(scores, dtype=float)
    if matrix.ndim != 2 or matrix.shape[1] < 2:
        return undecided("Page's trend test", 0, "needs at least two settings")
    difference = matrix[:, -1] - matrix[:, 0]
    if matrix.shape[1] == 2:
        return _signed_rank(difference, "higher" if direction == "rises" else "lower", statistic)
    test = "Page's trend test"
    if problem := _problem(matrix):
        return undecided(test, len(matrix), problem, _center(difference, statistic))
    if np.all(matrix == matrix[:, :1]):
        return undecided(test, len(matrix), "all settings score the same", 0.0)
    rises = float(stats.page_trend_test(matrix).pvalue)  # its alternative: scores rise along the columns
    falls = float(stats.page_trend_test(matrix[:, ::-1]).pvalue)
    p, p_opposite = (rises, falls) if direction == "rises" else (falls, rises)
    return _directed(test, difference, statistic, p, p_opposite)


def paired(first: ArrayLike, second: ArrayLike, order: Order, statistic: Statistic = "mean") -> Outcome:
    """Test whether the first scores are lower (or higher) than the second: Wilcoxon's signed-rank test.

    Args:
        first: `[M]`.
        second: `[M]`, in the same order of members.
        order: of the first relative to the second, according to the claim.
        statistic: of the members' differences, as the effect.

    Returns:
        The outcome; its effect is first minus second, so its sign is the claim's where the claim is right.
    """
    _check(order, get_args(Order))
    return _signed_rank(np.asarray(first, dtype=float) - np.asarray(second, dtype=float), order, statistic)


def same(first: ArrayLike, second: ArrayLike, margin: float) -> Outcome:
    """Test whether two scores are the same up to a margin (`equivalence`), paired by member.

    Args:
        first: `[M]`.
        second: `[M]`, in the same order of members.
        margin: largest difference that would not matter.

    Returns:
        The outcome; its effect is first minus second.
    """
    difference = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    test = f"95 % interval within ±{margin:g}"
    return _by_interval(test, difference, lambda low, high: equivalence(low, high, margin))


def at_least(scores: ArrayLike, level: float) -> Outcome:
    """Test whether the mean over members of scores `[M]` is `level` or more; it is the outcome's effect.

    The claim holds when the whole 95 % interval is, does not hold when none of it is, and is else not decided.
    """
    test = f"95 % interval from {level:g} up"
    return _by_interval(test, np.asarray(scores, dtype=float), lambda low, high: _decide(low >= level, high < level))


def below(scores: ArrayLike, level: float) -> Outcome:
    """Test whether the mean over members of scores `[M]` is less than `level`; decided as `at_least` is."""
    test = f"95 % interval below {level:g}"
    return _by_interval(test, np.asarray(scores, dtype=float), lambda low, high: _decide(high < level, low >= level))


def everywhere(each: Sequence[Outcome], mean: Outcome) -> Outcome:
    """Test whether a claim holds in each of several settings, with the effect of their `mean` to show.

    The verdict is the conjunction of `each`. The largest of the p values is one of the whole (an intersection-union
    test); the smallest opposite one is not corrected for the number of settings.
    """
    p = [outcome.p for outcome in each if outcome.p is not None]
    opposite = [outcome.p_opposite for outcome in each if outcome.p_opposite is not None]
    complete = len(each) > 0 and len(p) == len(opposite) == len(each)
    return replace(
        mean,
        verdict=conjunction([outcome.verdict for outcome in each]) if each else mean.verdict,
        p=max(p) if complete else None,
        p_opposite=min(opposite) if complete else None,
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p values for their number by Holm's step-down method, in the order given.

    Among those below a level the chance of a single false one is at most the level, however the tests depend on each
    other.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1)
    return [float(value) for value in corrected]


def interval(values: ArrayLike, seed: int = 0) -> tuple[float, float]:
    """95 % interval over members of the mean of `values` `[M]`; a point if they differ by rounding.

    It is bootstrapped (BCa), or Student's where members are few (`FEW_MEMBERS`).
    """
    sample = np.asarray(values, dtype=float)
    if np.allclose(sample, sample[0], rtol=1e-12, atol=0):
        return float(sample[0]), float(sample[0])
    if len(sample) < FEW_MEMBERS:
        few = stats.ttest_1samp(sample, 0).confidence_interval(0.95)
        return float(few.low), float(few.high)
    ends = stats.bootstrap((sample,), np.mean, method="BCa", rng=np.random.default_rng(seed)).confidence_interval
    return float(ends.low), float(ends.high)


def verdict(p: float, p_opposite: float) -> Verdict:
    """Decide from the two one-sided p values."""
    return _decide(p < LEVEL, p_opposite < LEVEL)


def equivalence(low: float, high: float, margin: float) -> Verdict:
    """Decide from the interval of a difference whether two settings are the same up to `margin`.

    They are when the interval lies within the margin to both sides; they are not when it leaves out zero and reaches
    beyond the margin.
    """
    return _decide(-margin <= low and high <= margin, low > 0 or high < 0)


def _decide(holds: bool, fails: bool) -> Verdict:
    """The verdict of a claim that holds, or else fails, or is undecided."""
    return Verdict.HOLDS if holds else Verdict.DOES_NOT_HOLD if fails else Verdict.NOT_DECIDED


def conjunction(verdicts: Sequence[Verdict]) -> Verdict:
    """A claim of several parts holds when all do, does not hold when one does not, is not tested when none is."""
    if {*verdicts} == {Verdict.NOT_TESTED}:
        return Verdict.NOT_TESTED
    return _decide(all(each is Verdict.HOLDS for each in verdicts), Verdict.DOES_NOT_HOLD in verdicts)


def undecided(test: str, members: int, note: str, effect: float | None = None) -> Outcome:
    """The outcome of a test that could not be made; without members, nothing was run that it could have tested."""
    verdict = Verdict.NOT_DECIDED if members else Verdict.NOT_TESTED
    return Outcome(test, members, verdict, effect, note=note)


def _signed_rank(difference: Scores, order: Order, statistic: Statistic) -> Outcome:
    test = "Wilcoxon signed-rank"
    if problem := _problem(difference):
        return undecided(test, len(difference), problem, _center(difference, statistic))
    if not difference.any():
        return undecided(test, len(difference), "all differences are zero", 0.0)
    less, greater = _signed_rank_p(difference)
    p, p_opposite = (less, greater) if order == "lower" else (greater, less)
    return _directed(test, difference, statistic, p, p_opposite)


def _directed(test: str, difference: Scores, statistic: Statistic, p: float, p_opposite: float) -> Outcome:
    """The outcome of a test of a direction; its interval is that of a mean, or exact where the effect is a median."""
    low: float | None
    high: float | None
    if statistic == "mean":
        low, high = interval(difference)
    else:
        ends = np.asarray(stats.quantile_test(difference, p=0.5).confidence_interval(0.95))
        low, high = (float(end) if np.isfinite(end) else None for end in ends)
    note = "" if low is not None else "fewer than 6 members have no 95 % interval of a median"
    effect = _center(difference, statistic)
    return Outcome(test, len(difference), verdict(p, p_opposite), effect, low, high, p, p_opposite, note)


def _signed_rank_p(difference: Scores) -> tuple[float, float]:
    """Exact one-sided p values, "less" and "greater", of differences `[M]`: zeros are left out, ties share their rank.

    Shares of a few runs tie often; SciPy then takes a normal approximation, by which 4 differences of one sign among 21
    zeros would be significant, though the exact p is 1/16.
    """
    nonzero = difference[difference != 0]
    ranks = np.round(2 * stats.rankdata(np.abs(nonzero))).astype(int)  # doubled, so that shared ranks are whole
    chances = np.ones(1)  # of each sum of the ranks of positive differences, when every sign is a toss of a coin
    for rank in ranks:
        chances = (np.pad(chances, (0, rank)) + np.pad(chances, (rank, 0))) / 2
    positive = int(ranks[nonzero > 0].sum())
    less, greater = chances[: positive + 1].sum(), chances[positive:].sum()
    return min(float(less), 1.0), min(float(greater), 1.0)


def _by_interval(test: str, scores: Scores, decide: Callable[[float, float], Verdict]) -> Outcome:
    if problem := _problem(scores):
        return undecided(test, len(scores), problem, _center(scores, "mean"))
    low, high = interval(scores)
    return Outcome(test, len(scores), decide(low, high), _center(scores, "mean"), low, high)


def _problem(scores: Scores) -> str:
    """The reason why scores `[M, ...]` cannot be tested; empty if they can."""
    bad = sum(not np.isfinite(row).all() for row in scores)
    if bad:
        return f"{bad} of {len(scores)} members lack a finite score"
    return f"needs at least {MIN_MEMBERS} members" if len(scores) < MIN_MEMBERS else ""


def _center(values: Scores, statistic: Statistic) -> float | None:
    """Mean or median, or None where it is not a finite number."""
    if not len(values) or not np.isfinite(values).all():
        return None
    return float(np.mean(values) if statistic == "mean" else np.median(values))
