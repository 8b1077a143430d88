"""Figures of tuning: the best objective so far against the number of evaluations, and the front of two objectives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.report.figures.layout import finish_page, panel_grid
from torquebench.report.figures.style import Unit, fit_scale, journal_style, spot_looks

OTHERS: dict[str, Any] = {"color": "0.82", "linewidth": 0.8, "zorder": 1.0}


@journal_style()
def draw_tuning(
    courses: Mapping[str, Sequence[Sequence[float]]],
    laws: Mapping[str, str],
    label: str,
    unit: Unit,
    heading: tuple[str, str],
    band: str,
) -> Figure:
    """Draw a panel for each controller: median of its seeds with their range, its own gains, the others in grey.

    Args:
        courses: Controller -> of each seed the best objective after each evaluation, infinite until gains are feasible.
        laws: Controller -> name of its law.
        label: Title of the objective.
        unit: Its unit.
        heading: Title and subtitle.
        band: What the range of the seeds is called.
    """
    fig, panels = panel_grid(list(courses), "evaluations", [f"{label} [{unit.name}]"] * len(courses))
    looks, known = spot_looks(laws), dict[str, np.ndarray]()
    for name, seeds in courses.items():
        values = unit.factor * np.array(seeds)
        known[name] = np.where(np.isfinite(values), values, np.nan)
    everything = np.concatenate([values.ravel() for values in known.values()])
    middle = {name: _middle(values) for name, values in known.items()}
    for ax, (name, values) in zip(panels, known.items(), strict=True):
        fit_scale(ax.yaxis, everything)
        for other in courses:
            x = np.arange(1, len(middle[other]) + 1)
            if other != name:
                ax.plot(x, middle[other], drawstyle="steps-post", **OTHERS)
        x, colour = np.arange(1, values.shape[1] + 1), looks[name]["color"]
        whole = np.isfinite(values).all(axis=0)
        low, high = values[:, whole].min(axis=0), values[:, whole].max(axis=0)
        ax.fill_between(x[whole], low, high, step="post", color=colour, alpha=0.25, linewidth=0.0, zorder=2.0)
        ax.plot(x, middle[name], drawstyle="steps-post", color=colour, linewidth=1.4, zorder=3.0)
        if np.isfinite(values[0, 0]):
            ax.plot([1], [values[0, 0]], "o", markersize=4.5, color=colour, markerfacecolor="white", zorder=4.0)
        elif not np.isfinite(values).any():
            ax.text(0.5, 0.5, "no feasible gains found", transform=ax.transAxes, ha="center", color="0.3")
        ax.set_xlim(0, values.shape[1])
        if np.isfinite(everything).any():
            span = np.nanmin(everything), np.nanmax(everything)
            ax.set_ylim((span[0] / 1.3, span[1] * 1.3) if ax.get_yscale() == "log" else (0.0, 1.05 * span[1]))
    handles = [
        Line2D([], [], color="0.2", linewidth=1.4, label="median of the seeds"),
        Patch(color="0.2", alpha=0.25, linewidth=0.0, label=band),
        Line2D([], [], color="0.2", marker="o", markerfacecolor="white", linestyle="none", label="its own gains"),
        Line2D([], [], **OTHERS, label="the other laws"),
    ]
    finish_page(fig, *heading, handles)
    return fig


def _middle(values: np.ndarray) -> np.ndarray:
    """Return the median of the seeds, (N,), NaN where half of them or more have nothing."""
    ordered = np.sort(np.where(np.isfinite(values), values, np.inf), axis=0)[len(values) // 2]
    middle: np.ndarray = np.where(np.isfinite(ordered), ordered, np.nan)
    return middle


@journal_style()
def draw_fronts(
    fronts: Mapping[str, Sequence[Sequence[float]]],
    own: Mapping[str, Sequence[float]],
    laws: Mapping[str, str],
    objectives: Sequence[tuple[str, Unit]],
    heading: tuple[str, str],
) -> Figure:
    """Draw a panel for each controller: its front and its own gains, the fronts of the others in grey.

    Args:
        fronts: Controller -> both objectives of each point, by the first.
        own: Controller -> both of the law's own gains, which may be infinite.
        laws: Controller -> name of its law.
        objectives: Title and unit of both: the first is drawn upwards.
        heading: Title and subtitle.
    """
    (upwards, up), (across, right) = objectives
    fig, panels = panel_grid(list(fronts), f"{across} [{right.name}]", [f"{upwards} [{up.name}]"] * len(fronts))
    scaled = {name: np.array(points).reshape(-1, 2) * (up.factor, right.factor) for name, points in fronts.items()}
    starts = {name: np.array(point) * (up.factor, right.factor) for name, point in own.items()}
    shown = np.concatenate([*scaled.values(), *(start[None] for start in starts.values() if np.isfinite(start).all())])
    looks = spot_looks(laws)
    for ax, (name, points) in zip(panels, scaled.items(), strict=True):
        for axis, values in ((ax.yaxis, shown[:, 0]), (ax.xaxis, shown[:, 1])):
            fit_scale(axis, values)
        for other, beside in scaled.items():
            if other != name:
                ax.plot(beside[:, 1], beside[:, 0], drawstyle="steps-pre", **OTHERS)
        look = {"color": looks[name]["color"], "zorder": 3.0}
        ax.plot(points[:, 1], points[:, 0], "o-", markersize=3.0, linewidth=1.1, drawstyle="steps-pre", **look)
        if np.isfinite(starts[name]).all():
            ax.plot(*starts[name][::-1], "o", markersize=5.0, markerfacecolor="white", **look)
        if not len(points):
            ax.text(0.5, 0.5, "no feasible gains found", transform=ax.transAxes, ha="center", color="0.3")
        for scale, limits, set_limits, values in (
            (ax.get_yscale(), ax.get_ylim(), ax.set_ylim, shown[:, 0]),
            (ax.get_xscale(), ax.get_xlim(), ax.set_xlim, shown[:, 1]),
        ):
            if len(values):
                limits = (values.min() / 1.3, values.max() * 1.3) if scale == "log" else (0.0, 1.05 * values.max())
            set_limits(limits)
    handles = [
        Line2D([], [], color="0.2", marker="o", markersize=3.0, label="front over all seeds"),
        Line2D([], [], color="0.2", marker="o", markerfacecolor="white", linestyle="none", label="the law's own gains"),
        Line2D([], [], **OTHERS, label="the other laws"),
    ]
    finish_page(fig, *heading, handles)
    return fig
