"""Ratios, shares and tails against independent sources; failures are counted, never averaged."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from torquebench.errors import ResultError
from torquebench.statistics import (
    clopper_pearson,
    cvar,
    draws_needed,
    mcnemar,
    mean_intervals,
    median_interval,
    paired_ratio,
    undominated,
)


def test_the_interval_is_that_of_the_paired_t_test() -> None:
    """The paired t-test of scipy on ln a, ln b gives the same interval; 1e-12, round-off."""
    rng = np.random.default_rng(3)
    b = np.exp(rng.normal(size=30))
    a = b * np.exp(0.2 + 0.1 * rng.normal(size=30))
    found = paired_ratio(a.tolist(), b.tolist())
    wanted = stats.ttest_rel(np.log(a), np.log(b)).confidence_interval(0.95)
    assert found.low == pytest.approx(np.exp(wanted.low), rel=1e-12)
    assert found.high == pytest.approx(np.exp(wanted.high), rel=1e-12)
    assert found.ratio == pytest.approx(np.prod(a / b) ** (1 / 30), rel=1e-12)
    assert found.above
    assert not found.below


def test_exchanging_the_laws_inverts_everything() -> None:
    """ratio(b, a) = 1/ratio(a, b), ends exchanged; 1e-12, round-off."""
    a, b = [1.0, 2.0, 3.0, 2.5], [2.0, 2.5, 5.0, 6.0]
    one, other = paired_ratio(a, b), paired_ratio(b, a)
    assert (1 / one.ratio, 1 / one.high, 1 / one.low) == pytest.approx((other.ratio, other.low, other.high), rel=1e-12)
    assert one.below
    assert other.above


def test_failures_are_counted_and_left_out_in_pairs() -> None:
    """A draw in which either law failed enters neither mean."""
    found = paired_ratio([2.0, None, 8.0, 4.0], [1.0, 1e9, 2.0, None])
    assert found.ratio == pytest.approx(np.sqrt(8.0), rel=1e-12)
    assert found.pairs == 2
    assert found.failed == (1, 1)
    assert found.left_out == 2


def test_one_pair_has_no_spread() -> None:
    """The interval of a single draw is the ratio itself."""
    found = paired_ratio([3.0], [2.0])
    assert found[:4] == (pytest.approx(1.5), pytest.approx(1.5), pytest.approx(1.5), 1)


@pytest.mark.parametrize(
    ("a", "b", "text"),
    [
        ([1.0], [1.0, 2.0], "are not pairs"),
        ([None], [1.0], "no draw in which both"),
        ([0.0], [1.0], "positive"),
        ([float("inf")], [1.0], "positive"),
        ([float("nan")], [1.0], "positive"),
    ],
)
def test_what_cannot_be_compared_is_refused(a: list[float | None], b: list[float | None], text: str) -> None:
    """Lists of different length, no pair, and values without a logarithm."""
    with pytest.raises(ResultError, match=text):
        paired_ratio(a, b)


@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (1, 1), (0, 30), (30, 30), (7, 30), (999, 1000)])
def test_clopper_pearson_is_scipys_exact_interval(successes: int, trials: int) -> None:
    """The same as scipy.stats.binomtest, which inverts the test by root finding: 1e-9."""
    wanted = stats.binomtest(successes, trials).proportion_ci(0.9, "exact")
    found = clopper_pearson(successes, trials, 0.9)
    assert (found.low, found.high) == pytest.approx((wanted.low, wanted.high), rel=1e-9, abs=1e-12)


def test_clopper_pearson_covers() -> None:
    """Whatever the probability, the intervals that contain it have at least 95 % of the binomial probability."""
    intervals = [clopper_pearson(k, 20) for k in range(21)]
    for p in np.linspace(0.01, 0.99, 99):
        inside = np.array([share.low <= p <= share.high for share in intervals])
        assert stats.binom.pmf(np.arange(21), 20, p)[inside].sum() >= 0.95


def test_no_failure_in_n_runs_bounds_the_rate() -> None:
    """The upper bound without a failure solves (1 - p)^n = 0.025, the rule of three at another level."""
    assert clopper_pearson(0, 100).high == pytest.approx(1.0 - 0.025**0.01, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "share", "wanted"),
    [
        ([1.0, 2.0, 3.0, 4.0], 0.5, 3.5),
        ([4.0, 1.0, 3.0, 2.0], 0.25, 4.0),
        ([1.0, 2.0, 3.0, 4.0], 1.0, 2.5),
        ([1.0, 2.0, 3.0, 4.0], 0.375, (4.0 + 0.5 * 3.0) / 1.5),
        ([1.0, 2.0], 0.01, 2.0),
    ],
)
def test_cvar_by_hand(values: list[float], share: float, wanted: float) -> None:
    """Whole counts are plain means of the worst, a part of a run counts as that part, less than one is the worst."""
    assert cvar(values, share) == pytest.approx(wanted, rel=1e-12)
    assert cvar([-x for x in values], share, higher_is_worse=False) == pytest.approx(-wanted, rel=1e-12)


def test_cvar_is_the_least_of_rockafellar_and_uryasev() -> None:
    """Their definition, min over c of c + mean(max(x - c, 0))/share, has its minimum at a value of the sample."""
    x = np.random.default_rng(8).normal(size=37)
    for share in (0.05, 0.1, 0.33, 0.9):
        wanted = min(c + np.mean(np.maximum(x - c, 0.0)) / share for c in x)
        assert cvar(x.tolist(), share) == pytest.approx(wanted, rel=1e-12)


def test_undominated_points() -> None:
    """Points that another one beats in one figure, and not loses to in the other, are out; equal ones both stay."""
    assert undominated([(1.0, 5.0), (2.0, 2.0), (2.0, 3.0), (5.0, 1.0), (6.0, 1.0), (2.0, 2.0)]) == [0, 1, 3, 5]
    assert undominated([]) == []


def test_no_share_of_nothing() -> None:
    """No runs, more successes than runs, and a tail that is none."""
    for successes, trials in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(ResultError, match="is not a share"):
            clopper_pearson(successes, trials)
    for values, share in (([], 0.1), ([1.0], 0.0), ([1.0], 1.5)):
        with pytest.raises(ResultError, match="has no mean"):
            cvar(values, share)


def test_median_intervals_by_hand() -> None:
    """Of 6 draws the extremes cover 1 - 2/64, of 9 the second ones 1 - 20/512, of 5 nothing 95 %; infinities count."""
    assert median_interval([3.0, 1.0, 2.0, 6.0, 5.0, math.inf]) == (4.0, 1.0, math.inf)
    assert median_interval(range(1, 10)) == (5.0, 2.0, 8.0)
    median, low, high = median_interval([1.0, 2.0, math.nan, 3.0])
    assert median == 2.0
    assert math.isnan(low)
    assert math.isnan(high)


@pytest.mark.parametrize(("first", "second"), [(0, 0), (1, 0), (0, 6), (3, 9), (20, 21), (7, 7)])
def test_mcnemar_is_the_exact_binomial_test_of_the_pairs_that_differ(first: int, second: int) -> None:
    """As the two-sided binomial test of scipy at 1/2, to 1e-12; where nothing differs p is 1, and sides are alike."""
    known = stats.binomtest(first, first + second, 0.5).pvalue if first + second else 1.0
    a, b = [1] * first + [0] * second + [1, 0], [0] * first + [1] * second + [1, 0]
    found = mcnemar(a, b)
    assert found == (first, second, len(a), pytest.approx(known, rel=1e-12))
    assert mcnemar(b, a) == (second, first, *found[2:])


def test_as_many_draws_as_are_needed_show_a_change_as_often_as_is_asked() -> None:
    """Of 400 samples of that size with this change 80 % leave out 1, to 5 %, 2.5 sigma; of half the size, 50 %, 7 %."""
    rng = np.random.default_rng(5)
    x = 0.1 * rng.standard_normal(20)
    n = draws_needed(paired_ratio(np.exp(x).tolist(), [1.0] * 20), 1.05)
    assert n == draws_needed(paired_ratio(np.exp(-x).tolist(), [1.0] * 20), 1 / 1.05)
    assert n is not None
    spread = float(np.std(x, ddof=1))
    for size, share, close in ((n, 0.8, 0.05), (n // 2, 0.5, 0.07)):
        samples = math.log(1.05) + spread * rng.standard_normal((400, size))
        seen = np.mean(stats.ttest_1samp(samples, 0.0, axis=1).pvalue < 0.05)
        assert seen == pytest.approx(share, abs=close)
    assert draws_needed(paired_ratio([2.0], [1.0]), 1.05) is None
    assert draws_needed(paired_ratio([2.0, 2.0], [1.0, 1.0]), 1.05) is None


@pytest.mark.parametrize("spread", [0.01, 0.04, 0.15])
def test_the_draws_needed_are_the_least_that_do(spread: float) -> None:
    """The quantiles of Student's t with n - 1 degrees, of 97.5 and 80 %, times s / n^1/2 are ln 1.05 at most at n."""
    x = spread * np.random.default_rng(6).standard_normal(12)
    n = draws_needed(paired_ratio(np.exp(x).tolist(), [1.0] * 12), 1.05)

    def needs(n: int) -> float:
        return float(np.sum(stats.t.ppf([0.975, 0.8], n - 1)) * np.std(x, ddof=1) / math.sqrt(n))

    assert n == next(n for n in range(2, 1000) if needs(n) <= math.log(1.05))


@pytest.mark.parametrize("confidence", [0.5, 0.99])
def test_the_interval_of_a_mean_is_students(confidence: float) -> None:
    """As scipy's t distribution gives it, of the values that are there; 1e-12, round-off."""
    values = np.array([1.0, 2.5, math.nan, 4.0, 3.0])
    known = values[np.isfinite(values)]
    low, high = stats.t.interval(confidence, 3, loc=known.mean(), scale=stats.sem(known))
    count, mean, half = mean_intervals(values, confidence)
    assert count == 4
    assert (mean - half, mean + half) == pytest.approx((low, high), rel=1e-12)
