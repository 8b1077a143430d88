"""Verdicts from figures: a case holds where the whole interval is on the claim's side of its threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

from torquebench.errors import ResultError
from torquebench.statistics import clopper_pearson, mean_interval, paired_ratio


class Verdict(StrEnum):
    """Verdict on a case, or on a claim over all its cases."""

    HOLDS = "holds"
    FAILS = "fails"
    UNDECIDED = "undecided"
    DEPENDS = "depends"
    """Of a claim alone: it holds in some cases and fails in others."""


class Interval(NamedTuple):
    """A figure over draws with its 95 % interval."""

    value: float
    """NaN where no draw has one."""
    low: float
    """Lower end; the value itself where there is one draw, which has no spread."""
    high: float
    """Upper end."""
    n: int
    """Draws behind it."""
    failed: tuple[int, int] = (0, 0)
    """Draws that speak against the law judged, and against the one beside it: its run failed, or never settled."""


class Threshold(NamedTuple):
    """Limit that a figure must stay below, or exceed, for the claim to hold."""

    limit: float
    side: str
    """``below`` or ``above``."""

    def __str__(self) -> str:
        return f"{self.side} {self.limit:g}"


Values = Sequence[float | None]
"""A figure of one law by draw. None speaks against the law: its run failed, or never settled. NaN says nothing: the
figure is not defined there, and the draw is left out."""


def ratio(of: Values, over: Values, floor: float | None = None) -> Interval:
    """Return the geometric mean of one law's figure over another's, paired by draw.

    Args:
        of, over: A figure of two laws in the same draws.
        floor: Both figures count as at least this: the ratio of two negligible figures says nothing.
    """
    failed, pairs = (_count(of), _count(over)), _pairs(of, over)
    if pairs and min(min(pair) for pair in pairs) < 0.0:
        return Interval(math.nan, math.nan, math.nan, 0, failed)
    least = 0.0 if floor is None else floor
    a, b = ([max(pair[i], least) for pair in pairs] for i in (0, 1))
    if not pairs or min(*a, *b) <= 0.0:
        return Interval(math.nan, math.nan, math.nan, 0, failed)
    found = paired_ratio(a, b)
    return _spread(Interval(found.ratio, found.low, found.high, found.pairs, failed), len(of))


def mean(of: Values, minus: Values | None = None) -> Interval:
    """Return the mean of a law's figure, or of its difference to another's, paired by draw.

    Args:
        of: The figure.
        minus: What is taken from it, in the same draws; None for nothing.
    """
    other: Values = [0.0] * len(of) if minus is None else minus
    differences = [x - y for x, y in _pairs(of, other)]
    failed = _count(of), _count(other)
    if not differences:
        return Interval(math.nan, math.nan, math.nan, 0, failed)
    middle, half = mean_interval(differences)
    return _spread(Interval(middle, middle - half, middle + half, len(differences), failed), len(of))


def share(of: Values, counted: Threshold) -> Interval:
    """Return the share of draws whose figure is on a side of a limit, with the exact binomial interval.

    Args:
        of: The figure.
        counted: Which draws count.
    """
    known = [x for x in of if x is not None and not math.isnan(x)]
    if not known:
        return Interval(math.nan, math.nan, math.nan, 0, (_count(of), 0))
    hits = sum(x < counted.limit if counted.side == "below" else x > counted.limit for x in known)
    if len(of) == 1:
        return Interval(float(hits), float(hits), float(hits), 1, (_count(of), 0))
    found = clopper_pearson(hits, len(known))
    return Interval(hits / len(known), found.low, found.high, len(known), (_count(of), 0))


def _count(values: Values) -> int:
    return sum(x is None for x in values)


def _pairs(of: Values, other: Values) -> list[tuple[float, float]]:
    """Return the figures of the draws in which both laws have one."""
    both = [(x, y) for x, y in zip(of, other, strict=True) if x is not None and y is not None]
    return [(x, y) for x, y in both if not math.isnan(x) and not math.isnan(y)]


def _spread(found: Interval, draws: int) -> Interval:
    """Return an interval, without ends where one draw is left of several: its spread is not known."""
    return found._replace(low=-math.inf, high=math.inf) if found.n == 1 < draws else found


def judge(figure: Interval, threshold: Threshold) -> Verdict:
    """Judge one figure: it holds, or fails, where its whole interval is on one side of the threshold.

    A draw in which the law that the claim speaks of has no figure speaks against the claim. Where the other law has
    none in any draw, the claim holds: there is nothing to compare with but a failure.
    """
    if figure.failed[0]:
        return Verdict.FAILS
    if not figure.n:
        return Verdict.HOLDS if figure.failed[1] else Verdict.UNDECIDED
    low, high = (figure.low, figure.high) if threshold.side == "below" else (-figure.high, -figure.low)
    limit = threshold.limit if threshold.side == "below" else -threshold.limit
    return Verdict.HOLDS if high < limit else Verdict.FAILS if low >= limit else Verdict.UNDECIDED


def all_of(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the verdict of a case that several figures decide: it holds where all do, and fails where one does."""
    if Verdict.FAILS in verdicts:
        return Verdict.FAILS
    return Verdict.UNDECIDED if Verdict.UNDECIDED in verdicts else Verdict.HOLDS


def over_cases(verdicts: Sequence[Verdict], reduced: bool = False) -> Verdict:
    """Return the verdict of a claim over its cases.

    It is undecided where at most half of the cases are decided. It depends where some hold and some fail; else those
    that are decided decide, unless more draws may turn that.

    Args:
        verdicts: Those of the cases.
        reduced: Whether there were other draws than the study asks for, so that what is undecided may still be decided.

    Raises:
        ResultError: there is no case.
    """
    if not verdicts:
        raise ResultError("a claim without a case has no verdict")
    held, fell = verdicts.count(Verdict.HOLDS), verdicts.count(Verdict.FAILS)
    if 2 * (held + fell) <= len(verdicts):
        return Verdict.UNDECIDED
    if held and fell:
        return Verdict.DEPENDS
    if reduced and held + fell < len(verdicts):
        return Verdict.UNDECIDED
    return Verdict.HOLDS if held else Verdict.FAILS
