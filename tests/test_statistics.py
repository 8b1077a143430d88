"""Paired ratios are Student's paired t-test on the logarithms, and failures are counted, never averaged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from torquebench.errors import ResultError
from torquebench.statistics import paired_ratio


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


def test_one_pair_has_no_spread() -> None:
    """The interval of a single draw is the ratio itself."""
    found = paired_ratio([3.0], [2.0])
    assert found[:4] == (pytest.approx(1.5), pytest.approx(1.5), pytest.approx(1.5), 1)


@pytest.mark.parametrize(
    ("a", "b", "text"),
    [([1.0], [1.0, 2.0], "are not pairs"), ([None], [1.0], "no draw in which both"), ([0.0], [1.0], "positive"),
     ([float("inf")], [1.0], "positive"), ([float("nan")], [1.0], "positive")],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused(a: list[float | None], b: list[float | None], text: str) -> None:
    """Lists of different length, no pair, and values without a logarithm."""
    with pytest.raises(ResultError, match=text):
        paired_ratio(a, b)
