"""References: p values counted by hand over all permutations, the normal interval of a mean, constructed data."""

import itertools
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import stats

from affmap.results import statistics
from affmap.results.statistics import LEVEL, Outcome, Verdict
from affmap.settings import ConfigError

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
    outcome = statistics.paired(np.zeros(6), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "lower")
    assert outcome.p == pytest.approx(2**-6)
    assert outcome.verdict == Verdict.HOLDS
    assert outcome.effect == -3.5
    assert statistics.paired([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], np.zeros(6), "lower").verdict == Verdict.DOES_NOT_HOLD
    assert statistics.paired([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], np.zeros(6), "higher").verdict == Verdict.HOLDS


def test_two_settings_are_compared_by_the_signed_rank_test() -> None:
    trend = statistics.trend(FALLING[:, [0, 2]], "falls")
    assert trend == statistics.paired(FALLING[:, 2], FALLING[:, 0], "lower")
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
def test_what_cannot_be_decided_says_why_and_what_was_not_run_is_not_tested(scores: np.ndarray, note: str) -> None:
    outcome = statistics.trend(scores, "falls")
    assert outcome.verdict == (Verdict.NOT_TESTED if "two settings" in note else Verdict.NOT_DECIDED)
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
    if outcome.verdict in (Verdict.HOLDS, Verdict.DOES_NOT_HOLD):
        assert outcome.p is not None and min(outcome.p, outcome.p_opposite or 1.0) < statistics.LEVEL


@pytest.mark.parametrize(
    "difference",
    [[0.25, 0.25, -0.25, 0.0, 0.5], [-0.5, 0.25, 0.25, 0.25, 0.75, -0.25, 0.0, 0.0], [1.0, 2.0, -3.0, 4.0, 6.0]],
)
def test_signed_rank_counts_all_assignments_of_signs(difference: list[float]) -> None:
    """Reference: every sign of every difference that is not zero, equally likely; ties share their mean rank."""
    nonzero = np.array([value for value in difference if value])
    ranks = stats.rankdata(np.abs(nonzero))
    sums = [ranks[list(signs)].sum() for signs in itertools.product([False, True], repeat=len(nonzero))]
    positive = ranks[nonzero > 0].sum()
    outcome = statistics.paired(difference, np.zeros(len(difference)), "lower")
    assert outcome.p == pytest.approx(np.mean([total <= positive for total in sums]))
    assert outcome.p_opposite == pytest.approx(np.mean([total >= positive for total in sums]))


def test_signed_rank_without_ties_is_scipys() -> None:
    difference = np.random.default_rng(3).normal(0.3, 1.0, size=25)
    outcome = statistics.paired(difference, np.zeros(25), "lower")
    assert outcome.p == pytest.approx(stats.wilcoxon(difference, alternative="less").pvalue)
    assert outcome.p_opposite == pytest.approx(stats.wilcoxon(difference, alternative="greater").pvalue)


def test_four_members_among_ties_decide_nothing() -> None:
    """Four differences of one sign and 21 zeros: 1/16, whatever a normal approximation says."""
    outcome = statistics.paired([-0.25] * 4 + [0.0] * 21, np.zeros(25), "lower")
    assert (outcome.p, outcome.verdict) == (0.5**4, Verdict.NOT_DECIDED)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-0.2, 0.3, Verdict.HOLDS),
        (0.1, 0.3, Verdict.HOLDS),
        (-0.5, 0.5, Verdict.HOLDS),
        (-0.6, 0.1, Verdict.NOT_DECIDED),
        (-0.1, 0.6, Verdict.NOT_DECIDED),
        (0.1, 0.6, Verdict.DOES_NOT_HOLD),
        (-0.9, -0.6, Verdict.DOES_NOT_HOLD),
    ],
)
def test_equivalence_by_hand(low: float, high: float, expected: Verdict) -> None:
    assert statistics.equivalence(low, high, 0.5) == expected


def test_the_same_up_to_a_margin() -> None:
    """The interval of the paired difference decides, whatever differs between members."""
    members = np.arange(8.0) * 10
    wobble = np.array([0.1, -0.1] * 4)
    differences = [-0.2 + wobble, -0.2 + 10 * wobble, -0.8 + wobble]
    outcomes = [statistics.same(members + difference, members, 0.5) for difference in differences]
    assert [outcome.verdict for outcome in outcomes] == [Verdict.HOLDS, Verdict.NOT_DECIDED, Verdict.DOES_NOT_HOLD]
    assert [outcome.effect for outcome in outcomes] == pytest.approx([-0.2, -0.2, -0.8]), "first minus second"
    for outcome in outcomes:
        assert outcome.effect is not None and outcome.low is not None and outcome.high is not None
        assert outcome.low < outcome.effect < outcome.high and outcome.p is None
    assert statistics.same(members[:4], members[:4], 0.5).note == "needs at least 5 members"


def test_a_level_is_decided_by_the_whole_interval() -> None:
    """With half of the scores 0.1 to either side of the mean of 10, its interval is about 0.06 to both sides."""
    for mean, at_least, below in (
        (1.0, Verdict.HOLDS, Verdict.DOES_NOT_HOLD),
        (0.85, Verdict.NOT_DECIDED, Verdict.NOT_DECIDED),
        (0.75, Verdict.NOT_DECIDED, Verdict.NOT_DECIDED),
        (0.6, Verdict.DOES_NOT_HOLD, Verdict.HOLDS),
    ):
        scores = mean + np.array([0.1, -0.1] * 5)
        outcome = statistics.at_least(scores, 0.8)
        assert (outcome.verdict, outcome.effect) == (at_least, pytest.approx(mean))
        assert statistics.below(scores, 0.8).verdict == below
    exact = np.full(6, 0.8)
    assert statistics.at_least(exact, 0.8).verdict == Verdict.HOLDS
    assert statistics.below(exact, 0.8).verdict == Verdict.DOES_NOT_HOLD
    assert statistics.at_least([1.0, np.nan, 1.0, 1.0, 1.0, 1.0], 0.8).note == "1 of 6 members lack a finite score"


def test_everywhere_is_decided_by_the_least_convincing_setting() -> None:
    mean = Outcome("test", 9, Verdict.HOLDS, -1.0, -2.0, -0.5, 0.001, 0.999)
    sure, unsure, opposite = (
        Outcome("test", 9, statistics.verdict(p, 1 - p), -1.0, -2.0, -0.5, p, 1 - p) for p in (0.01, 0.2, 0.98)
    )
    whole = statistics.everywhere([sure, sure], mean)
    assert (whole.verdict, whole.p, whole.p_opposite, whole.effect) == (Verdict.HOLDS, 0.01, 0.99, -1.0)
    whole = statistics.everywhere([sure, unsure], mean)
    assert (whole.verdict, whole.p, whole.p_opposite) == (Verdict.NOT_DECIDED, 0.2, 0.8)
    whole = statistics.everywhere([sure, opposite, unsure], mean)
    assert (whole.verdict, whole.p, whole.p_opposite) == (Verdict.DOES_NOT_HOLD, 0.98, pytest.approx(0.02))
    missing = statistics.undecided("test", 9, "all differences are zero", 0.0)
    whole = statistics.everywhere([sure, missing], mean)
    assert (whole.verdict, whole.p, whole.p_opposite) == (Verdict.NOT_DECIDED, None, None)
    nothing = statistics.undecided("test", 0, "nothing was run")
    assert statistics.everywhere([], nothing).verdict == nothing.verdict == Verdict.NOT_TESTED


@settings(max_examples=30, deadline=None)
@given(arrays(float, st.integers(0, 9), elements=st.sampled_from([0.0, 0.25, 1.0, 1.0 + 1e-15, np.nan, np.inf])))
def test_no_scores_make_a_nan_or_a_warning(scores: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcomes = [
            statistics.at_least(scores, 0.8),
            statistics.below(scores, 0.8),
            statistics.same(scores, np.zeros(len(scores)), 0.5),
            statistics.paired(scores, np.zeros(len(scores)), "lower"),
            statistics.paired(scores, np.zeros(len(scores)), "higher", "median"),
        ]
    for outcome in outcomes:
        values = [outcome.effect, outcome.low, outcome.high, outcome.p, outcome.p_opposite]
        assert all(value is None or np.isfinite(value) for value in values)
        assert outcome.note or outcome.low is not None


def test_interval_is_near_the_closed_form_and_repeats() -> None:
    """Reference: the normal interval of a mean, which the bootstrap approaches for 400 normal values."""
    values = np.random.default_rng(0).normal(3.0, 2.0, size=400)
    low, high = statistics.interval(values)
    expected = stats.norm.interval(0.95, values.mean(), values.std(ddof=1) / 20)
    assert (low, high) == pytest.approx(expected, abs=0.02)
    assert statistics.interval(values) == (low, high)
    assert statistics.interval(np.full(9, 0.25)) == (0.25, 0.25)


def test_the_interval_of_few_members_is_students() -> None:
    """References: the textbook's formula; and 95 % of the intervals of ten normal values hold their mean.

    With 1000 samples, that share has a standard deviation of 0.007. The bootstrap's is 0.91.
    """
    values = np.array([0.41, 0.45, 0.39, 0.52, 0.44])
    half = 2.776 * values.std(ddof=1) / np.sqrt(5)
    assert statistics.interval(values) == pytest.approx((values.mean() - half, values.mean() + half), abs=1e-4)
    samples = np.random.default_rng(0).normal(3.0, 2.0, size=(1000, 10))
    ends = np.array([statistics.interval(sample) for sample in samples])
    assert np.mean((ends[:, 0] <= 3) & (ends[:, 1] >= 3)) == pytest.approx(0.95, abs=0.021)


def test_the_interval_of_a_median_is_that_of_the_binomial_distribution() -> None:
    """The 8th and the 18th of 25 members (P(fewer than 8 of 25 below the median) = 0.0216), however far the last is."""
    difference = np.arange(1.0, 26.0)
    difference[-1] = 1e9
    outcome = statistics.paired(difference, np.zeros(25), "higher", "median")
    assert (outcome.effect, outcome.low, outcome.high) == (13.0, 8.0, 18.0)
    assert statistics.paired(difference, np.zeros(25), "higher").effect == pytest.approx(difference.mean())
    few = statistics.trend(FALLING, "falls", "median")
    assert (few.effect, few.low, few.high) == (-2.0, None, None), "five members have no 95 % interval of a median"


def test_a_claim_of_parts_holds_when_all_do() -> None:
    holds, fails, open_, missing = Verdict
    assert statistics.conjunction([holds, holds]) == holds
    assert statistics.conjunction([holds, open_]) == open_
    assert statistics.conjunction([open_, fails]) == fails
    assert statistics.conjunction([holds, missing]) == open_
    assert statistics.conjunction([missing, missing]) == missing


def test_a_word_that_names_no_direction_is_refused() -> None:
    """Taken for the other one, it would turn a verdict around."""
    with pytest.raises(ConfigError, match="a test cannot be of 'rise'; choose one of: falls, rises"):
        statistics.trend(FALLING, "rise")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="choose one of: lower, higher"):
        statistics.paired(FALLING[:, 0], FALLING[:, 1], "less")  # type: ignore[arg-type]


def test_holm_s_correction_is_that_of_r_and_of_its_definition() -> None:
    """Golden values of R's `p.adjust`; and a claim is significant after it exactly if Holm's steps come to it."""
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.9, 0.6]) == [1.0, 1.0] and statistics.holm([]) == []
    for seed in range(20):
        p = np.random.default_rng(seed).beta(0.3, 2, size=12).tolist()
        rejected, left = set(), dict(enumerate(p))
        while left and min(left.values()) < LEVEL / len(left):
            rejected.add(smallest := min(left, key=left.__getitem__))
            del left[smallest]
        assert {i for i, corrected in enumerate(statistics.holm(p)) if corrected < LEVEL} == rejected


def test_an_interval_of_values_that_differ_by_rounding_is_a_point() -> None:
    """0.1 + 0.2 is not 0.3; SciPy's bootstrap would divide by zero."""
    assert statistics.interval([0.1 + 0.2, 0.3, 0.3]) == (0.1 + 0.2, 0.1 + 0.2)
