"""The figure of the torque of each joint, with a few instants enlarged."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.report.figures import style
from torquebench.report.figures.cells import MOST_LINES, draw_cells
from torquebench.report.figures.layout import LIMIT, SHADE, is_narrow, level_lines, new_page, printable, write_note
from torquebench.report.figures.run_view import TIME, RunView, draw

ZOOM = 0.060
"""Length of the torque figure's zoomed window [s], a third in one column of a journal; at least 20 control periods."""
ZOOM_FLOOR = 0.01
"""Least half-height of the zoomed window [limit]: calm torques that agree look alike."""
_ZOOMED: dict[str, Any] = {"facecolor": "#F0E442", "alpha": 0.6, "linewidth": 0.0, "zorder": 0.6}


def draw_torque(x: RunView) -> Figure:
    """Draw the torque after clipping, with its limits and chattering in the legend."""
    if len(x.runs) > MOST_LINES:
        shares = {run.name: 100.0 * run.data.tau / x.tau_max for run in x.runs}
        limit = dict.fromkeys(shares, np.full(len(x.joint_names), 100.0))
        word = "/".join(dict.fromkeys(x.by_kind("torque", "force")))
        return draw_cells(x, f"{word} [% of limit]", shares, limit, f"{word} limit", x.chattering_note)
    n = len(x.joint_names)
    zoom = zoom_window(x)
    fig = new_page(n, 1.05, 3.0)
    grid = fig.subplots(n, 2 if zoom else 1, width_ratios=(3.6, 1.4) if zoom else None, squeeze=False)
    limit_seen = False
    for i, name in enumerate(x.joint_names):
        ax = grid[i, 0]
        ax.set_label(name)
        unit = x.by_kind("[N m]", "[N]") if is_narrow() else x.by_kind("torque [N m]", "force [N]")
        ax.set_ylabel(f"{printable(name)}\n{unit[i]}")
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        draw(ax, x, {run.name: run.data.tau[:, i] for run in x.runs}, thin=True)
        if level_lines(ax, float(x.tau_max[i]), ax.get_ylim(), LIMIT):
            limit_seen = True
        else:
            write_note(ax, f"limit \u00b1{x.tau_max[i]:.4g} {x.by_kind('N m', 'N')[i]}")
        if zoom:
            ax.axvspan(*zoom, **_ZOOMED)
            draw_zoom(grid[i, 1], x, i, zoom)
        for panel in grid[i]:
            panel.set_xlabel(TIME if i == n - 1 else "")
            panel.tick_params(labelbottom=i == n - 1)
    word = "/".join(dict.fromkeys(x.by_kind("torque", "force")))
    others: list[Artist] = [Line2D([], [], label=f"{word} limit", **LIMIT)] if limit_seen else []
    if zoom:
        others.append(Patch(label=f"zoomed at the right ({1e3 * (zoom[1] - zoom[0]):.4g} ms)", **_ZOOMED))
    return x.finish(fig, lambda run: x.chattering_note(run), *others, *x.shade())


def zoom_window(x: RunView) -> tuple[float, float] | None:
    """Time span to enlarge [s]: the middle of the metrics' window, or of a shorter run.

    None where there is nothing to enlarge: the span would be most of the run, or holds no torque.
    """
    end = float(x.longest.t[-1])
    start = x.metrics_from if x.metrics_from < end else 0.0
    middle, half = (start + end) / 2.0, max(ZOOM / 3.0 if is_narrow() else ZOOM, 20.0 * x.control_period) / 2.0
    if 4.0 * half > end or not any(
        np.isfinite(run.data.tau[np.abs(run.data.t - middle) < half]).any() for run in x.runs
    ):
        return None
    return middle - half, middle + half


def draw_zoom(ax: Axes, x: RunView, joint: int, zoom: tuple[float, float]) -> None:
    """Draw the torque of `joint` of all runs of `x` into `ax`, held between control instants, over `zoom` [s]."""
    ax.set_label(f"{x.joint_names[joint]} zoom")
    shown = []
    for run in x.runs:
        t, tau = run.data.t, run.data.tau[:, joint]
        inside = (np.abs(t - sum(zoom) / 2.0) < (zoom[1] - zoom[0]) / 2.0 + 1.5 * x.control_period) & np.isfinite(tau)
        if not inside.any():
            continue
        shown.append(tau[inside])
        # Solid: dashes would take the edges off a torque that switches every instant.
        look = run.look | {"linewidth": 0.7 * run.look["linewidth"], "linestyle": "-"}
        ax.plot(t[inside], tau[inside], drawstyle="steps-post", **look)
    ax.set_xlim(*zoom)
    ax.set_ylim(*style.limits(shown, floor=ZOOM_FLOOR * float(x.tau_max[joint])))
    if is_narrow():
        ax.set_xticks([sum(zoom) / 2.0])
    else:
        ax.locator_params(axis="x", nbins=3)
