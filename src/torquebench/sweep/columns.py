"""Reading a sweep's table: which columns vary, which are metrics, which rows belong together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.metrics import METRICS

Table: TypeAlias = Mapping[str, NDArray[Any]]
"""Column name -> values, all of equal length, one row for each closed loop."""
Rows: TypeAlias = NDArray[np.intp]
"""Which rows of a table are meant: positions in it, ascending."""

FIXED = ("index", "case", "draw", "controller", "outcome", "failed_at")
"""Columns that every table has; those of varied keys and of metrics follow."""


def checked(table: Table) -> Table:
    """Return a table after a look at its form.

    Raises:
        ResultError: a column is missing or of another length than the others, or there is no row.
    """
    missing = [name for name in FIXED if name not in table]
    if missing:
        raise ResultError(f"not the table of a sweep: no column {', '.join(missing)}")
    lengths = {name: len(column) for name, column in table.items()}
    if len(set(lengths.values())) > 1 or lengths["index"] == 0:
        raise ResultError(f"not the table of a sweep: columns of {sorted(set(lengths.values()))} rows")
    return table


def varied_keys(table: Table) -> tuple[str, ...]:
    """Return the experiment's keys that the sweep varies, in the table's order."""
    return tuple(name for name in table if name not in FIXED and name not in METRICS)


def grid_keys(table: Table) -> tuple[str, ...]:
    """Return the varied keys of which each law has one value in each case; the others are drawn."""
    order = np.lexsort((table["controller"], table["case"]))
    same = _like_the_last(table["case"][order]) & _like_the_last(table["controller"][order])
    return tuple(key for key in varied_keys(table) if bool(np.all(_like_the_last(table[key][order])[same])))


def _like_the_last(column: NDArray[Any]) -> NDArray[np.bool_]:
    equal = column[1:] == column[:-1]
    if column.dtype.kind == "f":
        equal |= np.isnan(column[1:]) & np.isnan(column[:-1])
    return np.asarray(equal)


def metric_keys(table: Table) -> tuple[str, ...]:
    """Return the metrics that have a value in some row, in the table's order."""
    return tuple(name for name in table if name in METRICS and bool(np.any(np.isfinite(table[name]))))


def controllers(table: Table) -> tuple[str, ...]:
    """Return the controllers in order of their first rows."""
    return tuple(str(name) for name in dict.fromkeys(table["controller"].tolist()))


def rows_by(table: Table, *columns: str) -> dict[tuple[Any, ...], Rows]:
    """Return the rows that share their values in some columns, by these values, in order of their first rows.

    Args:
        table: The table.
        columns: Names of columns.
    """
    codes = [np.unique(table[name], return_inverse=True)[1] for name in columns]
    order = np.lexsort(codes[::-1])
    changed = np.any([np.diff(code[order]) != 0 for code in codes], axis=0)
    parts = sorted(np.split(order, np.flatnonzero(changed) + 1), key=lambda rows: int(rows[0]))
    return {tuple(table[name][rows[0]].item() for name in columns): rows for rows in parts}


def completed(table: Table, rows: Rows) -> NDArray[np.bool_]:
    """Return of which of some rows the run completed."""
    return np.asarray(np.isnan(table["failed_at"][rows]))


def finished(table: Table, rows: Rows, key: str) -> Array:
    """Return a metric in some rows, NaN where the run failed or has no such figure."""
    return np.where(completed(table, rows), table[key][rows], np.nan)


def values_of(table: Table, keys: tuple[str, ...], row: int) -> dict[str, float | str | None]:
    """Return what some varied keys are in one row; None for a controller that does not have the key.

    Args:
        table: The table.
        keys: Names of columns.
        row: Which row.
    """
    found: dict[str, float | str | None] = {}
    for key in keys:
        value = table[key][row]
        if table[key].dtype.kind != "f":
            found[key] = str(value) or None
        else:
            found[key] = None if np.isnan(value) else float(value)
    return found
