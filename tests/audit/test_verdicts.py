"""From figures to verdicts: intervals, thresholds, failures, and many cases made one."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from torquebench.audit.verdicts import Interval, Threshold, Verdict, all_of, judge, mean, over_cases, ratio, share
from torquebench.errors import ResultError

HOLDS, FAILS, UNDECIDED, DEPENDS = Verdict
BELOW, ABOVE = Threshold(1.0, "below"), Threshold(1.0, "above")
figures = st.lists(st.floats(1e-3, 1e3), min_size=2, max_size=12)


def interval(low, high, n=5, failed=(0, 0)):
    """Return an interval with its middle as value."""
    return Interval(0.5 * (low + high), low, high, n, failed)


@pytest.mark.parametrize(
    ("low", "high", "below", "above"),
    [
        (0.2, 0.9, HOLDS, FAILS),
        (1.1, 3.0, FAILS, HOLDS),
        (0.9, 1.1, UNDECIDED, UNDECIDED),
        (1.0, 1.0, FAILS, FAILS),  # neither below nor above
    ],
)
def test_the_whole_interval_decides(low, high, below, above):
    """A case holds, or fails, only where its whole interval is on one side."""
    assert judge(interval(low, high), BELOW) == below
    assert judge(interval(low, high), ABOVE) == above


def test_failures_count_against_the_law_that_failed():
    """One failed draw of the judged law is enough; the other law's failures leave the claim what its figures say."""
    assert judge(interval(0.2, 0.3, failed=(1, 0)), BELOW) == FAILS
    assert judge(interval(0.2, 0.3, failed=(0, 1)), BELOW) == HOLDS
    assert judge(interval(2.0, 3.0, failed=(0, 1)), BELOW) == FAILS
    nothing = Interval(math.nan, math.nan, math.nan, 0, (0, 4))
    assert judge(nothing, BELOW) == HOLDS
    assert judge(nothing._replace(failed=(4, 4)), BELOW) == FAILS
    assert judge(nothing._replace(failed=(0, 0)), BELOW) == UNDECIDED


@given(figures)
def test_ratio_of_a_law_to_itself(values):
    """The ratio of equal figures is 1 without spread, and exchanging two laws inverts it."""
    assert ratio(values, values) == Interval(1.0, 1.0, 1.0, len(values), (0, 0))
    shifted = [2.0 * x for x in values]
    assert ratio(shifted, values).value == pytest.approx(2.0, rel=1e-12)
    assert ratio(values, shifted).value == pytest.approx(0.5, rel=1e-12)


@given(figures)
def test_ratio_is_students_on_logarithms(values):
    """The interval is scipy's t interval of the logarithms of the ratios."""
    other = values[::-1]
    logs = [math.log(a / b) for a, b in zip(values, other, strict=True)]
    found = ratio(values, other)
    if max(logs) - min(logs) > 1e-9:
        low, high = stats.t.interval(0.95, len(logs) - 1, loc=sum(logs) / len(logs), scale=stats.sem(logs))
        assert (found.low, found.high) == pytest.approx((math.exp(low), math.exp(high)), rel=1e-9)


def test_floor_makes_negligible_figures_alike():
    """Two figures below the floor have the ratio 1, however far apart they are; above it nothing changes."""
    assert ratio([1e-7], [1e-5], floor=0.1).value == 1.0
    assert ratio([0.4], [0.2], floor=0.1).value == pytest.approx(2.0)
    assert ratio([0.4], [1e-9], floor=0.1).value == pytest.approx(4.0)


def test_ratio_without_figures():
    """Draws in which one law has no figure are left out and counted; a ratio to zero is none."""
    assert ratio([None, 2.0, 2.0], [1.0, 1.0, 1.0]) == Interval(2.0, 2.0, 2.0, 2, (1, 0))
    assert ratio([2.0, math.nan, 2.0], [1.0, 1.0, 1.0]) == Interval(2.0, 2.0, 2.0, 2, (0, 0))
    assert math.isnan(ratio([-5.0], [-3.0], floor=0.1).value)
    assert ratio([None, None], [1.0, 1.0]).n == 0
    assert math.isnan(ratio([1.0], [0.0]).value)


def test_mean_and_difference():
    """A difference is paired by draw: what both laws share in a draw does not widen its interval."""
    shared = [1.0, 5.0, 9.0]
    found = mean([x + 0.25 for x in shared], shared)
    assert found == Interval(0.25, 0.25, 0.25, 3, (0, 0))
    assert mean([2.0]) == Interval(2.0, 2.0, 2.0, 1, (0, 0))
    assert mean([None, 4.0], [1.0, 1.0]).failed == (1, 0)
    assert mean([math.nan, 1.0, 3.0]).n == 2
    low, high = stats.t.interval(0.95, 2, loc=5.0, scale=stats.sem(shared))
    assert mean(shared)[:3] == pytest.approx((5.0, low, high))


def test_share_has_the_exact_binomial_interval():
    """Clopper and Pearson's interval: of 3 in 5 it is 15 to 95 %; one draw is a fact and has none."""
    found = share([1.0, 1.0, 1.0, -1.0, -1.0], Threshold(0.0, "above"))
    exact = stats.binomtest(3, 5).proportion_ci(0.95, "exact")
    assert found[:3] == pytest.approx((0.6, exact.low, exact.high))
    assert share([-1.0, 2.0], Threshold(0.0, "below")).value == 0.5
    assert share([0.3], Threshold(0.0, "above")) == Interval(1.0, 1.0, 1.0, 1, (0, 0))
    assert share([0.3, None], Threshold(0.0, "above")).failed == (1, 0)


def test_a_case_holds_where_all_its_figures_do():
    """One that fails makes it fail, one that is undecided leaves it undecided."""
    assert all_of([HOLDS, HOLDS]) == HOLDS
    assert all_of([HOLDS, UNDECIDED]) == UNDECIDED
    assert all_of([UNDECIDED, FAILS]) == FAILS


@pytest.mark.parametrize(
    ("cases", "verdict"),
    [
        ([HOLDS, HOLDS], HOLDS),
        ([FAILS], FAILS),
        ([HOLDS, FAILS, UNDECIDED], DEPENDS),
        ([HOLDS, FAILS, *[UNDECIDED] * 5], UNDECIDED),
        ([HOLDS, HOLDS, UNDECIDED], HOLDS),
        ([HOLDS, UNDECIDED], UNDECIDED),
        ([FAILS, UNDECIDED, UNDECIDED], UNDECIDED),
        ([UNDECIDED], UNDECIDED),
    ],
)
def test_many_cases_make_one_verdict(cases, verdict):
    """Both sides: it depends; one side that is more than half: that side; else it is undecided. Order is nothing."""
    assert over_cases(cases) == over_cases(cases[::-1]) == verdict


def test_of_a_look_what_its_draws_leave_open_decides_nothing():
    """With other draws than the study's, one case that is undecided may still turn what all others say."""
    assert over_cases([HOLDS, HOLDS, UNDECIDED], True) == over_cases([FAILS, FAILS, UNDECIDED], True) == UNDECIDED
    assert over_cases([HOLDS, HOLDS], True) == HOLDS
    assert over_cases([HOLDS, FAILS, UNDECIDED], True) == DEPENDS


def test_one_draw_that_is_left_of_several_decides_nothing():
    """Its spread is not known: the interval has no ends, and the case is undecided unless a run failed."""
    for found in (ratio([2.0, math.nan, math.nan], [1.0, 1.0, 1.0]), mean([2.0, math.nan])):
        assert (found.n, found.low, found.high) == (1, -math.inf, math.inf)
        assert judge(found, Threshold(5.0, "below")) == UNDECIDED
    assert judge(ratio([2.0, None], [1.0, 1.0]), Threshold(5.0, "below")) == FAILS
    rest = share([1.0, math.nan, math.nan], Threshold(0.0, "above"))
    assert rest[:2] == (1.0, pytest.approx(0.025))


def test_no_case_has_no_verdict():
    """A claim without a case cannot be judged."""
    with pytest.raises(ResultError, match="without a case"):
        over_cases([])
