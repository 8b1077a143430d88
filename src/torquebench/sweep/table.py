"""The table of a sweep, one row for each closed loop: its columns, and which of its rows belong together."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from torquebench.certificates import FIGURES
from torquebench.errors import ResultError
from torquebench.experiment.sweep_section import Axis, Value
from torquebench.kernel import Array
from torquebench.metrics import METRICS, applicable
from torquebench.references.reference import depends_on_arm
from torquebench.sim.trajectory import Outcome
from torquebench.sweep.border import COLUMNS
from torquebench.sweep.plan import Plan

Table: TypeAlias = Mapping[str, NDArray[Any]]
"""Column name -> values, all of one length: a whole table, or the rows of one shard."""
Rows: TypeAlias = NDArray[np.intp]
"""Positions of some rows of a table, ascending."""

FIXED = ("index", "case", "draw", "controller", "outcome", "failed_at")
"""Columns that every table has; those of varied keys and of metrics follow."""
REFUSED = "REFUSED"
"""Outcome of a run that cannot be built, such as one whose drawn model is not a possible arm."""
OUTCOMES = (*(outcome.name for outcome in Outcome), REFUSED)


def empty_columns(plan: Plan, rows: int) -> dict[str, NDArray[Any]]:
    """Return columns of zeros in the table's order: those of every table, varied keys, metrics.

    Args:
        plan: The sweep.
        rows: Length of the columns.
    """
    floats = np.dtype("<f8")
    fixed = (*[np.dtype("<i8")] * 3, _text(plan.controllers), _text(OUTCOMES), floats)
    kinds: dict[str, Any] = dict(zip(FIXED, fixed, strict=True))
    kinds |= {key: floats for key in (*(axis.key for axis in plan.keys.axes), *(r.key for r in plan.keys.random))}
    kinds |= {axis.key: _text(words(axis)) for axis in _axes(plan) if not axis.numeric}
    keep = plan.keys.keep
    asked = {"" if isinstance(keep, str) else keep.by} & set(METRICS.names())
    shown = {info.key for info in applicable(depends_on_arm(plan.first.reference))} | asked
    kinds |= dict.fromkeys((key for key in METRICS.names() if key in shown), floats)
    kinds |= dict.fromkeys(plan.figures, floats)
    return {name: np.zeros(rows, kind) for name, kind in kinds.items()}


def key_values(plan: Plan, case: int, draw: int) -> dict[str, list[float | str]]:
    """Return each varied key's value for every controller, as the table shows it; NaN or '' if it lacks the key.

    Args:
        plan: The sweep.
        case: Number of the case.
        draw: Number of the draw.
    """
    values: dict[str, list[float | str]] = {}
    lacking = plan.lacking(case, draw)
    for key, value in _shown(plan, case, draw):
        none = math.nan if isinstance(value, float) else ""
        values[key] = [none if i in lacking[key] else value for i in range(len(plan.controllers))]
    return values


def _shown(plan: Plan, case: int, draw: int) -> Iterator[tuple[str, float | str]]:
    for axis, value in zip(plan.keys.axes, plan.values(case), strict=True):
        yield axis.key, _word(axis, value)
    for random in plan.keys.random:
        drawn = plan.drawn(random, draw)
        if random.choices is None:
            yield random.key, drawn
        else:
            value = random.choices.values[int(drawn)]
            yield random.key, _word(random.choices, value)


def _axes(plan: Plan) -> Iterator[Axis]:
    """Yield every key with a list of values."""
    yield from plan.keys.axes
    yield from (random.choices for random in plan.keys.random if random.choices is not None)


def words(axis: Axis) -> list[Any]:
    """Return the values of a key as the table shows them: numbers, or words where one of them is none."""
    return [_word(axis, value) for value in axis.values]


def _word(axis: Axis, value: Value) -> Any:
    return value.word if axis.numeric or isinstance(value.word, str) else repr(value.raw)


def _text(words: Sequence[str]) -> np.dtype[Any]:
    return np.dtype(f"<U{max(map(len, words))}")


def read_table(path: Path) -> Table:
    """Read ``results.npz``.

    Raises:
        ResultError: the file cannot be read, or does not hold a sweep's table.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return check_table(dict(archive))
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ResultError(f"{path}: cannot be read as a sweep's table ({error})") from error


def check_table(table: Table) -> Table:
    """Return a table after checking that it is a sweep's.

    Raises:
        ResultError: a column is missing, the columns differ in length, or there are no rows.
    """
    missing = [name for name in FIXED if name not in table]
    if missing:
        raise ResultError(f"not the table of a sweep: no column {', '.join(missing)}")
    if len({len(column) for column in table.values()}) > 1:
        raise ResultError("not the table of a sweep: its columns differ in length")
    if len(table["index"]) == 0:
        raise ResultError("not the table of a sweep: no rows")
    return table


def varied_keys(table: Table) -> tuple[str, ...]:
    """Return the experiment's keys that the sweep varies, in the table's order."""
    return tuple(name for name in table if not (name in FIXED or name in METRICS or name in FIGURES or name in COLUMNS))


def grid_keys(table: Table) -> tuple[str, ...]:
    """Return the varied keys of which each law has one value in each case; the others are drawn."""
    place = "case", "controller"
    groups = len(rows_by(table, *place))
    return tuple(key for key in varied_keys(table) if len(rows_by(table, *place, key)) == groups)


def metric_keys(table: Table) -> tuple[str, ...]:
    """Return the metrics that have a value in some row, in the table's order."""
    return tuple(name for name in table if name in METRICS and bool(np.isfinite(table[name]).any()))


def controllers(table: Table) -> tuple[str, ...]:
    """Return the controllers in order of their first rows."""
    return tuple(dict.fromkeys(table["controller"].tolist()))


def rows_by(table: Table, *columns: str) -> dict[tuple[Any, ...], Rows]:
    """Group the rows by their values in some columns; groups in order of their first rows.

    Args:
        table: The table.
        columns: Names of columns.
    """
    group = np.zeros(len(table["index"]), np.int64)
    for name in columns:
        values, place = np.unique(table[name], return_inverse=True)
        group = group * len(values) + place
    order = np.argsort(group, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    parts.sort(key=lambda rows: int(rows[0]))
    return {tuple(table[name][rows[0]].item() for name in columns): rows for rows in parts}


def completed(table: Table, rows: Rows) -> NDArray[np.bool_]:
    """Mask of the rows whose run completed."""
    return np.isnan(table["failed_at"][rows])


def metric_values(table: Table, rows: Rows, key: str) -> Array:
    """Return a metric in some rows; NaN where the run failed or the metric is not defined."""
    return np.where(completed(table, rows), table[key][rows], np.nan)


def row_values(table: Table, keys: Sequence[str], row: int) -> dict[str, float | str | None]:
    """Return some varied keys' values in one row; None for a key that the row's controller lacks.

    Args:
        table: The table.
        keys: Names of columns.
        row: Position of the row.
    """
    values = {key: table[key][row].item() for key in keys}
    return {key: None if value == "" or value != value else value for key, value in values.items()}
