"""Spread of a metric over the draws and cases of a sweep: a violin, a box and points for each law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import violin_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.mlab import GaussianKDE
from matplotlib.patches import Patch

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.style import Unit
from torquebench.report.figures.sweep_labels import law_name
from torquebench.sweep.table import Table, metric_values, rows_by

MOST_POINTS = 400
"""Points drawn for each law; of more, an evenly spaced part of those in order of size, both ends included."""
LEAST_VALUES = 10
"""Different values below which a density would be mostly the kernel's own shape."""
HALF_WIDTH, BOX = 0.4, 0.18
"""Half-width of a violin, and width of a box; two laws are 1 apart."""
_TURN = 0.6180339887498949
"""Golden ratio: multiples of it fill an interval evenly, so that points are scattered without random numbers."""


def draw_violins(
    table: Table, axes: Mapping[str, Unit], spots: Mapping[str, Mapping[str, Any]], title: str, subtitle: str
) -> Figure:
    """Draw a panel for each metric: for each law density, quartiles, range and points of all its completed runs.

    The density is a Gaussian kernel's with Scott's width, in the logarithm where the axis is logarithmic, cut off at
    the least and greatest value; all violins are equally wide. Fewer than ten different values have none.

    Args:
        table: The sweep's table.
        axes: Metrics, side by side, with their labels as of `metric_axis`.
        spots: Looks of the controllers, as of `spot_looks`.
        title, subtitle: Headings.
    """
    laws = rows_by(table, "controller")
    height = 0.7 + 0.34 * len(laws)
    fig = new_page(1, height, height)
    panels = fig.subplots(1, len(axes), sharey=True, squeeze=False)[0]
    for ax, (metric, axis) in zip(panels, axes.items(), strict=True):
        values = [axis.factor * metric_values(table, rows, metric) for rows in laws.values()]
        logarithmic = style.fit_scale(ax.xaxis, np.concatenate(values))
        for place, (own, (law,)) in enumerate(zip(values, laws, strict=True)):
            _draw(ax, np.sort(own[np.isfinite(own)]), place, spots[law]["color"], logarithmic)
        ax.set_xlabel(axis.name.replace(" [", "\n["))  # beside one another on a narrow page
    panels[0].set_yticks(range(len(laws)), [law_name(table, law, rows, "\n") for (law,), rows in laws.items()])
    panels[0].set_ylim(len(laws) - 0.5, -0.5)
    handles = [
        Line2D([], [], color="0.45", marker="o", markersize=2.5, linestyle="none", label="one run"),
        Patch(facecolor="0.88", edgecolor="0.7", label="density"),
        Patch(facecolor="white", edgecolor="0.2", label="quartiles and median"),
        Line2D([], [], color="0.2", linewidth=0.9, label="least to greatest"),
    ]
    finish_page(fig, title, subtitle, handles)
    return fig


def _draw(ax: Axes, values: Array, place: int, colour: str, logarithmic: bool) -> None:
    """Draw the values of one law: density, points, quartiles and median as a box, and the range.

    Args:
        ax: The panel.
        values: Ascending.
        place: Where on the panel.
        colour: Of the law.
        logarithmic: Whether the axis is.
    """
    if not len(values):
        beside = ax.get_yaxis_transform()
        ax.text(0.5, place, "no run has it", color="0.4", transform=beside, ha="center", va="center")
        return
    shown = values[np.unique(np.linspace(0, len(values) - 1, min(len(values), MOST_POINTS)).astype(np.intp))]
    wide: Array = np.full(len(shown), 0.26)
    if len(np.unique(shown)) >= LEAST_VALUES:
        at, back = (np.log(shown), np.exp) if logarithmic else (shown, np.asarray)
        found = violin_stats(at, lambda own, places: GaussianKDE(own).evaluate(places), points=120)[0]
        half = HALF_WIDTH * found["vals"] / found["vals"].max()
        ax.fill_between(back(found["coords"]), place - half, place + half, color=colour, alpha=0.18, lw=0.0, zorder=1.5)
        wide = 0.85 * np.interp(at, found["coords"], half)
    spread = place + wide * (2.0 * ((_TURN * np.arange(len(shown))) % 1.0) - 1.0)
    ax.plot(shown, spread, "o", color=colour, markersize=2.2, alpha=0.45, markeredgewidth=0.0, zorder=2.0)
    least, low, middle, high, most = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
    ax.plot((least, most), (place, place), color="0.2", linewidth=0.9, marker="|", markersize=6.0, zorder=3.0)
    ax.barh(place, high - low, BOX, low, facecolor="white", edgecolor="0.2", linewidth=0.8, zorder=3.1)
    ax.plot((middle, middle), (place - 0.5 * BOX, place + 0.5 * BOX), color="0.1", linewidth=1.6, zorder=3.2)
