"""Many rows of a sweep's table to one figure: mean, tail and worst run, levels and ratios draw by draw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.statistics import Ratio, cvar, geometric_mean, paired_ratio
from torquebench.sweep.columns import Rows, Table, finished

TAIL = 0.1
"""Share of the runs that CVaR is the mean of [1]."""


class Figure(NamedTuple):
    """One metric of one law in one case, in SI units, over the runs that completed and have it."""

    defined: int
    """Runs with a value."""
    mean: float
    median: float
    cvar: float
    """Mean of the worst `TAIL` of the runs."""
    worst: float
    worst_row: int
    """Index of the worst run: what replays it."""
    worst_draw: int


def figure_of(table: Table, rows: Rows, key: str, tail: float = TAIL) -> Figure | None:
    """Return the figures of one metric over some rows; None when no run of them completed with a value.

    Args:
        table: The table.
        rows: Which rows.
        key: The metric.
        tail: Share of the runs that CVaR is the mean of [1].
    """
    values = finished(table, rows, key)
    known = np.isfinite(values)
    if not known.any():
        return None
    own, rising = values[known], METRICS[key].better == "lower"
    at = rows[known][np.argmax(own) if rising else np.argmin(own)]
    return Figure(
        len(own),
        float(np.mean(own)),
        float(np.median(own)),
        cvar(own.tolist(), tail, rising),
        float(table[key][at]),
        int(table["index"][at]),
        int(table["draw"][at]),
    )


def by_draw(table: Table, rows: Rows, key: str) -> tuple[NDArray[np.int64], Array]:
    """Return the draws of some rows and a metric in each, its geometric mean where a draw has several rows.

    A draw has NaN when one of its runs failed or has no such figure: survivors are not averaged.

    Args:
        table: The table.
        rows: Which rows.
        key: The metric.
    """
    values = finished(table, rows, key)
    draws, place = np.unique(table["draw"][rows], return_inverse=True)
    logs = np.log(values, where=values > 0.0, out=np.full(len(values), np.nan))
    return draws, np.exp(np.bincount(place, logs) / np.bincount(place))


def level(table: Table, rows: Rows, key: str) -> Ratio | None:
    """Return the geometric mean of a metric over the draws of some rows, with its interval.

    None without a value, and where a run has the value 0, of which there is no geometric mean.

    Args:
        table: The table.
        rows: Which rows.
        key: The metric.
    """
    _, values = by_draw(table, rows, key)
    if _has_zero(table, rows, key):
        return None
    return geometric_mean(_known(values)) if np.isfinite(values).any() else None


def ratio_of(table: Table, rows: Rows, other: Rows, key: str) -> Ratio | None:
    """Return the paired ratio of a metric in some rows to that in others, draw by draw.

    None without a pair, and where a run has the value 0. Where the ratio is the same in every draw, or there is one
    draw, its interval is NaN: nothing that is drawn shows in it.

    Args:
        table: The table.
        rows, other: Which rows: of one law and of the reference.
        key: The metric.
    """
    (draws, one), (others, two) = by_draw(table, rows, key), by_draw(table, other, key)
    _, here, there = np.intersect1d(draws, others, assume_unique=True, return_indices=True)
    a, b = one[here], two[there]
    both = np.isfinite(a + b)
    if not both.any() or _has_zero(table, rows, key) or _has_zero(table, other, key):
        return None
    ratio = paired_ratio(_known(a), _known(b))
    same = np.ptp(a[both]) == 0.0 and np.ptp(b[both]) == 0.0
    return ratio._replace(low=np.nan, high=np.nan) if same else ratio


def _has_zero(table: Table, rows: Rows, key: str) -> bool:
    return bool(np.any(finished(table, rows, key) <= 0.0))


def _known(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
