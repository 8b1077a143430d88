"""A metric over two keys of a sweep's grid: a map for each law, one scale of colours for all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page, printable
from torquebench.report.figures.sweep_labels import TURNS, key_label, key_values, metric_scale, scaled, value_text
from torquebench.sweep.table import Table, completed, rows_by

COLUMNS = 3
LEAST_HEIGHT = 2.4
"""Of all panels together, so that the names of key and metric fit beside them [in]."""
_MAP = colormaps["cividis"]
"""Rises evenly in lightness, and looks alike to the colour-blind."""


def draw_heatmap(
    table: Table, keys: tuple[str, str], metric: str, title: str, subtitle: str, slides: Sequence[bool] = TURNS
) -> Figure:
    """Draw geometric means of a metric over draws and all other keys in each cell, failures in brackets.

    Laws that lack one of the keys have no map.

    Args:
        table: The sweep's table.
        keys: Keys of the grid along x and y.
        metric: Name of the metric.
        title, subtitle: Headings.
        slides: As of `metric_scale`.
    """
    scale = metric_scale(table, metric, slides)
    xs, ys = key_values(table, keys[0]), key_values(table, keys[1])
    cells = rows_by(table, "controller", *keys)
    laws = list(dict.fromkeys(law for law, x, y in cells if x in xs and y in ys))
    centres = {law: np.full((len(ys), len(xs)), np.nan) for law in laws}
    failures = {law: np.zeros((len(ys), len(xs)), dtype=np.int64) for law in laws}
    for (law, x, y), rows in cells.items():
        if x in xs and y in ys:
            at = ys.index(y), xs.index(x)
            centres[law][at] = _centre(scaled(table, rows, metric, scale))
            failures[law][at] = int(np.sum(~completed(table, rows)))
    with style.journal_style():
        columns = min(COLUMNS, len(laws))
        lines = -(-len(laws) // columns)
        height = max(0.5 + 0.24 * max(len(ys), 3), LEAST_HEIGHT / lines)
        fig = new_page(lines, height, height)
        grid = fig.add_gridspec(lines, columns)
        norm = _norm(np.array(list(centres.values())))
        panels = []
        for place, law in enumerate(laws):
            ax = fig.add_subplot(grid[place // columns, place % columns])
            _draw(ax, centres[law], failures[law], norm, across=columns * len(xs))
            ax.set_title(printable(law), loc="left", pad=3.0)
            ax.set_xticks(range(len(xs)), [value_text(x) for x in xs])
            ax.set_yticks(range(len(ys)), [value_text(y) for y in ys] if place % columns == 0 else [""] * len(ys))
            panels.append(ax)
        below = fig.supxlabel(key_label(keys[0]), fontsize=8.0)
        beside = fig.supylabel(key_label(keys[1]), fontsize=8.0)
        bar = fig.colorbar(panels[0].images[0], ax=panels, aspect=30, fraction=0.05, pad=0.02)
        bar.set_label(scale.label)
        bar.outline.set_linewidth(0.6)
        style.fit_scale(bar.ax.yaxis, [norm.vmin or 0.0, norm.vmax or 0.0])
        handles = [Patch(facecolor="white", edgecolor="0.4", hatch="////", label="no run has it")]
        if any(np.any(own) for own in failures.values()):
            handles.append(Patch(facecolor="white", edgecolor="white", label="(n): n runs failed, and are left out"))
        finish_page(fig, title, subtitle, handles)
        boxes = [ax.get_position() for ax in panels]
        below.set_x(round(0.5 * (min(box.x0 for box in boxes) + max(box.x1 for box in boxes)), 6))
        beside.set_y(round(0.5 * (min(box.y0 for box in boxes) + max(box.y1 for box in boxes)), 6))
    return fig


def _centre(values: Array) -> float:
    """Geometric mean of the finite values; 0 if one of them is 0, NaN if there are none."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.nan
    return float(np.exp(np.mean(np.log(known)))) if known.min() > 0.0 else 0.0


def _norm(values: Array) -> Normalize:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return LogNorm(low, high) if low > 0.0 and high >= 10.0 * low else Normalize(low, high if high > low else low + 1.0)


def _draw(ax: Axes, values: Array, failed: Any, norm: Normalize, across: int) -> None:
    """Draw one law's map; `across` is the number of cells side by side on the page."""
    ax.set_facecolor("white")
    ax.imshow(
        np.ma.masked_invalid(values), cmap=_MAP, norm=norm, aspect="auto", origin="lower", interpolation="nearest"
    )
    size = 6.5 if across <= 14 else 5.5 if across <= 20 else 4.5
    for i, j in np.ndindex(values.shape):
        beside = f"\n({failed[i, j]})" if failed[i, j] else ""
        if np.isfinite(values[i, j]):
            colour = "black" if float(norm(values[i, j])) > 0.55 else "white"
            ax.text(j, i, f"{values[i, j]:.3g}{beside}", ha="center", va="center", fontsize=size, color=colour)
        else:
            ax.fill_between(
                (j - 0.5, j + 0.5), i - 0.5, i + 0.5, facecolor="white", edgecolor="0.4", hatch="////", lw=0.0
            )
    ax.grid(False)
    ax.tick_params(length=0.0)
