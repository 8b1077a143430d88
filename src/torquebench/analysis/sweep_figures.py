"""The figures of a sweep: which there are, by its table, and each of them drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from torquebench.analysis.course_page import course_page
from torquebench.analysis.effects_page import effects_page
from torquebench.analysis.front_page import Spot, front_page
from torquebench.analysis.map_page import map_page
from torquebench.analysis.spread_page import spread_page
from torquebench.analysis.sweep_parts import key_values, value_text
from torquebench.statistics import Ratio, undominated
from torquebench.sweep.columns import (
    INFO,
    Rows,
    Table,
    checked,
    completed,
    controllers,
    grid_keys,
    metric_keys,
    rows_by,
    values_of,
)
from torquebench.sweep.reduce import level
from torquebench.sweep.sensitivity import Sensitivity

SHOWN = ("rmse", "hf")
"""Metrics that figures show: error against chattering."""
MOST_COURSES = 4
"""Keys over which figures are drawn, the first of the grid."""
CHOSEN = ("controllers.", "run.control_period")
"""How keys begin that a designer chooses; the others are conditions that a law has to cope with."""


def sweep_figures(
    table: Table, title: str, subtitle: str, found: Sequence[Sensitivity] = (), metrics: Sequence[str] = SHOWN
) -> dict[str, Figure]:
    """Draw every figure that a sweep's table has the columns for, by file name.

    ``spread``: metrics by law; ``over-KEY``: over each key of the grid; ``map-METRIC``: over the first two keys of the
    grid; ``front``: error against chattering of every law and choice of gains; ``effects-METRIC``: what matters, where
    anything does.

    Args:
        table: The table.
        title, subtitle: Name of the sweep, and what was run.
        found: What its metrics depend on.
        metrics: Metrics that are shown; those without any value are passed over.

    Raises:
        ResultError: it is no sweep's table.
    """
    checked(table)
    shown = [metric for metric in metrics if metric in metric_keys(table)]
    keys = [key for key in grid_keys(table) if len(key_values(table, key)) > 1]
    figures: dict[str, Figure] = {}
    if shown:
        figures["spread"] = spread_page(table, shown, f"{title}: all runs", subtitle)
        for key in keys[:MOST_COURSES]:
            figures[f"over-{slug(key)}"] = course_page(table, key, shown, f"{title}: over {key}", subtitle)
    if len(keys) > 1:
        for metric in shown:
            heading = f"{title}: {INFO[metric].title} over {keys[0]} and {keys[1]}"
            figures[f"map-{metric}"] = map_page(table, (keys[0], keys[1]), metric, heading, subtitle)
    spots = front_spots(table)
    if len(spots) > 1:
        heading = f"{title}: error against chattering"
        figures["front"] = front_page(spots, heading, subtitle, "which it is", controllers(table))
    for metric in metrics:
        told = [one for one in found if one.metric == metric and one.effects is not None]
        if any(effect.matters for one in told if one.effects for effect in one.effects.effects):
            heading = f"{title}: what the {INFO[metric].title} depends on"
            figures[f"effects-{metric}"] = effects_page(told, heading, subtitle)
    return figures


def slug(key: str) -> str:
    """Return a key as part of a file's name."""
    return "-".join(part for part in "".join(c if c.isalnum() else " " for c in key).split())


def front_spots(table: Table) -> list[Spot]:
    """Return error and chattering of every law and choice, each in the condition in which it is worst.

    Keys of the grid that start as `CHOSEN` are choices, a key of one controller for this one alone; all others are
    conditions. Figures are geometric means over draws. A choice of which no draw completed in some condition is left
    out, one of which any run failed is not among the best.

    Args:
        table: The table.
    """
    if not {"rmse", "hf"} <= set(metric_keys(table)):
        return []
    found = []
    grid = [key for key in grid_keys(table) if len(key_values(table, key)) > 1]
    by_law = rows_by(table, "controller", "case")
    for law in controllers(table):
        own = [key for key in grid if key.startswith(CHOSEN) and _concerns(key, law)]
        choices: dict[tuple[float | str | None, ...], list[Rows]] = {}
        for (name, _), rows in by_law.items():
            if name == law:
                choices.setdefault(tuple(values_of(table, tuple(own), int(rows[0])).values()), []).append(rows)
        for values, cases in choices.items():
            error, chattering = (_worst([level(table, rows, key) for rows in cases]) for key in ("rmse", "hf"))
            if error is not None and chattering is not None:
                names = zip(own, values, strict=True)
                label = ", ".join(f"{key.split('.')[-1]} {value_text(v)}" for key, v in names if v is not None)
                whole = all(bool(np.all(completed(table, rows))) for rows in cases)
                found.append(Spot(law, label or law, error, chattering, whole))
    places = [place for place, spot in enumerate(found) if spot.best]
    best = undominated([(found[place].error.ratio, found[place].chattering.ratio) for place in places])
    ringed = {places[index] for index in best}
    return [spot._replace(best=place in ringed) for place, spot in enumerate(found)]


def _worst(levels: Sequence[Ratio | None]) -> Ratio | None:
    known = [level for level in levels if level is not None]
    return max(known, key=lambda level: level.ratio) if len(known) == len(levels) else None


def _concerns(key: str, law: str) -> bool:
    return not key.startswith("controllers.") or key.split(".")[1] in ("*", law)
