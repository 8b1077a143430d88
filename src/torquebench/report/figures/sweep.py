"""All figures of a sweep: its table decides which there are."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from torquebench.experiment.reference import joint_units
from torquebench.metrics import METRICS
from torquebench.report.figures.heatmap import draw_heatmap
from torquebench.report.figures.lines import draw_lines
from torquebench.report.figures.pareto import draw_pareto, front_of
from torquebench.report.figures.sensitivity import draw_sensitivity
from torquebench.report.figures.sweep_labels import TURNS, key_values
from torquebench.report.figures.violins import draw_violins
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
        figures["spread"] = draw_violins(table, shown, f"{title}: all runs", subtitle.rstrip(), slides)
        for key in keys[:MOST_COURSES]:
            figures[f"over-{slug(key)}"] = draw_lines(table, key, shown, f"{title}: over {key}", over, slides)
    if len(keys) > 1:
        for metric in shown:
            heading = f"{title}: {METRICS[metric].title} over {keys[0]} and {keys[1]}"
            figures[f"map-{metric}"] = draw_heatmap(table, (keys[0], keys[1]), metric, heading, cells, slides)
    front = front_of(table)
    if len(front.spots) > 1:
        heading = f"{title}: error against chattering"
        figures["front"] = draw_pareto(front, heading, worst, joint_units("mrad", slides))
    for metric in metrics:
        own = [one for one in found if one.metric == metric and one.effects is not None]
        if any(effect.matters for one in own if one.effects for effect in one.effects.effects):
            heading = f"{title}: what the {METRICS[metric].title} depends on"
            figures[f"effects-{metric}"] = draw_sensitivity(own, heading, strengths)
    return figures


def slug(key: str) -> str:
    """Turn a key into part of a file's name."""
    return "-".join(part for part in "".join(c if c.isalnum() else " " for c in key).split())
