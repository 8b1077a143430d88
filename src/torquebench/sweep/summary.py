"""What a sweep's table says of each law in each case: successes, figures with their tails, ratios to a reference."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ResultError, did_you_mean
from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.plain import plain
from torquebench.statistics import Ratio, Share, clopper_pearson, cvar, geometric_mean, paired_ratio
from torquebench.sweep.table import (
    Rows,
    Table,
    check_table,
    completed,
    controllers,
    grid_keys,
    metric_keys,
    metric_values,
    row_values,
    rows_by,
    varied_keys,
)

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
    """Index of the worst run, by which it can be run again."""
    worst_draw: int


class Failure(NamedTuple):
    """The run that failed first."""

    row: int
    """Its index, by which it can be run again."""
    draw: int
    outcome: str
    at: float
    """Number of the control instant at which it failed."""


@dataclass(frozen=True, slots=True)
class Group:
    """One law in one case."""

    case: int
    values: Mapping[str, float | str | None]
    """Grid key -> its value in this case; None for a key that this law does not have."""
    controller: str
    successes: Share
    """Share of the runs that completed, with the Clopper-Pearson interval of the probability to complete; NaN where
    all draws are alike: nothing that is drawn acts in this case, so there is nothing to infer."""
    outcomes: Mapping[str, int]
    """Number of runs by outcome."""
    earliest_failure: Failure | None
    figures: Mapping[str, Figure]
    """Metric -> its figures; metrics without any value are left out."""
    ratios: Mapping[str, Ratio]
    """Metric -> geometric mean over draws of this law's over the reference's; none where a run has the value 0."""


@dataclass(frozen=True, slots=True)
class Overall:
    """One law over all cases."""

    controller: str
    successes: int
    runs: int
    figures: Mapping[str, Figure]
    """Metric -> its figures over all runs of the law."""
    ratios: Mapping[str, Ratio]
    """Metric -> as in `Group`, of each draw's geometric mean over the cases: draws are independent, cases are not."""


@dataclass(frozen=True, slots=True)
class Summary:
    """A sweep's table, summarised; intervals are at 95 %, each by itself."""

    reference: str
    """Controller that the ratios are to."""
    grid: tuple[str, ...]
    """Keys with one value in each case."""
    drawn: tuple[str, ...]
    """Keys whose value is drawn."""
    metrics: tuple[str, ...]
    groups: tuple[Group, ...]
    """By case, then in the controllers' order."""
    overall: tuple[Overall, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain data for `json.dumps`, without NaN."""
        data: dict[str, Any] = plain(self)
        return data


def summarise(table: Table, reference: str | None = None) -> Summary:
    """Summarise a sweep's table; runs that failed are counted and enter no figure.

    Args:
        table: The table.
        reference: Controller that the ratios are to; None for the first.

    Raises:
        ResultError: it is not a sweep's table, or the reference is not one of its controllers.
    """
    check_table(table)
    names = controllers(table)
    base = names[0] if reference is None else reference
    if base not in names:
        raise ResultError(f"no controller '{base}' in the sweep{did_you_mean(base, names)}")
    grid, metrics = grid_keys(table), metric_keys(table)
    drawn = tuple(key for key in varied_keys(table) if key not in grid)
    groups, overall = list[Group](), list[Overall]()
    by_group, by_law = rows_by(table, "case", "controller"), rows_by(table, "controller")
    for (case, law), rows in by_group.items():
        groups.append(
            Group(
                case,
                row_values(table, grid, int(rows[0])),
                law,
                _share(table, rows, metrics),
                dict(Counter(table["outcome"][rows].tolist())),
                _earliest_failure(table, rows),
                *_figures(table, rows, by_group[case, base], metrics),
            )
        )
    for (law,), rows in by_law.items():
        successes = int(completed(table, rows).sum())
        overall.append(Overall(law, successes, len(rows), *_figures(table, rows, by_law[base,], metrics)))
    return Summary(base, grid, drawn, metrics, tuple(groups), tuple(overall))


def figure_of(table: Table, rows: Rows, key: str) -> Figure | None:
    """Return the figures of one metric over some rows; None when no run of them completed with a value.

    Args:
        table: The table.
        rows: Positions of the rows.
        key: The metric.
    """
    values = metric_values(table, rows, key)
    known = np.isfinite(values)
    if not known.any():
        return None
    values, rising = values[known], METRICS[key].better == "lower"
    worst = int(np.argmax(values) if rising else np.argmin(values))
    row = rows[known][worst]
    return Figure(
        len(values),
        float(np.mean(values)),
        float(np.median(values)),
        cvar(values.tolist(), TAIL, rising),
        float(values[worst]),
        int(table["index"][row]),
        int(table["draw"][row]),
    )


def by_draw(table: Table, rows: Rows, key: str) -> tuple[NDArray[np.int64], Array]:
    """Return the draws of some rows and a metric in each, its geometric mean where a draw has several rows.

    A draw has NaN when one of its runs failed or lacks the metric: the mean is never one of the survivors.

    Args:
        table: The table.
        rows: Positions of the rows.
        key: The metric.
    """
    values = metric_values(table, rows, key)
    draws, place = np.unique(table["draw"][rows], return_inverse=True)
    logs = np.log(values, where=values > 0.0, out=np.full(len(values), np.nan))
    return draws, np.exp(np.bincount(place, logs) / np.bincount(place))


def level(table: Table, rows: Rows, key: str) -> Ratio | None:
    """Return the geometric mean of a metric over the draws of some rows, with its interval.

    None without a value, and where a run has the value 0, which has no geometric mean.

    Args:
        table: The table.
        rows: Positions of the rows.
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
        rows: Positions of one law's rows.
        other: Positions of the reference's rows.
        key: The metric.
    """
    (draws, one), (others, two) = by_draw(table, rows, key), by_draw(table, other, key)
    _, mine, theirs = np.intersect1d(draws, others, assume_unique=True, return_indices=True)
    a, b = one[mine], two[theirs]
    both = np.isfinite(a + b)
    if not both.any() or _has_zero(table, rows, key) or _has_zero(table, other, key):
        return None
    ratio = paired_ratio(_known(a), _known(b))
    same = np.ptp(a[both]) == 0.0 and np.ptp(b[both]) == 0.0
    return ratio._replace(low=np.nan, high=np.nan) if same else ratio


def _has_zero(table: Table, rows: Rows, key: str) -> bool:
    return bool(np.any(metric_values(table, rows, key) <= 0.0))


def _known(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _earliest_failure(table: Table, rows: Rows) -> Failure | None:
    failed = rows[~completed(table, rows)]
    if len(failed) == 0:
        return None
    first = failed[np.argmin(table["failed_at"][failed])]
    return Failure(*(table[name][first].item() for name in ("index", "draw", "outcome", "failed_at")))


def _share(table: Table, rows: Rows, metrics: Sequence[str]) -> Share:
    share = clopper_pearson(int(completed(table, rows).sum()), len(rows))
    columns = [table[name][rows] for name in ("failed_at", *metrics)]
    alike = len(rows) > 1 and all(len(np.unique(column)) == 1 for column in columns)
    return share._replace(low=np.nan, high=np.nan) if alike else share


def _figures(
    table: Table, rows: Rows, other: Rows, metrics: Sequence[str]
) -> tuple[dict[str, Figure], dict[str, Ratio]]:
    figures = {key: figure_of(table, rows, key) for key in metrics}
    ratios = {key: ratio_of(table, rows, other, key) for key in metrics}
    return (
        {key: figure for key, figure in figures.items() if figure is not None},
        {key: ratio for key, ratio in ratios.items() if ratio is not None},
    )
