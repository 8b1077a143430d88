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
from torquebench.report.figures.layout import finish_page, panel_grid
from torquebench.report.figures.style import Unit
from torquebench.report.figures.sweep_labels import key_label, key_values, value_text
from torquebench.sweep.table import Table, completed, metric_values, rows_by

COLUMNS = 3
LEAST_HEIGHT = 2.4
"""Of all panels together, so that the names of key and metric fit beside them [in]."""
_MAP = colormaps["cividis"]
"""Rises evenly in lightness, and looks alike to the colour-blind."""
_HATCHED: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.4", "hatch": "////"}


def draw_heatmap(table: Table, keys: Sequence[str], metric: str, axis: Unit, title: str, subtitle: str) -> Figure:
    """Draw geometric means of a metric over draws and all other keys in each cell, failures in brackets.

    Laws that lack one of the keys have no map.

    Args:
        table: The sweep's table.
        keys: Keys of the grid along x and y.
        metric: Name of the metric.
        axis: Its label, as of `metric_axis`.
        title, subtitle: Headings.
    """
    xs, ys = key_values(table, keys[0]), key_values(table, keys[1])
    cells = {at: rows for at, rows in rows_by(table, "controller", *keys).items() if at[1] in xs and at[2] in ys}
    laws = list(dict.fromkeys(law for law, _, _ in cells))
    centres = np.full((len(laws), len(ys), len(xs)), np.nan)
    failures = np.zeros(centres.shape, dtype=np.int64)
    for (law, x, y), rows in cells.items():
        at = laws.index(law), ys.index(y), xs.index(x)
        centres[at] = _centre(axis.factor * metric_values(table, rows, metric))
        failures[at] = np.sum(~completed(table, rows))
    columns = min(COLUMNS, len(laws))
    height = max(0.5 + 0.24 * max(len(ys), 3), LEAST_HEIGHT / -(-len(laws) // columns))
    y_labels = [key_label(keys[1])] * len(laws)
    fig, panels = panel_grid(laws, key_label(keys[0]), y_labels, columns, (height, height))
    norm = _norm(centres)
    for place, ax in enumerate(panels):
        _draw(ax, centres[place], failures[place], norm, across=columns * len(xs))
        ax.set_xticks(range(len(xs)), [value_text(x) for x in xs])
        ax.set_yticks(range(len(ys)), [value_text(y) for y in ys])
        ax.tick_params(length=0.0, labelleft=place % columns == 0)
    bar = fig.colorbar(panels[0].images[0], ax=panels, aspect=30, fraction=0.05, pad=0.02, label=axis.name)
    style.fit_scale(bar.ax.yaxis, centres)
    handles = [Patch(label="no run has it", **_HATCHED)] if np.isnan(centres).any() else []
    if failures.any():
        handles.append(Patch(facecolor="white", edgecolor="white", label="(n): n runs failed, and are left out"))
    finish_page(fig, title, subtitle, handles)
    return fig


def _centre(values: Array) -> float:
    """Return the geometric mean of the finite values; 0 if one of them is 0, NaN if there are none."""
    known = values[np.isfinite(values)]
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(known).mean())) if known.size else np.nan


def _norm(values: Array) -> Normalize:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return LogNorm(low, high) if low > 0.0 and high >= 10.0 * low else Normalize(low, high if high > low else low + 1.0)


def _draw(ax: Axes, values: Array, failed: Array, norm: Normalize, across: int) -> None:
    """Draw one law's map; `across` is the number of cells side by side on the page."""
    ax.patch.set(**_HATCHED, linewidth=0.0)  # seen where there is no value
    ax.imshow(
        np.ma.masked_invalid(values), cmap=_MAP, norm=norm, aspect="auto", origin="lower", interpolation="nearest"
    )
    size = 6.5 if across <= 14 else 5.5 if across <= 20 else 4.5
    for i, j in np.argwhere(np.isfinite(values)):
        beside = f"\n({failed[i, j]})" if failed[i, j] else ""
        colour = "black" if float(norm(values[i, j])) > 0.55 else "white"
        ax.text(j, i, f"{values[i, j]:.3g}{beside}", ha="center", va="center", fontsize=size, color=colour)
    ax.grid(False)
