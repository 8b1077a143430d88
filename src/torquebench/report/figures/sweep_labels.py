"""Labels of a sweep's figures: titles of metrics and keys with their units, and texts of values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from torquebench.experiment.reference import joint_units, unit_of
from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.report.figures import style
from torquebench.report.figures.layout import printable
from torquebench.sweep.table import Rows, Table, completed, metric_values


class Scale(NamedTuple):
    """How values of a metric are written."""

    label: str
    """Title and unit."""
    factor: float
    """By how much an SI value is multiplied."""


TURNS = (False,)
"""An arm all of whose joints turn."""


def metric_scale(table: Table, key: str, slides: Sequence[bool] = TURNS) -> Scale:
    """Choose the prefix of a metric's unit that suits its median.

    Args:
        table: The table.
        key: The metric.
        slides: Of each joint, whether it slides: errors are in m then, or, where only some do, in rad and m.
    """
    info = METRICS[key]
    values = metric_values(table, np.arange(len(table[key])), key)
    known = np.abs(values[np.isfinite(values)])
    unit = style.metric_unit(info, float(np.median(known)) if known.size else 0.0)
    return Scale(f"{info.title} [{joint_units(unit.name, slides)}]", unit.factor)


def key_label(key: str) -> str:
    """Return a key with its unit, where it is a number."""
    unit = unit_of(key)
    return key if unit is None else f"{key} [{unit}]"


def key_values(table: Table, key: str) -> list[float | str]:
    """Values of a key: numbers ascending, words in order of their first rows."""
    if table[key].dtype.kind == "f":
        known = table[key][np.isfinite(table[key])]
        return [float(value) for value in np.unique(known)]
    return [word for word in dict.fromkeys(table[key].tolist()) if word]


def law_name(table: Table, law: str, rows: Rows, gap: str = ", ") -> str:
    """Name of a law for a legend, with the number of its failed runs.

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


def scaled(table: Table, rows: Rows, key: str, scale: Scale) -> Array:
    """Values of a metric in the unit of its label; NaN where the run failed or has none.

    Args:
        table: The table.
        rows: Which rows.
        key: The metric.
        scale: How it is written.
    """
    return scale.factor * metric_values(table, rows, key)
