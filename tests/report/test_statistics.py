"""References: p values counted by hand over all permutations, the normal interval of a mean, constructed data."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import stats

from affmap.report import statistics
from affmap.report.statistics import Verdict

FALLING = np.array([[5.0, 4.0, 3.0], [9.0, 7.0, 5.5], [2.0, 1.0, 0.0], [4.0, 3.5, 3.0], [8.0, 2.0, 1.0]])


def test_a_perfect_trend_has_the_p_value_of_one_permutation() -> None:
    """All 5 members fall in 3 settings: of (3!) ** 5 equally likely rankings exactly one is as ordered."""
    outcome = statistics.trend(FALLING, "falls")
    assert outcome.p == pytest.approx(1 / 6**5)
    assert outcome.p_opposite == pytest.approx(1.0)
    assert outcome.verdict == Verdict.HOLDS
    assert outcome.effect == pytest.approx(np.mean([-2.0, -3.5, -2.0, -1.0, -7.0]))


def test_the_opposite_of_a_trend_does_not_hold() -> None:
    outcome = statistics.trend(FALLING, "rises")
    assert outcome.verdict == Verdict.DOES_NOT_HOLD
    assert outcome.effect is not None and outcome.effect < 0, "the effect is last minus first, whatever the claim"


def test_a_trend_that_half_of_the_members_contradict_is_not_decided() -> None:
    rising = FALLING[:3, ::-1]
    outcome = statistics.trend(np.concatenate([FALLING[:3], rising]), "falls")
    assert outcome.verdict == Verdict.NOT_DECIDED
    assert outcome.p == pytest.approx(outcome.p_opposite), "the data are symmetric"


def test_signed_rank_has_the_p_value_of_one_assignment_of_signs() -> None:
    """Six differences of one sign: 1 of 2 ** 6 assignments."""
    outcome = statistics.lower(np.zeros(6), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert outcome.p == pytest.approx(2**-6)
    assert outcome.verdict == Verdict.HOLDS
    assert outcome.effect == -3.5
    assert statistics.lower([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], np.zeros(6)).verdict == Verdict.DOES_NOT_HOLD


def test_two_settings_are_compared_by_the_signed_rank_test() -> None:
    trend = statistics.trend(FALLING[:, [0, 2]], "falls")
    assert trend == statistics.lower(FALLING[:, 2], FALLING[:, 0])
    assert trend.p == pytest.approx(2**-5)


@pytest.mark.parametrize(
    ("scores", "note"),
    [
        (FALLING[:2], "needs at least 5 members"),
        (FALLING[:, :1], "needs at least two settings"),
        (np.ones((8, 3)), "all settings score the same"),
        (np.ones((8, 2)), "all differences are zero"),
        (np.where(FALLING == 8.0, np.nan, FALLING), "1 of 5 members lack a finite score"),
        (np.where(FALLING == 8.0, np.inf, FALLING), "1 of 5 members lack a finite score"),
        (np.empty((0, 0)), "needs at least two settings"),
    ],
)
def test_what_cannot_be_tested_is_not_decided_and_says_why(scores: np.ndarray, note: str) -> None:
    outcome = statistics.trend(scores, "falls")
    assert outcome.verdict == Verdict.NOT_DECIDED
    assert outcome.note == note
    assert outcome.p is None


@settings(max_examples=30, deadline=None)
@given(
    arrays(float, array_shapes(min_dims=2, max_dims=2, max_side=7), elements=st.sampled_from([0.0, 1.0, 2.5, np.nan]))
)
def test_no_input_makes_a_nan_or_a_warning(scores: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcome = statistics.trend(scores, "falls")
    values = [outcome.effect, outcome.low, outcome.high, outcome.p, outcome.p_opposite]
    assert all(value is None or np.isfinite(value) for value in values)
    if outcome.verdict != Verdict.NOT_DECIDED:
        assert outcome.p is not None and min(outcome.p, outcome.p_opposite or 1.0) < statistics.LEVEL


def test_interval_is_near_the_closed_form_and_repeats() -> None:
    """Reference: the normal interval of a mean, which the bootstrap approaches for 400 normal values."""
    values = np.random.default_rng(0).normal(3.0, 2.0, size=400)
    low, high = statistics.interval(values)
    expected = stats.norm.interval(0.95, values.mean(), values.std(ddof=1) / 20)
    assert (low, high) == pytest.approx(expected, abs=0.02)
    assert statistics.interval(values) == (low, high)
    assert statistics.interval(np.full(9, 0.25)) == (0.25, 0.25)


def test_a_claim_of_parts_holds_when_all_do() -> None:
    holds, fails, open_ = Verdict.HOLDS, Verdict.DOES_NOT_HOLD, Verdict.NOT_DECIDED
    assert statistics.conjunction([holds, holds]) == holds
    assert statistics.conjunction([holds, open_]) == open_
    assert statistics.conjunction([open_, fails]) == fails
