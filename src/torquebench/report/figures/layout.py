"""One page of panels: size, title, subtitle, one legend above the panels, a layout solved exactly once."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patches import Patch
from matplotlib.text import Text

PAGE_WIDTH = 7.2
"""Width of a figure that is not for one journal [in]: 183 mm, so that nothing is scaled down in print."""


class Sheet(NamedTuple):
    """Sheet that a figure is drawn on."""

    width: float
    """[in]."""
    suffix: str = ""
    """Of the names of its files."""
    headings: bool = True
    """Whether title and subtitle stand above it; in a paper the caption says what they say."""
    least_font: float = 0.0
    """[pt]."""


SCREEN = Sheet(PAGE_WIDTH)
PAPER = (Sheet(85.0 / 25.4, "-85mm", False, 7.0), Sheet(180.0 / 25.4, "-180mm", False, 7.0))
"""One column of a journal, and two."""
NARROW = 5.0
"""Width below which panels stand one below the other, and are lower [in]."""
_sheet = ContextVar("_sheet", default=SCREEN)
BODY_HEIGHT = 6.4
"""Height of the panels together, while they are few enough to be higher than the least height [in]."""
LEFT, GAP = 0.012, 0.08
"""Where headings and legend begin [share of the width]; room above and below them [in]."""
SHADE: dict[str, Any] = {"color": "0.95", "linewidth": 0.0, "zorder": 0.5}
REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 0.8, "linestyle": (0, (4.0, 2.5)), "zorder": 3.0}
LIMIT: dict[str, Any] = {"color": "0.4", "linewidth": 0.8, "linestyle": (0, (1.5, 1.5))}


@contextmanager
def on_sheet(sheet: Sheet) -> Iterator[None]:
    """Draw on a sheet for as long as this context lasts."""
    token = _sheet.set(sheet)
    try:
        yield
    finally:
        _sheet.reset(token)


def is_narrow() -> bool:
    """Whether the sheet is one column of a journal."""
    return _sheet.get().width < NARROW


def page_width() -> float:
    """Return the width of the sheet [in]."""
    return _sheet.get().width


def has_headings() -> bool:
    """Whether title and subtitle stand above a figure."""
    return _sheet.get().headings


def least_font(size: float) -> float:
    """Return a size of text [pt], or that of the smallest text of the sheet."""
    return max(size, _sheet.get().least_font)


def new_page(rows: int, least: float, most: float) -> Figure:
    """Return an empty page with room for `rows` rows of panels, each `least` to `most` inches high."""
    width = _sheet.get().width
    height = rows * min(most, max(least, BODY_HEIGHT / rows)) * (0.75 if is_narrow() else 1.0)
    fig = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(fig)
    return fig


def panel_grid(
    names: Sequence[str],
    x_label: str,
    y_labels: Sequence[str],
    columns: int | None = None,
    heights: tuple[float, float] = (1.3, 3.4),
) -> tuple[Figure, list[Axes]]:
    """Return a page with one panel per name, rows filled first.

    The x label and its numbers stand under the lowest panel of each column. A panel's y label stands beside it in the
    first column, and in the others where it differs from the one at its left. In one column of a journal panels that
    have the same y label share one.

    Args:
        names: Titles of the panels, which are their labels too.
        x_label: Label of every x axis.
        y_labels: Label of each y axis.
        columns: Panels side by side; None for two, three above eight panels.
        heights: Least and greatest height of a panel [in].
    """
    n = len(names)
    columns = 1 if is_narrow() else min(n, columns or (2 if n <= 8 else 3))
    rows = -(-n // columns)
    fig = new_page(rows, *heights)
    places = list(fig.subplots(rows, columns, squeeze=False).flat)
    for ax in places[n:]:
        ax.remove()
    panels = places[:n]
    if is_narrow() and rows > 1 and len(set(y_labels)) == 1:
        fig.supylabel(y_labels[0].replace("\n", " "), fontsize=8.0)
        y_labels = [""] * n
    for i, (ax, name) in enumerate(zip(panels, names, strict=True)):
        ax.set_label(name)
        ax.set_title(printable(name))
        if i % columns == 0 or y_labels[i] != y_labels[i - 1]:
            ax.set_ylabel(y_labels[i] if rows <= 3 or "\n" in y_labels[i] else y_labels[i].replace(" [", "\n["))
        lowest = i + columns >= n
        ax.set_xlabel(x_label if lowest else "")
        ax.tick_params(labelbottom=lowest)
    return fig, panels


def finish_page(fig: Figure, title: str, subtitle: str, handles: Sequence[Artist]) -> None:
    """Set title, subtitle and the shared legend above the panels, make room for them, freeze the layout."""
    columns = dict[int, list[Axes]]()
    for ax in fig.axes:
        place = ax.get_subplotspec()
        if place is not None and ax.get_label() != "<colorbar>":
            columns.setdefault(place.colspan.start, []).append(ax)
    for panels in columns.values():
        if len({(ax.get_xscale(), ax.get_xlim()) for ax in panels}) > 1:  # the lowest panel's numbers are its own alone
            for ax in panels:
                ax.tick_params(labelbottom=True)
    rows = [(line, 10.0, "bold", "black") for line in textwrap.wrap(printable(title), 78)]
    for part in subtitle.splitlines():
        rows += [(line, 7.5, "normal", "0.3") for line in textwrap.wrap(printable(part), 116)]
    rows = rows if _sheet.get().headings else []
    for written in fig.findobj(Text) if least_font(0.0) else ():
        if isinstance(written, Text):
            written.set_fontsize(least_font(float(written.get_fontsize())))
    legend = _legend(fig, handles) if handles else None
    header = 2.2 * GAP + sum(size * 1.45 / 72.0 for _, size, _, _ in rows)
    header += legend.get_window_extent().height / fig.dpi if legend else 0.0
    height = fig.get_figheight() + header
    fig.set_figheight(height)
    top = 1.0 - GAP / height
    for text, size, weight, colour in rows:
        at = fig.text(LEFT, top, text, fontsize=size, fontweight=weight, color=colour, va="top")
        at.set_in_layout(False)
        top -= size * 1.45 / 72.0 / height
    if legend:
        legend.set_bbox_to_anchor((LEFT, top - 0.5 * GAP / height))
    fig.set_layout_engine("constrained", rect=(0.004, 0.004, 0.99, 1.0 - header / height - 0.004))
    _solve(fig)


def _solve(fig: Figure) -> None:
    """Lay the page out once, for good, without the drawing that matplotlib's own way of laying out does as well.

    Lines around panels are left out of the measuring, and labels of axes stay where they are put: matplotlib would
    measure every number of every axis again in each drawing.
    """
    engine, renderer = fig.get_layout_engine(), fig.canvas.get_renderer()  # type: ignore[attr-defined]
    for ax in fig.axes:
        for spine in ax.spines.values():
            spine.set_in_layout(False)
    engine.execute(fig)  # type: ignore[union-attr]
    fig.set_layout_engine(None)  # solved again, panels would move by round-off; a placeholder, "none", draws twice
    for ax in fig.axes:
        locator: Any = ax.get_axes_locator()
        ax.apply_aspect(locator(ax, renderer) if locator else None)
        # the solver's round-off follows memory addresses: not the same in every run
        x, y, width, height = (round(float(edge), 6) for edge in ax.get_position().bounds)
        ax.set_position((x, y, width, height))
    _pin_labels(fig, renderer)


def _pin_labels(fig: Figure, renderer: Any) -> None:
    """Leave the labels of all axes where they are, those of the y axes of panels above one another on one line.

    A label that would leave the page there stays as near to that line as it can.
    """
    for axis in [axis for ax in fig.axes for axis in (ax.xaxis, ax.yaxis) if axis.label.get_text()]:
        axis.get_tightbbox(renderer)  # puts the label beside the numbers
        at = axis.label.get_transform().transform(axis.label.get_position())
        axis.set_label_coords(*axis.axes.transAxes.inverted().transform(at).round(6).tolist())
    columns: dict[tuple[float, ...], list[Axes]] = {}
    for ax in fig.axes:
        columns.setdefault(tuple(ax.get_position().intervalx.tolist()), []).append(ax)
    for panels in columns.values():
        named = [ax.yaxis for ax in panels if ax.get_ylabel()]
        least = min((axis.label.get_position()[0] for axis in named), default=0.0)
        for axis in named:
            axis.set_label_coords(least, axis.label.get_position()[1])
            beyond = 0.004 * fig.bbox.width - axis.label.get_window_extent(renderer).x0  # of two lines beside one
            if beyond > 0.0:
                axis.set_label_coords(least + beyond / axis.axes.bbox.width, axis.label.get_position()[1])


def printable(text: str) -> str:
    """Replace control characters, which an SVG file cannot hold."""
    return "".join(c if c.isprintable() else " " for c in text)


def shade_key(label: str) -> Patch:
    """Return the legend entry of a shaded range, darker than the range so that its small patch is seen."""
    return Patch(label=label, **SHADE | {"color": "0.9"})


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
    box = {"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.8}
    at = {"transform": ax.transAxes, "ha": "right", "va": "top"}
    ax.text(0.985, 0.96, text, fontsize=7.0, color="0.3", zorder=5.0, bbox=box, **at)  # type: ignore[arg-type]


def _legend(fig: Figure, handles: Sequence[Artist]) -> Legend:
    """Set the legend in as few rows as fit the page's width."""
    for handle in handles:
        handle.set_label("\n".join(textwrap.wrap(str(handle.get_label()), int(16.0 * fig.get_figwidth()))))
    for columns in range(len(handles), 0, -1):
        legend = fig.legend(handles=handles, loc="upper left", ncols=columns)
        legend.set_in_layout(False)
        if columns == 1 or legend.get_window_extent().width <= 0.985 * fig.bbox.width:
            break
        legend.remove()
    return legend
