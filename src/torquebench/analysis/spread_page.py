"""How a metric spreads over the draws and cases of a sweep: a box with its points for each law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from torquebench.analysis import style
from torquebench.analysis.page import finish_page, new_page, printable
from torquebench.analysis.sweep_parts import metric_scale, scaled
from torquebench.kernel import Array
from torquebench.sweep.columns import Rows, Table, completed, rows_by

MOST_POINTS = 400
"""Points drawn for each law; of more, an evenly spaced part of those in order of size, both ends included."""
_TURN = 0.6180339887498949
"""Golden ratio: multiples of it fill an interval evenly, so that points are scattered without random numbers."""


def spread_page(table: Table, metrics: Sequence[str], title: str, subtitle: str) -> Figure:
    """Draw a panel for each metric: for each law its quartiles and range over all completed runs, and these as points.

    Args:
        table: The sweep's table.
        metrics: Names of metrics, side by side.
        title, subtitle: Headings.
    """
    laws = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    with style.journal_style():
        height = 0.55 + 0.34 * len(laws)
        fig = new_page(1, height, height)
        panels = fig.subplots(1, len(metrics), sharey=True, squeeze=False)[0]
        for ax, metric in zip(panels, metrics, strict=True):
            _panel(ax, table, laws, metric)
        panels[0].set_yticks(range(len(laws)), [_name(table, law, rows) for law, rows in laws.items()])
        panels[0].set_ylim(len(laws) - 0.5, -0.5)
        handles = [
            Line2D([], [], color="0.45", marker="o", markersize=2.5, linestyle="none", label="one run"),
            Patch(facecolor="0.85", edgecolor="0.2", label="quartiles and median"),
            Line2D([], [], color="0.2", linewidth=0.9, label="least to greatest"),
        ]
        finish_page(fig, title, subtitle, handles)
    return fig


def _name(table: Table, law: str, rows: Rows) -> str:
    failed = int(np.sum(~completed(table, rows)))
    return printable(law) + (f"\n{failed} of {len(rows)} failed" if failed else "")


def _panel(ax: Axes, table: Table, laws: dict[str, Rows], metric: str) -> None:
    scale = metric_scale(table, metric)
    values = [scaled(table, rows, metric, scale) for rows in laws.values()]
    known = [np.sort(own[np.isfinite(own)]) for own in values]
    style.fit_scale(ax.xaxis, np.concatenate(known))
    for place, own in enumerate(known):
        if not len(own):
            ax.text(
                0.5, place, "no run has it", transform=ax.get_yaxis_transform(), ha="center", va="center", color="0.4"
            )
            continue
        colour = style.COLOURS[place % len(style.COLOURS)]
        shown = own[np.unique(np.linspace(0, len(own) - 1, min(len(own), MOST_POINTS)).astype(np.intp))]
        beside = place + 0.52 * ((_TURN * np.arange(len(shown))) % 1.0 - 0.5)
        ax.plot(shown, beside, "o", color=colour, markersize=2.2, alpha=0.45, markeredgewidth=0.0, zorder=2.0)
        _box(ax, own, place, colour)
    ax.set_xlabel(scale.label)


def _box(ax: Axes, values: Array, place: int, colour: str) -> None:
    """Draw quartiles and median as a box, and the range as a line with ends."""
    least, low, middle, high, most = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
    ax.plot((least, most), (place, place), color="0.2", linewidth=0.9, marker="|", markersize=6.0, zorder=3.0)
    ax.add_patch(Rectangle(
        (low, place - 0.25), high - low, 0.5, facecolor=to_rgba(colour, 0.25), edgecolor="0.2", linewidth=0.8,
        zorder=3.1,
    ))  # fmt: skip
    ax.plot((middle, middle), (place - 0.25, place + 0.25), color="0.1", linewidth=1.6, zorder=3.2)
