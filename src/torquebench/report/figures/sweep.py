"""All figures of a sweep: its table decides which there are."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from matplotlib.figure import Figure

from torquebench.experiment.reference import joint_units
from torquebench.metrics import METRICS
from torquebench.report.figures.border import draw_border
from torquebench.report.figures.heatmap import draw_heatmap
from torquebench.report.figures.lines import draw_lines
from torquebench.report.figures.pareto import draw_pareto, front_of
from torquebench.report.figures.sensitivity import draw_sensitivity
from torquebench.report.figures.style import journal_style, spot_looks
from torquebench.report.figures.sweep_labels import key_values, metric_axis
from torquebench.report.figures.violins import draw_violins
from torquebench.report.sweep_tables import SHOWN
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.table import Table, check_table, grid_keys, metric_keys

MOST_COURSES = 4
"""Keys over which figures are drawn, the first of the grid."""
SPREAD = "all cases and draws of each law together; failed runs are counted under its name and not drawn"
OVER = (
    "geometric means over draws and all other keys, bars: 95 % intervals over draws; a law is missing where in every "
    "draw one of its runs failed, or where one has the value 0"
)
MAP = "geometric means over draws and all other keys of the runs that completed, (n): n failed"
FRONT = (
    "each law and choice in the condition in which it is worst: geometric means over draws, bars: 95 % intervals; one "
    "with a failed run is not ringed"
)
BORDER = (
    "medians over draws, shaded: 95 % intervals; dashed: predicted by describing functions; bars: still again beyond "
    "the border in some draw"
)
EFFECTS = "standardised rank regression, the strongest first; 95 % intervals hold for all laws and constants at once"


def sweep_jobs(
    table: Table,
    title: str,
    subtitle: str,
    found: Sequence[Sensitivity],
    slides: Sequence[bool],
    laws: Mapping[str, str],
    border: str = "",
) -> dict[str, partial[Figure]]:
    """Return what draws every figure that a sweep's table has the columns for, by file name.

    ``border``: the gain at which each law starts to shake; ``spread``: metrics by law; ``over-KEY``: over each key of
    the grid; ``map-METRIC``: over the first two keys of the grid; ``front``: error against chattering of every law and
    choice of gains; ``effects-METRIC``: what matters, where anything does. Metrics are those of `SHOWN` that have a
    value.

    Args:
        table: The table.
        title, subtitle: Name of the sweep, and what was run.
        found: What its metrics depend on.
        slides: Of each joint of the arm, whether it slides.
        laws: Controller -> name of its law, which sets its colour.
        border: Gain along which borders were searched, if they were.

    Raises:
        ResultError: it is no sweep's table.
    """
    check_table(table)
    axes = {metric: metric_axis(table, metric, slides) for metric in SHOWN if metric in metric_keys(table)}
    spots = spot_looks(laws)
    keys = [key for key in grid_keys(table) if len(key_values(table, key)) > 1]
    plans: list[tuple[str, str, str, Callable[[str, str], Figure]]] = []
    if border and keys:
        what = f"where each law starts to shake, over {keys[0]}"
        plans.append(("border", what, BORDER, partial(draw_border, table, keys[:2], border, spots)))
    if axes:
        plans.append(("spread", "all runs", SPREAD, partial(draw_violins, table, axes, spots)))
        for key in keys[:MOST_COURSES]:
            plans.append((f"over-{slug(key)}", f"over {key}", OVER, partial(draw_lines, table, key, axes, spots)))
    for metric, axis in axes.items() if len(keys) > 1 else ():
        what = f"{METRICS[metric].title} over {keys[0]} and {keys[1]}"
        plans.append((f"map-{metric}", what, MAP, partial(draw_heatmap, table, keys[:2], metric, axis)))
    front = front_of(table)
    if len(front.spots) > 1:
        unit = joint_units("mrad", slides)
        plans.append(("front", "error against chattering", FRONT, partial(draw_pareto, front, unit, laws)))
    for metric in SHOWN:
        own = [one for one in found if one.metric == metric and one.effects is not None]
        if any(effect.matters for one in own if one.effects for effect in one.effects.effects):
            what = f"what the {METRICS[metric].title} depends on"
            plans.append((f"effects-{metric}", what, EFFECTS, partial(draw_sensitivity, own)))
    return {
        name: partial(_draw, draw, f"{title}: {what}", f"{subtitle}\n{note}", label=what[0].upper() + what[1:])
        for name, what, note, draw in plans
    }


def _draw(draw: Callable[[str, str], Figure], title: str, subtitle: str, *, label: str) -> Figure:
    """Draw a figure; its label is its heading on the page.

    Args:
        draw: Draws it under a title and a subtitle.
        title, subtitle: Headings.
        label: The label.
    """
    with journal_style():
        figure = draw(title, subtitle)
    figure.set_label(label)
    return figure


def slug(key: str) -> str:
    """Turn a key into part of a file's name."""
    return "-".join(re.findall(r"[^\W_]+", key))
