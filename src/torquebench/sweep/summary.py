"""What a sweep's table says of each law in each case: successes, figures with their tails, ratios to a reference."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from torquebench.errors import ResultError, did_you_mean
from torquebench.plain import plain
from torquebench.statistics import Ratio, Share, clopper_pearson
from torquebench.sweep.columns import (
    Rows,
    Table,
    checked,
    completed,
    controllers,
    grid_keys,
    metric_keys,
    rows_by,
    values_of,
    varied_keys,
)
from torquebench.sweep.reduce import Figure, figure_of, ratio_of

T = TypeVar("T")


class Failure(NamedTuple):
    """The run that failed first."""

    row: int
    """Its index: what replays it."""
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
    """Runs that completed, of all of them, with the Clopper-Pearson interval of the probability to complete; NaN where
    all draws are alike: nothing that is drawn acts in this case, and so there is nothing to infer."""
    outcomes: Mapping[str, int]
    """How often each outcome came about."""
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
        """Return plain data, as `json.dumps` takes it; it never holds NaN."""
        found: dict[str, Any] = plain(self)
        return found


def summarise(table: Table, reference: str | None = None) -> Summary:
    """Summarise a sweep's table; runs that failed are counted and enter no figure.

    Args:
        table: The table.
        reference: Controller that the ratios are to; None for the first.

    Raises:
        ResultError: it is no sweep's table, or the reference is none of its controllers.
    """
    checked(table)
    names = controllers(table)
    base = names[0] if reference is None else reference
    if base not in names:
        raise ResultError(f"no controller '{base}' in the sweep{did_you_mean(base, names)}")
    grid, metrics = grid_keys(table), metric_keys(table)
    drawn = tuple(key for key in varied_keys(table) if key not in grid)
    by_group = rows_by(table, "case", "controller")
    groups = [_group(table, rows, by_group[case, base], grid, metrics) for (case, _), rows in by_group.items()]
    by_law = rows_by(table, "controller")
    overall = [_overall(table, rows, by_law[base,], metrics) for rows in by_law.values()]
    return Summary(base, grid, drawn, metrics, tuple(groups), tuple(overall))


def _group(table: Table, rows: Rows, other: Rows, keys: tuple[str, ...], metrics: Sequence[str]) -> Group:
    done = completed(table, rows)
    failures = rows[~done]
    first = None
    if len(failures):
        at = failures[np.argmin(table["failed_at"][failures])]
        first = Failure(
            int(table["index"][at]), int(table["draw"][at]), str(table["outcome"][at]), float(table["failed_at"][at])
        )
    return Group(
        int(table["case"][rows[0]]),
        values_of(table, keys, int(rows[0])),
        str(table["controller"][rows[0]]),
        _share(table, rows, metrics),
        dict(Counter(map(str, table["outcome"][rows].tolist()))),
        first,
        _defined({key: figure_of(table, rows, key) for key in metrics}),
        _defined({key: ratio_of(table, rows, other, key) for key in metrics}),
    )


def _share(table: Table, rows: Rows, metrics: Sequence[str]) -> Share:
    share = clopper_pearson(int(completed(table, rows).sum()), len(rows))
    columns = [table[name][rows] for name in ("failed_at", *metrics)]
    alike = len(rows) > 1 and all(np.array_equal(own, np.roll(own, 1), equal_nan=True) for own in columns)
    return share._replace(low=np.nan, high=np.nan) if alike else share


def _overall(table: Table, rows: Rows, other: Rows, metrics: Sequence[str]) -> Overall:
    return Overall(
        str(table["controller"][rows[0]]),
        int(completed(table, rows).sum()),
        len(rows),
        _defined({key: figure_of(table, rows, key) for key in metrics}),
        _defined({key: ratio_of(table, rows, other, key) for key in metrics}),
    )


def _defined(found: Mapping[str, T | None]) -> dict[str, T]:
    return {key: value for key, value in found.items() if value is not None}
