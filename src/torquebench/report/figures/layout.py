"""One page of panels: size, title, subtitle, one legend above the panels, a layout solved exactly once."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend

PAGE_WIDTH = 7.2
"""Width of every figure [in]: 183 mm, two columns of a journal, so that nothing is scaled down in print."""
BODY_HEIGHT = 6.4
"""Height of the panels together, while they are few enough to be higher than the least height [in]."""


def new_page(rows: int, least: float, most: float) -> Figure:
    """Return an empty page with room for `rows` rows of panels, each `least` to `most` inches high."""
    height = rows * min(most, max(least, BODY_HEIGHT / rows))
    fig = Figure(figsize=(PAGE_WIDTH, height), layout="constrained")
    FigureCanvasAgg(fig)
    return fig


def panel_grid(names: Sequence[str], x_label: str, y_labels: Sequence[str]) -> tuple[Figure, list[Axes]]:
    """Return a page with one panel per joint: two columns (three above eight joints), rows filled first.

    The x label stands under the lowest panel of each column. A panel's y label stands beside it in the first
    column, and in the others where it differs from the one at its left.
    """
    n = len(names)
    columns = 1 if n == 1 else 2 if n <= 8 else 3
    rows = -(-n // columns)
    fig = new_page(rows, 1.3, 3.4)
    grid = fig.add_gridspec(rows, columns)
    panels: list[Axes] = []
    for i, name in enumerate(names):
        ax = fig.add_subplot(grid[i // columns, i % columns])
        ax.set_label(name)
        ax.set_title(printable(name), loc="left", pad=3.0)
        if i % columns == 0 or y_labels[i] != y_labels[i - 1]:
            ax.set_ylabel(y_labels[i] if rows <= 3 else y_labels[i].replace(" [", "\n["))
        lowest = i + columns >= n
        ax.set_xlabel(x_label if lowest else "")
        ax.tick_params(labelbottom=lowest)
        panels.append(ax)
    fig.align_ylabels(panels[::columns])
    return fig, panels


def finish_page(fig: Figure, title: str, subtitle: str, handles: Sequence[Artist]) -> None:
    """Set title, subtitle and the shared legend above the panels, make room for them, freeze the layout."""
    rows = [(line, 10.0, "bold", "black") for line in textwrap.wrap(printable(title), 78)]
    for part in subtitle.splitlines():
        rows += [(line, 7.5, "normal", "0.3") for line in textwrap.wrap(printable(part), 116)]
    heights = [size * 1.45 / 72.0 for _, size, _, _ in rows]
    legend, legend_height = _legend(fig, handles)
    header = 0.08 + sum(heights) + 0.04 + legend_height + 0.06
    height = fig.get_figheight() + header
    fig.set_figheight(height)
    top = 0.08
    for (text, size, weight, colour), step in zip(rows, heights, strict=True):
        at = fig.text(0.012, 1.0 - top / height, text, fontsize=size, fontweight=weight, color=colour, va="top")
        at.set_in_layout(False)
        top += step
    legend.set_bbox_to_anchor((0.012, 1.0 - (top + 0.04) / height))
    engine = fig.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0.004, 0.004, 0.99, 1.0 - header / height - 0.004))  # type: ignore[call-arg]
    fig.draw_without_rendering()
    fig.set_layout_engine("none")  # solved again, panels would move by round-off, and bytes with them
    for ax in fig.axes:  # the solver's round-off follows memory addresses: not the same in every run
        x, y, width, height = (round(float(edge), 6) for edge in ax.get_position().bounds)
        ax.set_position((x, y, width, height))


def printable(text: str) -> str:
    """Replace control characters, which an SVG file cannot hold."""
    return "".join(c if c.isprintable() else " " for c in text)


def level_lines(ax: Axes, level: float, used: tuple[float, float], look: dict[str, Any]) -> bool:
    """Draw +-`level` across `ax` with the line properties `look`, where it is in view; say whether it is.

    The range of the axis takes a sign in where what is drawn, whose range is `used`, reaches half of it.
    """
    low, high = ax.get_ylim()
    low = min(low, -1.1 * level) if used[0] < -0.5 * level else low
    high = max(high, 1.1 * level) if used[1] > 0.5 * level else high
    ax.set_ylim(low, high)
    seen = [y for y in (level, -level) if low < y < high]
    for y in seen:
        ax.axhline(y, **look)
    return bool(seen)


def write_note(ax: Axes, text: str) -> None:
    """Write a level that is outside the range of an axis at its top, in room made for it."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.25 * (high - low))
    ax.annotate(
        text,
        (1.0, 1.0),
        (-3.0, -3.0),
        "axes fraction",
        "offset points",
        ha="right",
        va="top",
        fontsize=7.0,
        color="0.3",
        zorder=5.0,
        bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.8},
    )


def _legend(fig: Figure, handles: Sequence[Artist]) -> tuple[Legend, float]:
    """Set the legend in as few rows as fit the page's width; return it and its height [in]."""
    columns = len(handles)
    while True:
        legend = fig.legend(
            handles=list(handles),
            loc="upper left",
            ncols=columns,
            frameon=False,
            borderpad=0.1,
            borderaxespad=0.0,
            columnspacing=1.6,
            handlelength=2.8,
        )
        legend.set_in_layout(False)
        box = legend.get_window_extent()
        if columns <= 1 or box.width <= 0.985 * fig.bbox.width:
            return legend, float(box.height) / fig.dpi
        legend.remove()
        columns -= 1
