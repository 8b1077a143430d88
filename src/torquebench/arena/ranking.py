"""Ranks entries by scores paired by draw, with the spread over draws and the spread over tunings counted together.

Nothing here knows a law: entries are their scores. Two entries tie where the interval of their ratio holds 1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from torquebench.kernel import Array
from torquebench.statistics import Ratio, mcnemar, mean_interval

CONFIDENCE = 0.95
TOLERANCE = 1.25
"""Chattering on test draws, over the level, beyond which an entry does not count as one of that level [1]."""


class Scores(NamedTuple):
    """A metric of an entry at one level of chattering on one chain."""

    values: Array
    """A positive metric, (tunings, conditions, draws); NaN where the run failed."""
    once: frozenset[int] = frozenset()
    """Numbers of the conditions in which nothing is random: one run stands for all draws."""

    @property
    def runs(self) -> Array:
        """Share of the tunings whose run failed, of each run that was made, (runs,)."""
        failed = np.isnan(self.values).mean(axis=0)
        return np.concatenate([own[:1] if i in self.once else own for i, own in enumerate(failed)])

    @property
    def logs(self) -> Array:
        """Mean over conditions of ln, (tunings, draws); NaN where a run of the draw failed."""
        return np.asarray(np.mean(_logs(self), axis=1))

    def first(self, draws: int | None) -> Scores:
        """Return the scores of the first draws alone; None for all."""
        return self._replace(values=self.values[..., :draws])


NO_RATIO = Ratio(math.nan, math.nan, math.nan, 0, (0, 0), 0)


def compare(a: Scores, b: Scores, confidence: float = CONFIDENCE, looks: int = 1) -> Ratio:
    """Return the ratio of a's metric to b's over paired draws.

    The difference of ln, averaged over conditions and tunings, has Student's interval over draws; the means of single
    tunings have Welch's. With half-widths h_d and h_t the interval is the ratio times exp(+-sqrt(h_d^2 + h_t^2)): a
    difference that another tuning seed would turn round is none. A run that all tunings of a, or of b, fail in is left
    out by itself: who fails in one condition is compared in the others. Elsewhere the tunings that complete count.

    Args:
        a, b: Scores under the same conditions; of one with more draws than the other the first ones count.
        confidence: Probability content of the interval [1].
        looks: How often the pair is looked at while draws come in; the probability to miss over draws is divided by it
            (Bonferroni), so that one may stop at any look.
    """
    return _compared(a, b, confidence, looks)[0]


def _compared(a: Scores, b: Scores, confidence: float, looks: int) -> tuple[Ratio, float, float, float]:
    """Return the ratio, its ln, and the half-widths of that over draws and over tunings."""
    a, b = _in_common(a, b)
    x, y = _logs(a), _logs(b)
    done = ~np.isnan(x), ~np.isnan(y)
    both: NDArray[np.bool_] = np.any(done[0], axis=0) & np.any(done[1], axis=0)
    known = both.any(axis=0)
    if not known.any():
        return NO_RATIO, math.nan, math.nan, math.nan
    own, other = _mean(x, done[0], 0), _mean(y, done[1], 0)
    mean, half = mean_interval(_mean(own - other, both, 0)[known].tolist(), _of_a_look(confidence, looks))
    single, singles = (_mean(z - 0.5 * (own + other), it & both, (1, 2)) for z, it in zip((x, y), done, strict=True))
    tuning = _welch(single[~np.isnan(single)], singles[~np.isnan(singles)], confidence)
    failed = [int((~it).any(axis=(0, 1)).sum()) for it in done]
    counts = int(known.sum()), (failed[0], failed[1]), int((~known).sum())
    return Ratio.of_logs(mean, math.hypot(half, tuning), *counts), mean, half, tuning


def _in_common(a: Scores, b: Scores) -> tuple[Scores, Scores]:
    draws = min(a.values.shape[2], b.values.shape[2])
    return a.first(draws), b.first(draws)


def _of_a_look(confidence: float, looks: int) -> float:
    """Return the confidence of one of several looks, all of which hold with the whole one."""
    return 1.0 - (1.0 - confidence) / looks


def _logs(scores: Scores) -> Array:
    with np.errstate(divide="ignore"):
        found: Array = np.log(scores.values)
    return found


def _mean(z: Array, where: NDArray[np.bool_], axis: int | tuple[int, ...]) -> Array:
    """Return the mean of those that count; NaN of none."""
    count = where.sum(axis=axis)
    found: Array = np.where(where, z, 0.0).sum(axis=axis) / np.where(count, count, np.nan)
    return found


def _welch(x: Array, y: Array, confidence: float) -> float:
    """Return the half-width of Welch's interval for the difference of two means; 0 where nothing spreads."""
    parts = [(float(np.var(z, ddof=1)) / len(z), len(z) - 1) for z in (x, y) if len(z) > 1]
    variance = sum(part for part, _ in parts)
    if variance <= 0.0:
        return 0.0
    free = variance * variance / sum(part * part / degrees for part, degrees in parts)
    return float(special.stdtrit(free, 0.5 + 0.5 * confidence)) * math.sqrt(variance)


def fails_more(a: Scores, b: Scores, confidence: float = CONFIDENCE, looks: int = 1) -> bool:
    """Whether `a` fails in more runs than `b`, by more than chance as of `mcnemar`; arguments as of `compare`."""
    a, b = _in_common(a, b)
    found = mcnemar(a.runs, b.runs)
    return found.first > found.second and found.p < 1.0 - _of_a_look(confidence, looks)


def verdict(a: Scores, b: Scores, confidence: float = CONFIDENCE, looks: int = 1) -> int:
    """Return 1 where a beats b, -1 where b beats a, 0 where they tie.

    Who beats fails less, or no more and its error is smaller, by more than chance and tuning explain. It fails less
    where `fails_more` says so of the other, and Welch's interval of the shares of runs that the single tunings fail in
    holds no zero: one tuning of three that fails everywhere keeps a law from being better, and makes it no worse.

    Args:
        a, b, confidence, looks: As of `compare`.
    """
    return _decide(a, b, confidence, looks)[0]


def is_open(a: Scores, b: Scores, confidence: float = CONFIDENCE, looks: int = 1) -> bool:
    """Whether two entries that tie might be told apart with more draws.

    No draw decides a pair whose interval over draws lies within that over tunings: other tuning seeds would turn it
    round. Where they fail in different numbers of runs, draws may tell if single tunings differ in it by as much.

    Args:
        a, b, confidence, looks: As of `compare`.
    """
    return _decide(a, b, confidence, looks)[1]


def _decide(a: Scores, b: Scores, confidence: float, looks: int) -> tuple[int, bool]:
    """Return the verdict, as of `verdict`, and whether further draws may change it, as of `is_open`."""
    a, b = _in_common(a, b)
    fails = int(fails_more(a, b, confidence, looks)) - int(fails_more(b, a, confidence, looks))
    unlike = _more_failures(a, b, confidence)
    if fails and fails == unlike:
        return -fails, False
    found, mean, half, tuning = _compared(a, b, confidence, looks)  # NaN of a pair that completed no draw in common
    better = int(found.below) - int(found.above)
    if better and better != fails:
        return better, False
    return 0, abs(mean) + half > tuning or unlike != 0


def _more_failures(a: Scores, b: Scores, confidence: float) -> int:
    """Return 1 where a's tunings fail in a larger share of runs than other seeds would explain, -1 for b, else 0."""
    own, other = (np.isnan(scores.values).mean(axis=(1, 2)) for scores in (a, b))
    apart = float(own.mean() - other.mean())
    return 0 if abs(apart) <= _welch(own, other, confidence) else round(math.copysign(1.0, apart))


class Standing(NamedTuple):
    """Rank of one entry, with the figures behind it."""

    entry: str
    rank: int | None
    """1 + how many entries are better; None of one that is not ranked."""
    last: int | None
    """Last rank that it may have: the number of entries that are not worse."""
    value: float
    """Geometric mean of the metric; NaN without a draw that completed."""
    low: float
    high: float
    """Ends of its interval over draws."""
    tuning: float
    """Largest mean of a tuning over the smallest [1]."""
    chattering: float
    """Geometric mean of chattering on test draws [% of the torque limit]."""
    failed: int
    runs: int
    """Runs that failed, of how many."""
    note: str = ""
    """Reason why it is not ranked."""


def rank(scores: Mapping[str, Scores], confidence: float = CONFIDENCE, looks: int = 1) -> dict[str, tuple[int, int]]:
    """Return the first and the last rank that each entry may have: 1 + how many are better, and how many are not worse.

    Entries that tie may share ranks; where nothing can be told of an entry, it has all of them.

    Args:
        scores: Entry -> what it has to show, all under the same conditions.
        confidence, looks: Of each comparison, as of `compare`.
    """
    names = list(scores)
    better, worse = dict.fromkeys(names, 0), dict.fromkeys(names, 0)
    for name, other in itertools.combinations(names, 2):
        found = verdict(scores[name], scores[other], confidence, looks)
        if found:
            winner, loser = (name, other) if found > 0 else (other, name)
            better[loser] += 1
            worse[winner] += 1
    return {name: (1 + better[name], len(names) - worse[name]) for name in names}


def mean_of(scores: Scores, confidence: float = CONFIDENCE) -> tuple[float, float, float, float]:
    """Return the geometric mean, the ends of its interval over draws, and the largest tuning's mean over the smallest.

    Args:
        scores: What an entry has to show.
        confidence: Probability content of the interval [1].
    """
    logs = scores.logs
    logs = logs[:, ~np.isnan(logs).any(axis=0)]
    if not logs.size:
        return math.nan, math.nan, math.nan, math.nan
    mean, half = mean_interval(logs.mean(axis=0).tolist(), confidence)
    own = logs.mean(axis=1)
    found = Ratio.of_logs(mean, half, logs.shape[1], (0, 0), 0)
    return *found[:3], math.exp(min(float(own.max() - own.min()), 700.0))


def mean_over_runs(scores: Scores, least: float = 0.0) -> float:
    """Return the geometric mean over all runs that completed; NaN where none did.

    Args:
        scores: What an entry has to show.
        least: What each counts as at least.
    """
    found = _logs(scores._replace(values=np.maximum(scores.values, least)))
    return float(np.exp(_mean(found, ~np.isnan(found), (0, 1, 2))))


def best_at(points: Sequence[tuple[float, float]], level: float) -> int | None:
    """Return the number of the point with the least error at no more chattering than a level; None without one.

    Args:
        points: Chattering and error of each; NaN of one that failed.
        level: The level, in the unit of the chattering.
    """
    known = [(error, i) for i, (chattering, error) in enumerate(points) if chattering <= level and error == error]
    return min(known)[1] if known else None
