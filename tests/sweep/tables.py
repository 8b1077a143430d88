"""Made-up tables of sweeps, in the form in which a sweep writes them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from torquebench.sweep.table import Table

Run = Mapping[str, float | None]
"""Metrics of one run; None for one that failed."""


def made(
    laws: Sequence[str],
    draws: int,
    figures: Callable[[str, int, Mapping[str, Any]], Run | None],
    grid: Mapping[str, Sequence[Any]] | None = None,
    metrics: Sequence[str] = ("rmse", "chattering"),
) -> Table:
    """Return a table whose figures are a function of (law, draw, values of the case); None for a run that failed."""
    keys = grid or {}
    rows = []
    for case, values in enumerate(itertools.product(*keys.values())):
        here = dict(zip(keys, values, strict=True))
        for draw, law in itertools.product(range(draws), laws):
            found = figures(law, draw, here)
            fixed = (case, draw, law, "DIVERGED" if found is None else "COMPLETED", 0.25 if found is None else np.nan)
            rows.append((*fixed, *values, *(np.nan if found is None else found.get(key) for key in metrics)))
    names = ("case", "draw", "controller", "outcome", "failed_at", *keys, *metrics)
    columns = dict(zip(names, zip(*rows, strict=True), strict=True))
    table: dict[str, Any] = {"index": np.arange(len(rows), dtype=np.int64)}
    for name, column in columns.items():
        kind = np.int64 if name in ("case", "draw") else np.str_ if isinstance(column[0], str) else np.float64
        table[name] = np.array(column, dtype=kind)
    return table
