"""Ratios, shares and tails against independent sources; failures are counted, never averaged."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from torquebench.errors import ResultError
from torquebench.statistics import (
    anytime_ratio,
    capital,
    clopper_pearson,
    cvar,
    draws_needed,
    mcnemar,
    median_interval,
    paired_ratio,
    race,
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


LEVEL = 40.0
"""Capital at which a pair is decided at 95 %: 2/0.05."""
NULLS = {
    "normal": lambda rng, size: rng.normal(size=size),
    "heavy tails": lambda rng, size: rng.standard_cauchy(size),
    "two clusters": lambda rng, size: rng.choice([-1.0, 1.0], size) + 0.01 * rng.normal(size=size),
    "growing": lambda rng, size: rng.normal(size=size) * 1.2 ** np.arange(size[-1]),
}


@pytest.mark.parametrize("name", NULLS)
def test_at_most_one_null_arena_in_twenty_is_decided(name: str) -> None:
    """Of 1,000 arenas of three equal laws, looked at after each of 30 draws, at most 5 % decide some pair."""
    values = NULLS[name](np.random.default_rng(5), (1000, 3, 30))
    pairs = ((0, 1), (0, 2), (1, 2))
    # capital is the most it ever was, so that one call sees every look
    wrong = sum(any(capital(s * (x[i] - x[j])) >= 3 * LEVEL for i, j in pairs for s in (1.0, -1.0)) for x in values)
    assert wrong <= 50


def test_the_capital_is_a_martingale_whatever_the_sizes() -> None:
    """Over all signs of given differences the final capital has the mean 1, to round-off: no bet is favourable."""
    sizes = np.array([0.3, 2.0, 0.01, 1.0, 1.0, 5.0, 0.4, 0.8])
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 8)).reshape(8, -1).T
    finals = [_final_capital(sizes * s) for s in signs]
    assert np.mean(finals) == pytest.approx(1.0, rel=1e-12)
    for s, final in zip(signs[::17], finals[::17], strict=True):  # the most it ever was is that of some prefix
        assert capital(sizes * s) == pytest.approx(max(_final_capital((sizes * s)[: k + 1]) for k in range(8)))
        assert capital(sizes * s) >= final * (1.0 - 1e-12)


def _final_capital(x: np.ndarray) -> float:
    """Capital after the last bet, written as in the paper: the mean over stakes of the product of 1 + tanh."""
    rms = [math.sqrt(sum(x[: k + 1] ** 2) / (k + 1)) for k in range(len(x))]
    return sum(math.prod(1.0 + math.tanh(c * a / r) for a, r in zip(x, rms, strict=True)) for c in (0.5, 1.5, 5.0)) / 3


@pytest.mark.parametrize("effect", [1.0, 2.0])
def test_a_race_needs_half_the_runs_of_a_fixed_number(effect: float) -> None:
    """Where laws differ by one standard deviation of ln a/b or more, a race of 30 ends after 15 or fewer on average.

    The better law is found in 95 % of the races, and never the worse one.
    """
    rng, draws, right = np.random.default_rng(2), [], 0
    for x in np.exp(rng.normal(effect, 1.0, (40, 30))):
        found = race(lambda draw, laws, x=x: {"a": x[draw], "b": 1.0}, ("a", "b"), 30)
        draws.append(found.draws["a"])
        right += found.ratios["a", "b"].above
        assert not found.ratios["a", "b"].below
    assert np.mean(draws) <= 15
    assert right >= 38


def test_the_anytime_interval_is_what_no_bet_refutes() -> None:
    """A ratio is inside where neither bettor against it ever had 40; scaling a law scales ratio and ends."""
    rng, centre, missed = np.random.default_rng(8), 0.7, 0
    for x in centre + 0.5 * rng.normal(size=(60, 20)):
        found = anytime_ratio(np.exp(x).tolist(), [1.0] * 20)
        inside = found.low <= math.exp(centre) <= found.high
        assert inside == (max(capital(x - centre), capital(centre - x)) < LEVEL)
        missed += not inside
    assert missed <= 7  # 5 % of 60, and the 99 % quantile of that binomial
    x = np.exp(x)
    twice = anytime_ratio((2.0 * x).tolist(), [1.0] * 20)
    assert (twice.low, twice.high) == pytest.approx((2.0 * found.low, 2.0 * found.high), rel=1e-9)
    other = anytime_ratio([1.0] * 20, x.tolist())
    assert (1.0 / other.high, 1.0 / other.low) == pytest.approx((found.low, found.high), rel=1e-9)


def test_few_draws_exclude_nothing_and_equal_laws_tie() -> None:
    """Five draws cannot decide at 95 %, however clear; the same law twice is a tie after any number of draws."""
    assert anytime_ratio([2.0] * 5, [1.0] * 5)[1:3] == (0.0, math.inf)
    same = race(lambda draw, laws: dict.fromkeys(laws, 1.0 + draw), ("a", "b"), 30)
    assert same.draws == {"a": 30, "b": 30}
    assert not same.ratios["a", "b"].below
    assert not same.ratios["a", "b"].above


def test_a_race_runs_a_law_only_while_a_pair_of_it_is_undecided() -> None:
    """A law that loses to all stops early; failures are counted, never a draw of the ratio; none shared is no ratio."""
    rng = np.random.default_rng(1)

    def run(draw: int, laws: tuple[str, ...]) -> dict[str, float | None]:
        good = math.exp(0.1 * rng.normal())
        every = {"bad": 50.0, "good": good, "equal": math.exp(0.1 * rng.normal()), "failing": None}
        return {law: every[law] for law in laws}

    found = race(run, ("good", "equal", "bad"), 30)
    assert found.draws["bad"] < 15
    assert found.draws["good"] == found.draws["equal"] == 30
    assert found.ratios["good", "bad"].below
    assert found.ratios["good", "bad"].pairs == found.draws["bad"]
    failing = race(run, ("good", "failing"), 4)
    assert failing.ratios == {}
    assert failing.draws == {"good": 4, "failing": 4}


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
