"""Summarises a sweep's table for each law in each case: successes, figures with their tails, ratios to a reference."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ResultError, did_you_mean
from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.plain import plain
from torquebench.statistics import (
    Outcomes,
    Ratio,
    Share,
    clopper_pearson,
    cvar,
    geometric_mean,
    mcnemar,
    mean_intervals,
)
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
    varied_keys,
)

TAIL = 0.1
"""Share of the runs that CVaR is the mean of [1]."""


class Figure(NamedTuple):
    """One metric of one law in one case, in SI units, over the runs that completed and have it."""

    defined: int
    """Runs with a value."""
    mean: float
    low: float
    """Lower end of the mean's 95 % interval, Student's over draws; NaN over all cases, where one draw runs or none
    differs."""
    high: float
    """Upper end."""
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
    outcomes: Outcomes
    """Draws in which it fails in more cases than the reference, and in fewer."""


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
    place = _places(table, names)
    cases, laws = place.reshape(-1, place.shape[2]), place.swapaxes(0, 1).reshape(len(names), -1)
    figures = [dict[str, Figure]() for _ in range(len(cases) + len(laws))]
    ratios = [dict[str, Ratio]() for _ in figures]
    for key in metrics:
        values = np.where(place >= 0, metric_values(table, place, key), np.nan)
        whole = values.swapaxes(0, 1).reshape(laws.shape)
        found = _figures(table, key, values.reshape(cases.shape), cases) + _figures(table, key, whole, laws, False)
        for i, (figure, ratio) in enumerate(zip(found, _ratios(values, names.index(base)), strict=True)):
            figures[i] |= {key: figure} if figure is not None else {}
            ratios[i] |= {key: ratio} if ratio is not None else {}
    shares = _shares(table, cases, metrics)
    groups = [
        Group(
            int(table["case"][rows[0]]),
            row_values(table, grid, int(rows[0])),
            names[i % len(names)],
            shares[i],
            dict(Counter(table["outcome"][rows].tolist())),
            _earliest_failure(table, rows),
            figures[i],
            ratios[i],
        )
        for i, rows in enumerate(own[own >= 0] for own in cases)
        if len(rows)
    ]
    lost = np.sum((place >= 0) & ~completed(table, place), axis=0)
    overall = [
        Overall(
            names[i],
            int(completed(table, rows).sum()),
            len(rows),
            figures[len(cases) + i],
            ratios[len(cases) + i],
            mcnemar(lost[i], lost[names.index(base)]),
        )
        for i, rows in enumerate(own[own >= 0] for own in laws)
    ]
    drawn = tuple(key for key in varied_keys(table) if key not in grid)
    return Summary(base, grid, drawn, metrics, tuple(groups), tuple(overall))


def _places(table: Table, names: Sequence[str]) -> Rows:
    """Return the positions of the rows by case, controller and draw, (C, L, D); -1 where there is none."""
    (cases, case), (laws, law), (draws, draw) = (
        np.unique(table[name], return_inverse=True) for name in ("case", "controller", "draw")
    )
    place = np.full((len(cases), len(names), len(draws)), -1)
    place[case, np.array([names.index(name) for name in laws.tolist()])[law], draw] = np.arange(len(draw))
    return place


def _figures(table: Table, key: str, values: Array, rows: Rows, independent: bool = True) -> list[Figure | None]:
    """Return the figures of a metric over each row of its values; None where no run has a value.

    Args:
        table: The table.
        key: The metric.
        values: Its values, (G, N); NaN for none.
        rows: Positions of the table's rows that they are of, (G, N).
        independent: Whether the N runs are independent draws, so that their mean has an interval.
    """
    values, rising = np.where(np.isfinite(values), values, np.nan), METRICS[key].better == "lower"
    count, mean, half = mean_intervals(values)
    ordered, last = np.sort(values, axis=1), np.maximum(count - 1, 0)  # NaN behind the last
    most, *middle = (np.take_along_axis(ordered, at[:, None], 1)[:, 0] for at in (last, last // 2, count // 2))
    half = np.where(independent & (ordered[:, 0] < most), half, np.nan)
    worst = np.argmax(np.where(np.isnan(values), -np.inf, values if rising else -values), axis=1)[:, None]
    row = np.take_along_axis(rows, worst, 1)[:, 0]
    columns = (
        count,
        mean,
        mean - half,
        mean + half,
        0.5 * (middle[0] + middle[1]),
        cvar(values, TAIL, rising),
        np.take_along_axis(values, worst, 1)[:, 0],
        table["index"][row],
        table["draw"][row],
    )
    return [Figure(*one) if one[0] else None for one in zip(*(column.tolist() for column in columns), strict=True)]


def _ratios(values: Array, base: int) -> list[Ratio | None]:
    """Return the paired ratios of a metric to a reference's: of each law in each case, then over all cases.

    Over all cases it is that of the geometric means over these. None without a pair, and where a run has the value 0.
    Where the ratio is the same in every draw, or there is one draw, its interval is NaN: nothing that is drawn shows.

    Args:
        values: The metric by case, controller and draw, (C, L, D); NaN for none.
        base: Which controller is the reference.
    """
    logs = np.log(values, where=values > 0.0, out=np.full(values.shape, np.nan))
    zero = np.any(values <= 0.0, axis=2)
    logs, zero = np.concatenate([logs, np.mean(logs, axis=0)[None]]), np.concatenate([zero, zero.any(axis=0)[None]])
    other = np.broadcast_to(logs[:, base : base + 1], logs.shape)
    pairs, mean, half = mean_intervals(logs - other)
    known, varies = np.isfinite(logs - other), np.zeros(zero.shape, np.bool_)
    for x in (logs, other):
        varies |= np.min(np.where(known, x, np.inf), axis=2) < np.max(np.where(known, x, -np.inf), axis=2)
    half = np.where(varies, half, np.nan)
    failed = [np.isnan(x).sum(axis=2) for x in (logs, other)]
    columns = [np.exp(mean), np.exp(mean - half), np.exp(mean + half), pairs, *failed, known.shape[2] - pairs]
    columns.append((pairs > 0) & ~zero & ~zero[:, base : base + 1])
    rows = zip(*(column.ravel().tolist() for column in columns), strict=True)
    return [Ratio(r, low, high, n, (a, b), out) if there else None for r, low, high, n, a, b, out, there in rows]


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


def _shares(table: Table, cases: Rows, metrics: Sequence[str]) -> list[Share]:
    """Return the share of completed runs at each row of positions, (G, N); -1 stands for none."""
    there = cases >= 0
    trials = np.sum(there, axis=1)
    alike = trials > 1
    for name in ("failed_at", *metrics):
        values = np.where(there, table[name][cases], np.nan)
        alike &= np.all((values == values[:, :1]) | (np.isnan(values) & np.isnan(values[:, :1])), axis=1)
    exact, found = cache(clopper_pearson), list[Share]()
    for successes, count in zip(np.sum(there & completed(table, cases), axis=1).tolist(), trials.tolist(), strict=True):
        share = exact(successes, max(count, 1))
        found.append(share._replace(low=np.nan, high=np.nan) if alike[len(found)] else share)
    return found
