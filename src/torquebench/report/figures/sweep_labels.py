"""Labels of a sweep's figures: titles of metrics and keys with their units, and texts of values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torquebench.experiment.reference import joint_units, unit_of
from torquebench.metrics import METRICS
from torquebench.report.figures.layout import printable
from torquebench.report.figures.style import Unit, choose_unit
from torquebench.sweep.table import Rows, Table, completed, metric_values


def metric_axis(table: Table, key: str, slides: Sequence[bool]) -> Unit:
    """Return title and unit of a metric for an axis, with the prefix that suits its median, and its factor.

    Args:
        table: The table.
        key: The metric; only angles and times take a prefix.
        slides: Of each joint, whether it slides: errors are in m then, or, where only some do, in rad and m.
    """
    info, unit = METRICS[key], Unit(METRICS[key].unit, 1.0)
    values = metric_values(table, np.arange(len(table[key])), key)
    known = np.abs(values[np.isfinite(values)])
    if known.size and info.unit.startswith(("rad", "s")):
        unit = choose_unit(float(np.median(known)), info.unit)
    return Unit(f"{info.title} [{joint_units(unit.name, slides)}]", unit.factor)


def key_label(key: str) -> str:
    """Return a key with its unit, where it is a number."""
    unit = unit_of(key)
    return key if unit is None else f"{key} [{unit}]"


def key_values(table: Table, key: str) -> list[float | str]:
    """Return the values of a key: numbers ascending, words in order of their first rows."""
    column = table[key]
    if column.dtype.kind == "f":
        return [float(x) for x in np.unique(column[np.isfinite(column)])]
    return [word for word in dict.fromkeys(column.tolist()) if word]


def law_name(table: Table, law: str, rows: Rows, gap: str = ", ") -> str:
    """Return the name of a law for a legend, with the number of its failed runs.

    Args:
        table: The table.
        law: Its name, or another for it.
        rows: Its rows.
        gap: What stands between the two.
    """
    failed = int(np.sum(~completed(table, rows)))
    return printable(law) + (f"{gap}{failed} of {len(rows)} failed" if failed else "")


def value_text(value: float | str) -> str:
    """Return a value of a key as text."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
