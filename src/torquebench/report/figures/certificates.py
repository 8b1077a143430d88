"""The figure of the stability certificates over time: Lyapunov function, its rate, and what is left of the gain."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures import style
from torquebench.report.figures.layout import LIMIT, finish_page, new_page, printable
from torquebench.report.figures.run_view import RunView

FLOOR = 1e-12
"""Lowest V shown [J]."""


def draw_certificates(x: RunView) -> Figure | None:
    """Draw V, dV/dt and the least margin of K over the joints; None where no controller has certificates."""
    if not x.certificates:
        return None
    fig = new_page(3, 1.6, 2.0)
    panels = fig.subplots(3, 1, sharex=True)
    looks = {run.name: run.look | {"linewidth": 1.1} for run in x.runs}
    margins = {name: 100.0 * np.min(found.margin / found.K, axis=1) for name, found in x.certificates.items()}
    for name, found in x.certificates.items():
        for ax, y in zip(panels, (np.maximum(found.V, FLOOR), found.V_rate, margins[name]), strict=True):
            ax.plot(found.t, y, **looks[name])
    panels[0].set_yscale("log")
    panels[0].set_ylabel("V, (108) [J]")
    panels[1].set_ylabel("dV/dt, (109) [W]")
    reach = max(1e-6, *(float(np.quantile(np.abs(found.V_rate), 0.99)) for found in x.certificates.values()))
    panels[1].set_ylim(-1.15 * reach, 1.15 * reach)
    panels[2].set_ylabel("K less (123),\nworst joint [% of K]")
    low = min(float(np.quantile(y, 0.001)) for y in margins.values())
    panels[2].set_ylim(max(-400.0, 1.1 * min(low, 0.0) - 5.0), 105.0)
    style.plain_powers(panels[0].yaxis)
    for ax in panels[1:]:
        ax.axhline(0.0, **LIMIT)
    panels[2].set_xlabel("time [s]")
    panels[2].set_xlim(0.0, max(float(found.t[-1]) for found in x.certificates.values()))
    keys = [Line2D([], [], label=printable(name), **looks[name]) for name in x.certificates]
    finish_page(fig, x.title, x.subtitle, keys)
    return fig
