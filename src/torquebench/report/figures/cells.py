"""A signal of many controllers over time: a row of small panels for each, instead of lines over one another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import REFERENCE, SHADE, finish_page, is_narrow, new_page, printable
from torquebench.report.figures.run_view import TIME, Run, RunView

MOST_LINES = 5
"""Controllers in one panel; of more, each has its own."""
_MOST_NARROW = 2  # joints side by side in one column of a journal; more are drawn as one
_PARTS = 240  # of the time, in each of which the signal is drawn from its least to its greatest
_LEVEL: dict[str, Any] = {"color": "0.2", "linewidth": 0.7, "linestyle": (0, (1.5, 1.5)), "zorder": 3.0}


def draw_cells(
    x: RunView,
    label: str,
    signals: Mapping[str, Array],
    levels: Mapping[str, Array],
    level: str,
    note: Callable[[Run], str],
    reference: Array | None = None,
    rescale: Callable[[Figure], list[Artist]] = lambda _: [],
) -> Figure:
    """Draw the range of a signal over time: a row for each controller, a column for each joint, the same axes.

    In one column of a journal three joints or more are drawn as one: from the least to the greatest of all.

    Args:
        x: The runs.
        label: Of the y axis.
        signals: Controller -> values (N, n), of those that have the signal.
        levels: Controller -> levels drawn at +- their values, (n,), where they are in view.
        level: What the levels are, for the legend.
        note: Returns what follows the name of a run.
        reference: What all are to follow, (N, n), dashed; not where joints are drawn as one.
        rescale: Sets the scales of the axes, and returns what the legend says of them.
    """
    together = is_narrow() and len(x.joint_names) > _MOST_NARROW
    columns = ["all joints"] if together else list(x.joint_names)
    fig = new_page(len(x.runs), 0.72, 0.95)
    grid = fig.subplots(len(x.runs), len(columns), sharex=True, sharey=True, squeeze=False)
    whole = [signals[run.name] for run in x.runs if run.data.completed and run.name in signals]
    failed = [signals[run.name] for run in x.runs if not run.data.completed and run.name in signals]
    low, high = style.limits(whole, failed)
    grid[0, 0].set_ylim(low, high)
    grid[0, 0].set_xlim(0.0, x.longest.t[-1] + x.control_period)
    marked = False
    for row, run in zip(grid, x.runs, strict=True):
        ending = "" if run.data.completed else f" ({run.data.ending})"
        row[0].set_title(" ", fontsize=7.5)  # the room for a name, whose own width would push the panels apart
        name = row[0].text(
            0.0, 1.05, printable(run.name) + ending + note(run), fontsize=7.5, transform=row[0].transAxes
        )
        name.set_in_layout(False)
        for i, ax in enumerate(row):
            ax.set_label(f"{run.name} {columns[i]}")
            ax.axvspan(0.0, x.metrics_from, **SHADE)
            if reference is not None and not together:
                ax.plot(x.longest.t, reference[:, i], **REFERENCE)
            if run.name not in signals:
                continue
            own = slice(None) if together else slice(i, i + 1)
            t, least, most = _ranges(run, np.clip(signals[run.name][:, own], 2.0 * low - high, 2.0 * high - low))
            ax.fill_between(t, least, most, color=run.look["color"], linewidth=0.6, zorder=2.0)
            for value in set(levels[run.name][own].tolist()) if run.name in levels else ():
                for at in (value, -value):
                    if low < at < high:
                        marked = True
                        ax.axhline(at, **_LEVEL)
    for ax, name in zip(grid[-1], columns, strict=True):
        ax.set_xlabel(f"{TIME}\n{printable(name)}")
        ax.locator_params(axis="x", nbins=4)
    fig.supylabel(label, fontsize=8.0)
    keys: list[Artist] = [Patch(color="0.6", label=f"least to greatest in each 1/{_PARTS} of the run")]
    keys += [Line2D([], [], label=level + ("" if marked else " (beyond the axes)"), **_LEVEL)] if levels else []
    keys += [Line2D([], [], label="reference", **REFERENCE)] if reference is not None and not together else []
    keys += rescale(fig)
    finish_page(fig, x.title, x.subtitle, [*keys, *x.shade()])
    return fig


def _ranges(run: Run, values: Array) -> tuple[Array, Array, Array]:
    """Return times (P,), and the least and greatest of the values (N, m) in each part of the run."""
    finite = np.isfinite(values).all(axis=1)
    t, values = run.data.t[finite], values[finite]
    if not len(t):
        return t, t, t
    first = np.unique(np.linspace(0, len(t), _PARTS, endpoint=False).astype(np.intp))
    least, most = np.minimum.reduceat(values, first).min(axis=1), np.maximum.reduceat(values, first).max(axis=1)
    return np.append(t[first], t[-1]), np.append(least, least[-1]), np.append(most, most[-1])
