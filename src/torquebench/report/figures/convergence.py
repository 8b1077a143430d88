"""The worst run found so far against the number of runs: a panel for each law, a line for each search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures.layout import finish_page, panel_grid
from torquebench.report.figures.style import Unit, journal_style

LINES: Mapping[str, Mapping[str, Any]] = {
    "cma": {"color": "#0b5fa5", "linestyle": "-"},
    "random": {"color": "#b5651d", "linestyle": (0, (4, 2))},
    "corners": {"color": "#4a7a3a", "linestyle": (0, (1, 1))},
}
"""Method -> its look."""


@journal_style()
def draw_convergence(
    courses: Mapping[str, Mapping[str, Sequence[Sequence[float]]]],
    nominal: Mapping[str, float],
    label: str,
    unit: Unit,
    limit: float | None,
    titles: Mapping[Any, str],
    heading: tuple[str, str],
) -> Figure:
    """Draw the worst value so far of each search; a run that failed is a cross at the top, where its line ends.

    Args:
        courses: Controller -> method -> for each seed the worst value after each run, infinite from the first failure.
        nominal: Controller -> value of the config's own run; NaN where that fails.
        label: Title of the metric.
        unit: Its unit.
        limit: What is claimed, if anything.
        titles: Method -> its title.
        heading: Title and subtitle.
    """
    fig, panels = panel_grid(list(courses), "runs", [f"{label} [{unit.name}]"] * len(courses))
    longest = max(len(course) for own in courses.values() for seeds in own.values() for course in seeds)
    known = {method for own in courses.values() for method in own}
    for ax, (name, own) in zip(panels, courses.items(), strict=True):
        for method, seeds in own.items():
            for course in seeds:
                y = unit.factor * np.array(course)
                x, fine = np.arange(1, len(y) + 1), np.isfinite(y)
                ax.plot(x[fine], y[fine], drawstyle="steps-post", linewidth=1.1, **LINES[method])
                if np.isposinf(y).any():
                    first = int(np.argmax(np.isposinf(y)))
                    ax.plot([x[first]], [0.97], "x", color=LINES[method]["color"], transform=ax.get_xaxis_transform())
        if np.isfinite(nominal[name]):
            ax.axhline(unit.factor * nominal[name], color="0.55", linewidth=0.8)
        if limit is not None:
            ax.axhline(unit.factor * limit, color="#b00020", linewidth=0.9, linestyle=":")
        ax.set_xlim(0, longest)
        if ax.dataLim.ymin >= 0.0:
            ax.set_ylim(bottom=0.0)
    handles = [Line2D([], [], label=titles[method], **look) for method, look in LINES.items() if method in known]
    handles.append(Line2D([], [], color="0.55", linewidth=0.8, label="the config's own run"))
    if limit is not None:
        handles.append(Line2D([], [], color="#b00020", linestyle=":", label="claimed"))
    if any(np.isposinf(course).any() for own in courses.values() for seeds in own.values() for course in seeds):
        handles.append(Line2D([], [], color="0.3", marker="x", linestyle="none", label="a run fails"))
    finish_page(fig, *heading, handles)
    return fig
