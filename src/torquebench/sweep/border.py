"""Borders of a sweep: along one gain of a law, where it starts to shake."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.statistics import median_interval

TRIED = 7
"""Values, both ends among them, at which a border is looked for before it is narrowed down."""
COLUMNS = ("border", "border_before", "border_last", "border_predicted")
"""Columns of a table with borders: the fields of `Found`, and the border that describing functions predict."""


class Found(NamedTuple):
    """Value at which something starts on the way from one value to another, to a stated share of the value."""

    border: float
    """First value with it; infinite where there is none."""
    before: float
    """Last value without it before the border; NaN where the first value has it."""
    last: float
    """Last value without it; other than `before` where it stops again on the way. NaN where there is none."""


def find_border(has: Callable[[float], bool], start: float, stop: float, within: float) -> Found:
    """Look at a few values in equal ratios, then halve the ratio of each change that matters.

    Args:
        has: Whether it is there at a value.
        start, stop: The first value and the last, both positive; where `start` is the larger the way leads down.
        within: Largest distance of the two ends of a border, as a share of the value.
    """
    way = [float(x) for x in np.geomspace(start, stop, TRIED)]
    way[0], way[-1] = start, stop
    seen = [bool(has(x)) for x in way]

    def narrowed(without: float, there: float) -> tuple[float, float]:
        while abs(math.log(there / without)) > math.log1p(within):
            middle = math.sqrt(without * there)
            without, there = (without, middle) if has(middle) else (middle, there)
        return without, there

    if not any(seen):
        return Found(math.inf, stop, stop)
    first, last = seen.index(True), max((i for i, x in enumerate(seen) if not x), default=-1)
    before, border = narrowed(way[first - 1], way[first]) if first else (math.nan, start)
    if last < first:
        return Found(border, before, before)
    return Found(border, before, stop if last == len(way) - 1 else narrowed(way[last], way[last + 1])[0])


class Level(NamedTuple):
    """Borders of one law under one condition, over the draws."""

    border: float
    """Median; infinite where most draws have none."""
    low: float
    """Lower end of its 95 % interval; NaN of fewer than six draws."""
    high: float
    """Upper end."""
    before: float
    """Median of the last values without it before the border; NaN where most have it from the first value on."""
    last: float
    """Greatest distance that a draw goes back to stillness beyond its border: the last value without it, else NaN."""
    predicted: float
    """Median of the predictions; NaN where there is none."""


def level_of(table: Mapping[str, NDArray[Any]], rows: NDArray[np.intp]) -> Level:
    """Return the borders of some rows of a table, of one law under one condition.

    Args:
        table: The table, with `COLUMNS`.
        rows: Positions of the rows.
    """
    border, before, last, predicted = (np.asarray(table[name][rows], dtype=np.float64) for name in COLUMNS)
    again = last[np.isfinite(border) & (last != before) & ~np.isnan(last)]
    starts = np.where(np.isnan(before), -np.inf, before)[~np.isnan(border)]
    middle = median_interval(starts)[0]
    return Level(
        *median_interval(border),
        middle if np.isfinite(middle) else math.nan,
        float(np.max(again)) if len(again) else math.nan,
        median_interval(predicted)[0],
    )
