"""Plots the gain at which each law of a sweep starts to shake, over one key; a panel for each value of another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import offset_copy

from torquebench.experiment.reference import unit_of
from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, panel_grid, printable
from torquebench.report.figures.sweep_labels import key_label, key_values, value_text
from torquebench.sweep.border import Level, level_of
from torquebench.sweep.table import Table, rows_by

NONE: dict[str, Any] = {"marker": "^", "markerfacecolor": "white", "linestyle": "none", "markersize": 4.5}
"""Look of a point at the end of the search, up to which nothing shakes."""
ALL = NONE | {"marker": "v"}
"""Look of one at its beginning, from which on everything shakes."""
BESIDE = 5.0
"""How far right of each other such points of laws are that have the same place [pt]."""


def draw_border(
    table: Table, keys: Sequence[str], border: str, spots: Mapping[str, Mapping[str, Any]], title: str, subtitle: str
) -> Figure:
    """Draw the border of each law over the first key: median, interval, prediction.

    Args:
        table: The sweep's table.
        keys: Key along x, and that of the panels, if there is one.
        border: The gain.
        spots: Looks of the controllers, as of `spot_looks`.
        title, subtitle: Headings.
    """
    xs = key_values(table, keys[0])
    apart = key_values(table, keys[1]) if len(keys) > 1 else [""]
    cells = rows_by(table, "controller", *keys)
    names = [panel_title(keys[1], x) for x in apart] if len(keys) > 1 else [""]
    fig, panels = panel_grid(names, key_label(keys[0]), [border_label(border)] * len(names), None, (2.2, 3.0))
    laws = [law for law in spots if any(at[0] == law for at in cells)]
    words, ends, shown, drawn = isinstance(xs[0], str), list[float](), set[str](), set[str]()
    for ax, value in zip(panels, apart, strict=True):
        taken = Counter[tuple[float, float]]()
        for law in laws:
            own = {at: cells[place] for at, x in enumerate(xs) if (place := (law, x, value)[: 1 + len(keys)]) in cells}
            levels = {(at if words else float(xs[at])): level_of(table, rows) for at, rows in own.items()}
            own_ends = _draw(ax, levels, dict(spots[law]), shown, taken)
            ends += own_ends
            drawn |= {law} if own_ends else set()
        if words:
            ax.set_xticks(range(len(xs)), [value_text(x) for x in xs])
        else:
            style.fit_scale(ax.xaxis, xs)
    low, high = (min(ends), max(ends)) if ends else (0.1, 1.0)
    for ax in panels:
        ax.set_yscale("log")
        ax.set_ylim(low / 1.3, high * 1.3)
        style.plain_numbers(ax.yaxis, high / low)
    handles = [
        Line2D([], [], label=printable(law), markersize=4.0, **{**spots[law], "linestyle": "-"})
        for law in laws
        if law in drawn
    ]
    grey: dict[str, Any] = {"color": "0.3"}
    if "predicted" in shown:
        handles.append(Line2D([], [], label="predicted", linestyle="--", linewidth=1.0, **grey))
    if "none" in shown:
        handles.append(Line2D([], [], label="none up to here", **NONE | grey))
    if "all" in shown:
        handles.append(Line2D([], [], label="shakes from here on", **ALL | grey))
    finish_page(fig, title, subtitle, handles)
    return fig


def border_label(key: str) -> str:
    """Return the label of the axis of a gain along which borders were searched."""
    unit = unit_of(key)
    return f"first {key.rpartition('.')[2]}{'' if unit is None else f' [{unit}]'} that shakes"


def panel_title(key: str, value: float | str) -> str:
    """Return the title of the panel of one value of a key, such as ``payload.mass 3 kg``."""
    unit = unit_of(key)
    return f"{'.'.join(key.split('.')[-2:])} {value_text(value)}{'' if unit in (None, '1') else f' {unit}'}"


def _draw(
    ax: Any, levels: Mapping[float, Level], look: dict[str, Any], shown: set[str], taken: Counter[Any]
) -> list[float]:
    """Draw the borders of one law and return the ends of what is drawn.

    Args:
        ax: The panel.
        levels: Place along x -> borders.
        look: Look of the controller.
        shown: Which kinds of marks have been drawn; added to.
        taken: How many points at an end of the search other laws have at a place, and this one then; added to.
    """
    x, ends = np.array(list(levels)), list[float]()
    colour = look["color"]
    found = {name: np.array([getattr(one, name) for one in levels.values()]) for name in Level._fields}
    inside = np.isfinite(found["border"]) & np.isfinite(found["before"])
    y = np.where(inside, found["border"], np.nan)
    ax.plot(x, y, linewidth=1.2, markersize=3.5, **{**look, "linestyle": "-"})
    low, high = (np.where(inside & np.isfinite(found[name]), found[name], np.nan) for name in ("low", "high"))
    ax.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
    again = np.isfinite(found["last"]) & inside
    ax.vlines(x[again], y[again], found["last"][again], color=colour, linewidth=0.8)
    predicted = np.where(np.isfinite(found["predicted"]), found["predicted"], np.nan)
    if np.isfinite(predicted).any():
        ax.plot(x, predicted, color=colour, linestyle=(0, (3.0, 2.0)), linewidth=0.9)
        shown.add("predicted")
    for name, at, where, mark in (
        ("none", found["before"], np.isinf(found["border"]), NONE),
        ("all", found["border"], np.isfinite(found["border"]) & np.isnan(found["before"]), ALL),
    ):
        if where.any():
            for place in zip(x[where].tolist(), at[where].tolist(), strict=True):
                moved = offset_copy(ax.transData, ax.figure, BESIDE * taken[place], 0.0, "points")
                ax.plot(*place, color=colour, transform=moved, **mark)
                taken[place] += 1
            shown.add(name)
            ends += at[where].tolist()
    for values in (y, low, high, predicted, found["last"][again]):
        ends += values[np.isfinite(values)].tolist()
    return ends
