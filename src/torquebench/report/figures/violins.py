"""Spread of a metric over the draws and cases of a sweep: a violin, a box and points for each law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import violin_stats
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.mlab import GaussianKDE
from matplotlib.patches import Patch, Rectangle

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.sweep_labels import TURNS, Scale, law_name, metric_scale, scaled
from torquebench.sweep.table import Rows, Table, rows_by

MOST_POINTS = 400
"""Points drawn for each law; of more, an evenly spaced part of those in order of size, both ends included."""
LEAST_VALUES = 10
"""Different values below which a density would be mostly the kernel's own shape."""
HALF_WIDTH, BOX = 0.4, 0.09
"""Half-widths of violin and box; two laws are 1 apart."""
_TURN = 0.6180339887498949
"""Golden ratio: multiples of it fill an interval evenly, so that points are scattered without random numbers."""


def draw_violins(
    table: Table, metrics: Sequence[str], title: str, subtitle: str, slides: Sequence[bool] = TURNS
) -> Figure:
    """Draw a panel for each metric: for each law density, quartiles, range and points of all its completed runs.

    The density is a Gaussian kernel's with Scott's width, in the logarithm where the axis is logarithmic, cut off at
    the least and greatest value; all violins are equally wide. Fewer than ten different values have none.

    Args:
        table: The sweep's table.
        metrics: Names of metrics, side by side.
        title, subtitle: Headings.
        slides: As of `metric_scale`.
    """
    laws = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    with style.journal_style():
        height = 0.55 + 0.34 * len(laws)
        fig = new_page(1, height, height)
        panels = fig.subplots(1, len(metrics), sharey=True, squeeze=False)[0]
        for ax, metric in zip(panels, metrics, strict=True):
            _panel(ax, table, laws, metric, metric_scale(table, metric, slides))
        panels[0].set_yticks(range(len(laws)), [law_name(table, law, rows, "\n") for law, rows in laws.items()])
        panels[0].set_ylim(len(laws) - 0.5, -0.5)
        handles = [
            Line2D([], [], color="0.45", marker="o", markersize=2.5, linestyle="none", label="one run"),
            Patch(facecolor="0.88", edgecolor="0.7", label="density"),
            Patch(facecolor="white", edgecolor="0.2", label="quartiles and median"),
            Line2D([], [], color="0.2", linewidth=0.9, label="least to greatest"),
        ]
        finish_page(fig, title, subtitle, handles)
    return fig


def _panel(ax: Axes, table: Table, laws: dict[str, Rows], metric: str, scale: Scale) -> None:
    values = [scaled(table, rows, metric, scale) for rows in laws.values()]
    known = [np.sort(own[np.isfinite(own)]) for own in values]
    logarithmic = style.fit_scale(ax.xaxis, np.concatenate(known))
    for place, own in enumerate(known):
        if not len(own):
            ax.text(
                0.5, place, "no run has it", transform=ax.get_yaxis_transform(), ha="center", va="center", color="0.4"
            )
            continue
        colour = style.COLOURS[place % len(style.COLOURS)]
        shown = own[np.unique(np.linspace(0, len(own) - 1, min(len(own), MOST_POINTS)).astype(np.intp))]
        wide = np.full(len(shown), 0.52)
        if len(np.unique(shown)) >= LEAST_VALUES:
            wide = 1.7 * _violin(ax, shown, place, colour, logarithmic)
        beside = place + wide * ((_TURN * np.arange(len(shown))) % 1.0 - 0.5)
        ax.plot(shown, beside, "o", color=colour, markersize=2.2, alpha=0.45, markeredgewidth=0.0, zorder=2.0)
        _box(ax, own, place)
    ax.set_xlabel(scale.label)


def _violin(ax: Axes, values: Array, place: int, colour: str, logarithmic: bool) -> Array:
    """Draw the density of values as a band about a law's place; return its half-width at each of them."""
    at = np.log(values) if logarithmic else values
    found = violin_stats(at, lambda own, places: GaussianKDE(own).evaluate(places), points=120)[0]
    half = HALF_WIDTH * found["vals"] / found["vals"].max()
    along = np.exp(found["coords"]) if logarithmic else found["coords"]
    ax.fill_between(along, place - half, place + half, color=to_rgba(colour, 0.18), linewidth=0.0, zorder=1.5)
    widths: Array = np.interp(at, found["coords"], half)
    return widths


def _box(ax: Axes, values: Array, place: int) -> None:
    """Draw quartiles and median as a box, and the range as a line with ends."""
    least, low, middle, high, most = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
    ax.plot((least, most), (place, place), color="0.2", linewidth=0.9, marker="|", markersize=6.0, zorder=3.0)
    ax.add_patch(
        Rectangle(
            (low, place - BOX),
            high - low,
            2.0 * BOX,
            facecolor="white",
            edgecolor="0.2",
            linewidth=0.8,
            zorder=3.1,
        )
    )
    ax.plot((middle, middle), (place - BOX, place + BOX), color="0.1", linewidth=1.6, zorder=3.2)
