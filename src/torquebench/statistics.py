"""Statistics of laws compared draw by draw: geometric-mean ratios, shares and tails with intervals.

`scipy.special` takes longer to import than numpy: it is, where an interval is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import ResultError

Array: TypeAlias = NDArray[np.float64]


class Ratio(NamedTuple):
    """Ratio of one law's metric to another's, over paired draws."""

    ratio: float
    """Geometric mean of a/b over the pairs [1]."""
    low: float
    """Lower end of its interval; the ratio itself for a single pair, of which there is no spread."""
    high: float
    """Upper end."""
    pairs: int
    """Draws in which both laws completed."""
    failed: tuple[int, int]
    """Draws in which the first law, and the second, did not."""
    left_out: int
    """Draws in which one of the two, or both, did not."""

    @classmethod
    def of_logs(cls, mean: float, half: float, pairs: int, failed: tuple[int, int], left_out: int) -> Ratio:
        """Return the ratio of a mean of ln(a/b); what is too large for a number is infinite.

        Args:
            mean: The mean.
            half: Half-width of its interval.
            pairs, failed, left_out: As they are called here.
        """
        low, high = (math.exp(x) if x < 700.0 else math.inf for x in (mean - half, mean + half))
        return cls(math.exp(mean) if mean < 700.0 else math.inf, low, high, pairs, failed, left_out)

    @property
    def below(self) -> bool:
        """Whether the whole interval is below 1."""
        return self.high < 1.0

    @property
    def above(self) -> bool:
        """Whether the whole interval is above 1."""
        return self.low > 1.0


def mean_interval(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float]:
    """Return the mean of a sample and the half-width of Student's interval; 0 for a single value.

    Args:
        values: At least one.
        confidence: Probability content of the interval [1].
    """
    from scipy import special

    n = len(values)
    if n == 1:
        return float(values[0]), 0.0
    half = special.stdtrit(n - 1, 0.5 + 0.5 * confidence) * np.std(values, ddof=1) / math.sqrt(n)
    return float(np.mean(values)), float(half)


def mean_intervals(values: Array, confidence: float = 0.95) -> tuple[NDArray[np.intp], Array, Array]:
    """Return size, mean and half-width of Student's interval of each sample along the last axis.

    Args:
        values: The samples, (..., N); NaN is no value. A sample of none has the mean NaN; of one, the half-width NaN.
        confidence: Probability content of the intervals [1].
    """
    from scipy import special

    known = np.isfinite(values)
    count = np.sum(known, axis=-1)
    size = np.where(count > 0, count, np.nan)
    mean = np.sum(np.where(known, values, 0.0), axis=-1) / size
    squares = np.sum(np.where(known, values - mean[..., None], 0.0) ** 2, axis=-1)
    free = np.where(count > 1, size - 1.0, np.nan)
    return count, mean, special.stdtrit(free, 0.5 + 0.5 * confidence) * np.sqrt(squares / free / size)


def paired_ratio(a: Sequence[float | None], b: Sequence[float | None], confidence: float = 0.95) -> Ratio:
    """Return exp of the mean of ln(a/b) over paired draws, with Student's interval on the logarithms.

    Args:
        a, b: A positive metric of two laws in the same draws, in the same order; None where the run failed.
        confidence: Probability content of the interval [1].

    Raises:
        ResultError: the lists have different lengths, no draw has both, or a value is not positive.
    """
    if len(a) != len(b):
        raise ResultError(f"{len(a)} draws of one law and {len(b)} of the other are not pairs")
    pairs = [(x, y) for x, y in zip(a, b, strict=True) if x is not None and y is not None]
    if any(not (x > 0.0 and y > 0.0) or math.isinf(x) or math.isinf(y) for x, y in pairs):
        raise ResultError("a ratio needs metrics that are positive and finite")
    if not (logs := [math.log(x / y) for x, y in pairs]):
        raise ResultError("there is no draw in which both laws completed")
    mean, half = mean_interval(logs, confidence)
    failed = sum(x is None for x in a), sum(y is None for y in b)
    return Ratio.of_logs(mean, half, len(logs), failed, len(a) - len(logs))


SMALL = 1.05
"""Change for which the number of draws that would show it is told where no other is asked for [1]."""
POWER = 0.8
"""Probability with which a change is to be seen where the number of draws for it is told [1]."""


def draws_needed(found: Ratio, ratio: float = SMALL, confidence: float = 0.95, power: float = POWER) -> int | None:
    """Return how many draws show a change by a ratio, from the spread of the draws that there are.

    The least n with (t_(n-1, (1 + confidence)/2) + t_(n-1, power)) s / n^1/2 <= |ln ratio|, s the standard deviation of
    ln(a/b), of which Student's interval of `found` is made: then the interval leaves out 1 with this probability,
    nearly. None where one draw alone is known, or nothing spreads.

    Args:
        found: A paired ratio of at least two draws, at the confidence.
        ratio: The change that is to be seen, such as 1.05.
        confidence: Of the interval [1].
        power: Probability of seeing it [1].
    """
    if found.pairs < 2 or not found.ratio < found.high < math.inf or ratio == 1.0:
        return None
    from scipy import special

    per_draw = math.log(found.high / found.ratio) * math.sqrt(found.pairs)
    spread = per_draw / float(special.stdtrit(found.pairs - 1, 0.5 + 0.5 * confidence)) / abs(math.log(ratio))
    quantiles = 0.5 + 0.5 * confidence, power
    n = max(2, math.floor((float(np.sum(special.ndtri(quantiles))) * spread) ** 2))
    while float(np.sum(special.stdtrit(n - 1, quantiles))) * spread > math.sqrt(n):
        n += 1
    return n


class Outcomes(NamedTuple):
    """Counts of paired runs that ended differently, with their test."""

    first: int
    """Pairs of which the first alone failed, or more of the first."""
    second: int
    """Pairs of which the second did."""
    pairs: int
    p: float
    """Probability of a difference as large, or larger, where both fail as often."""


def mcnemar(first: ArrayLike, second: ArrayLike) -> Outcomes:
    """Return the exact McNemar test of paired failures, two-sided.

    p = min(1, 2 P(B <= min(m, n))), B binomial of m + n and 1/2, m and n the pairs that differ either way. McNemar,
    Psychometrika 12 (1947), 153.

    Args:
        first, second: Of each pair whether it failed, or what share or number of its runs did, (N,) each.
    """
    from scipy import special

    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    m, n = int(np.sum(a > b)), int(np.sum(b > a))
    return Outcomes(m, n, len(a), min(1.0, 2.0 * float(special.bdtr(min(m, n), m + n, 0.5))))


def geometric_mean(values: Sequence[float | None]) -> Ratio:
    """Return the geometric mean of a positive metric over draws, with its interval: its `paired_ratio` to 1."""
    return paired_ratio(values, [1.0] * len(values))


def median_interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, float, float]:
    """Return the median of a sample with the interval of order statistics x_(r), x_(n+1-r) for that of the population.

    r is the largest with P(B < r) <= (1 - confidence)/2, B binomial of n and 1/2: whatever the distribution, infinite
    values included, the coverage is at least the confidence. Ends are NaN where n is too small for any, as below 6 at
    95 %.

    Args:
        values: The sample, (n,); NaN is no value, and of none all three are NaN.
        confidence: Probability content of the interval [1].
    """
    from scipy import special

    known = np.sort(np.asarray(values, dtype=np.float64))
    known = known[~np.isnan(known)]
    n = len(known)
    if n == 0:
        return math.nan, math.nan, math.nan
    lower, upper = float(known[(n - 1) // 2]), float(known[n // 2])
    median = lower if lower == upper else 0.5 * (lower + upper)
    r = int(np.searchsorted(special.bdtr(np.arange(n), n, 0.5), 0.5 * (1.0 - confidence), side="right"))
    return (median, float(known[r - 1]), float(known[n - r])) if r else (median, math.nan, math.nan)


class Share(NamedTuple):
    """Successes out of trials, with an interval for the probability of success."""

    successes: int
    trials: int
    low: float
    """Lower end of the interval [1]."""
    high: float
    """Upper end."""


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> Share:
    """Return a share with its exact binomial interval, whose coverage is at least the confidence.

    low solves P(X >= successes) = (1 - confidence)/2 and high P(X <= successes) = (1 - confidence)/2, X binomial:
    quantiles of beta distributions. Clopper and Pearson, Biometrika 26 (1934), 404.

    Args:
        successes: Number of successes.
        trials: Number of independent trials, at least one.
        confidence: Probability content of the interval [1].

    Raises:
        ResultError: there is no trial, or a number of successes that cannot be.
    """
    from scipy import special

    if not 0 <= successes <= trials or trials == 0:
        raise ResultError(f"{successes} of {trials} is not a share")
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if successes == 0 else float(special.betaincinv(successes, trials - successes + 1, tail))
    high = 1.0 if successes == trials else float(special.betaincinv(successes + 1, trials - successes, 1.0 - tail))
    return Share(successes, trials, low, high)


def cvar(values: ArrayLike, share: float, higher_is_worse: bool = True) -> Array:
    """Return the conditional value at risk: the mean of the worst `share` of a sample.

    Where share n is not whole, the value at the edge counts with the fraction that is left: of 30 values the worst
    tenth is the mean of 3, the worst 5 % (the worst + half of the second) / 1.5. Rockafellar and Uryasev, Journal of
    Banking & Finance 26 (2002), 1443, for a sample of equally likely values.

    Args:
        values: Samples along the last axis, (..., N), N at least 1; NaN is no value, and a sample of none has no tail.
        share: Fraction of the sample [1], above 0, at most 1.
        higher_is_worse: Whether the worst are the largest.

    Returns:
        (...,).

    Raises:
        ResultError: there is no value, or the share is not one.
    """
    sample = np.asarray(values, dtype=np.float64)
    if not sample.size or not 0.0 < share <= 1.0:
        raise ResultError(f"the worst {share:g} of {sample.size} values has no mean")
    worst = -np.sort(-sample, axis=-1) if higher_is_worse else np.sort(sample, axis=-1)  # NaN last
    count = np.sum(np.isfinite(sample), axis=-1, keepdims=True)
    weights = np.clip(share * count - np.arange(sample.shape[-1]), 0.0, 1.0)
    tail: Array = (
        np.sum(weights * np.nan_to_num(worst), axis=-1)
        / np.where(count > 0, weights.sum(axis=-1, keepdims=True), np.nan)[..., 0]
    )
    return tail


def undominated(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the Pareto-optimal points, both coordinates being better when lower."""
    return [i for i, (x, y) in enumerate(points) if not any(a <= x and b <= y and (a < x or b < y) for a, b in points)]
