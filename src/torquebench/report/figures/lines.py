"""Metrics over one key of a sweep: a line for each law, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.style import Unit
from torquebench.report.figures.sweep_labels import key_label, key_values, law_name, value_text
from torquebench.sweep.summary import level
from torquebench.sweep.table import Table, rows_by


def draw_lines(
    table: Table, key: str, axes: Mapping[str, Unit], spots: Mapping[str, Mapping[str, Any]], title: str, subtitle: str
) -> Figure:
    """Draw geometric means over the draws, and over all other keys, with 95 % intervals; a panel for each metric.

    A law is missing at a value at which no draw of it has the metric, and altogether where it lacks the key. Words
    stand side by side without lines.

    Args:
        table: The table.
        key: The key along x.
        axes: Metrics, one below the other, with their labels as of `metric_axis`.
        spots: Looks of the controllers, as of `spot_looks`.
        title, subtitle: Headings.
    """
    values = key_values(table, key)
    words = isinstance(values[0], str)
    cells = rows_by(table, "controller", key)
    laws = rows_by(table, "controller")
    looks = {law: {**spots[law], "linewidth": 0.9} for (law,) in laws}
    fig = new_page(len(axes), 2.0, 2.4)
    panels = fig.subplots(len(axes), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (metric, axis) in zip(panels, axes.items(), strict=True):
        ends: list[float] = []
        for place, (law, look) in enumerate(looks.items()):
            own = {at: cells[law, value] for at, value in enumerate(values) if (law, value) in cells}
            levels = {at: found for at, rows in own.items() if (found := level(table, rows, metric)) is not None}
            if not levels:
                continue
            y, low, high = axis.factor * np.array([found[:3] for found in levels.values()]).T
            aside = 0.4 * ((place + 0.5) / len(laws) - 0.5)
            x = [at + aside if words else values[at] for at in levels]
            joined = {"linestyle": "none"} if words else {}
            ax.errorbar(x, y, [y - low, high - y], markersize=3.5, elinewidth=0.9, capsize=1.5, **look | joined)
            ends += [*low, *high]
        style.fit_scale(ax.yaxis, ends)
        ax.set_ylabel(axis.name.replace(" [", "\n["))
    if words:
        panels[-1].set_xticks(range(len(values)), [value_text(value) for value in values])
    else:
        style.fit_scale(panels[-1].xaxis, values)
    panels[-1].set_xlabel(key_label(key))
    handles = [
        Line2D([], [], label=law_name(table, law, rows), markersize=4.0, **looks[law])
        for (law,), rows in laws.items()
        if any((law, value) in cells for value in values)
    ]
    finish_page(fig, title, subtitle, handles)
    return fig
