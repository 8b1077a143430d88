"""Metrics over one key of a sweep: a line for each law, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.sweep_labels import (
    TURNS,
    Scale,
    key_label,
    key_values,
    law_name,
    metric_scale,
    value_text,
)
from torquebench.sweep.summary import level
from torquebench.sweep.table import Rows, Table, rows_by


def draw_lines(
    table: Table, key: str, metrics: Sequence[str], title: str, subtitle: str, slides: Sequence[bool] = TURNS
) -> Figure:
    """Draw geometric means over the draws, and over all other keys, with 95 % intervals; a panel for each metric.

    A law is missing at a value at which no draw of it has the metric, and altogether where it lacks the key. Words
    stand side by side without lines.

    Args:
        table: The sweep's table.
        key: The key along x.
        metrics: Names of metrics, one below the other.
        title, subtitle: Headings.
        slides: As of `metric_scale`.
    """
    values = key_values(table, key)
    cells = rows_by(table, "controller", key)
    laws = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    with style.journal_style():
        fig = new_page(len(metrics), 2.0, 2.4)
        panels = fig.subplots(len(metrics), 1, sharex=True, squeeze=False)[:, 0]
        for ax, metric in zip(panels, metrics, strict=True):
            _panel(ax, table, cells, list(laws), values, metric_scale(table, metric, slides), metric)
        if not isinstance(values[0], str):
            style.fit_scale(panels[-1].xaxis, values)
        panels[-1].set_xlabel(key_label(key))
        fig.align_ylabels(panels)
        handles = [
            Line2D([], [], label=law_name(table, law, rows), markersize=4.0, linewidth=0.9, **style.spot_look(place))
            for place, (law, rows) in enumerate(laws.items())
            if any((law, value) in cells for value in values)
        ]
        finish_page(fig, title, subtitle, handles)
    return fig


def _panel(
    ax: Axes,
    table: Table,
    cells: dict[tuple[str, float | str], Rows],
    laws: Sequence[str],
    values: Sequence[float | str],
    scale: Scale,
    metric: str,
) -> None:
    words = isinstance(values[0], str)
    ends: list[float] = []
    for place, law in enumerate(laws):
        found = []
        for at, value in enumerate(values):
            ratio = level(table, cells[law, value], metric) if (law, value) in cells else None
            if ratio is not None:
                x = at + 0.4 * ((place + 0.5) / len(laws) - 0.5) if isinstance(value, str) else value
                found.append((x, *(scale.factor * y for y in ratio[:3])))
        if found:
            x, y, low, high = np.array(found).T
            look = style.spot_look(place) | ({"linestyle": "none"} if words else {})
            ax.errorbar(x, y, [y - low, high - y], markersize=3.5, linewidth=0.9, elinewidth=0.9, capsize=1.5, **look)
            ends += [*low, *high]
    style.fit_scale(ax.yaxis, ends)
    if words:
        ax.set_xticks(range(len(values)), [value_text(value) for value in values])
    ax.set_ylabel(scale.label.replace(" [", "\n["))
