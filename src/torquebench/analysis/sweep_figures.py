"""The figures of a sweep: which there are, by its table, and each of them drawn."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from torquebench.analysis.course_page import course_page
from torquebench.analysis.effects_page import effects_page
from torquebench.analysis.front_page import front_page
from torquebench.analysis.map_page import map_page
from torquebench.analysis.spread_page import spread_page
from torquebench.analysis.sweep_front import front_of
from torquebench.analysis.sweep_parts import TURNS, key_values
from torquebench.experiment.units import joint_units
from torquebench.metrics import METRICS
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.table import Table, check_table, grid_keys, metric_keys

SHOWN = ("rmse", "hf")
"""Metrics that figures show: error against chattering."""
MOST_COURSES = 4
"""Keys over which figures are drawn, the first of the grid."""


def sweep_figures(
    table: Table,
    title: str,
    subtitle: str,
    found: Sequence[Sensitivity] = (),
    metrics: Sequence[str] = SHOWN,
    slides: Sequence[bool] = TURNS,
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
        slides: Of each joint of the arm, whether it slides.

    Raises:
        ResultError: it is no sweep's table.
    """
    check_table(table)
    subtitle = f"{subtitle}\n" if subtitle else ""
    over = f"{subtitle}geometric means over draws and all other keys, bars: 95 % intervals over draws"
    cells = f"{subtitle}geometric means over draws and all other keys of the runs that completed, (n): n failed"
    worst = (
        f"{subtitle}each law and choice in the condition in which it is worst: geometric means over draws, bars: 95 % "
        "intervals"
    )
    strengths = f"{subtitle}standardised rank regression, 95 % intervals that hold for all at once"
    shown = [metric for metric in metrics if metric in metric_keys(table)]
    keys = [key for key in grid_keys(table) if len(key_values(table, key)) > 1]
    figures: dict[str, Figure] = {}
    if shown:
        figures["spread"] = spread_page(table, shown, f"{title}: all runs", subtitle.rstrip(), slides)
        for key in keys[:MOST_COURSES]:
            figures[f"over-{slug(key)}"] = course_page(table, key, shown, f"{title}: over {key}", over, slides)
    if len(keys) > 1:
        for metric in shown:
            heading = f"{title}: {METRICS[metric].title} over {keys[0]} and {keys[1]}"
            figures[f"map-{metric}"] = map_page(table, (keys[0], keys[1]), metric, heading, cells, slides)
    front = front_of(table)
    if len(front.spots) > 1:
        heading = f"{title}: error against chattering"
        figures["front"] = front_page(
            front.spots,
            heading,
            worst,
            front.labels,
            front.order,
            front.joined,
            joint_units("mrad", slides),
            front.names,
        )
    for metric in metrics:
        told = [one for one in found if one.metric == metric and one.effects is not None]
        if any(effect.matters for one in told if one.effects for effect in one.effects.effects):
            heading = f"{title}: what the {METRICS[metric].title} depends on"
            figures[f"effects-{metric}"] = effects_page(told, heading, strengths)
    return figures


def slug(key: str) -> str:
    """Return a key as part of a file's name."""
    return "-".join(part for part in "".join(c if c.isalnum() else " " for c in key).split())
