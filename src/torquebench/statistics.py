"""Comparing laws draw by draw: geometric-mean ratios of a metric with intervals, failures counted apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from torquebench.errors import ResultError


class Ratio(NamedTuple):
    """How large one law's metric is beside another's, over paired draws."""

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
    n = len(values)
    if n == 1:
        return float(values[0]), 0.0
    half = stats.t.ppf(0.5 + 0.5 * confidence, n - 1) * np.std(values, ddof=1) / math.sqrt(n)
    return float(np.mean(values)), float(half)


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
    if not pairs:
        raise ResultError("there is no draw in which both laws completed")
    if any(not (x > 0.0 and y > 0.0) or math.isinf(x) or math.isinf(y) for x, y in pairs):
        raise ResultError("a ratio needs metrics that are positive and finite")
    mean, half = mean_interval([math.log(x / y) for x, y in pairs], confidence)
    failed = sum(x is None for x in a), sum(y is None for y in b)
    return Ratio(math.exp(mean), math.exp(mean - half), math.exp(mean + half), len(pairs), failed)
