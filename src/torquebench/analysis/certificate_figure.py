"""The certificates of one experiment over time: Lyapunov function, its rate, and what is left of the gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.analysis import style
from torquebench.analysis.page import finish_page, new_page, printable
from torquebench.certificates import Certificate

FLOOR = 1e-12
"""Lowest V shown [J]."""
_BINS = 600
_ZERO: dict[str, Any] = {"color": "0.4", "linewidth": 0.8, "linestyle": (0, (1.5, 1.5))}


def certificate_figure(
    certificates: Mapping[str, Certificate], title: str, subtitle: str, order: Sequence[str]
) -> Figure:
    """Draw V, dV/dt and the least margin of K over the joints, of every controller that has certificates.

    Args:
        certificates: Controller name -> certificates.
        title, subtitle: Headings.
        order: Names of all controllers of the experiment, whose places set colour and dash.
    """
    with style.journal_style():
        fig = new_page(3, 1.6, 2.0)
        panels = fig.subplots(3, 1, sharex=True)
        looks = {
            name: {
                "color": style.COLOURS[k % len(style.COLOURS)],
                "linestyle": style.DASHES[k % len(style.DASHES)],
                "linewidth": 1.1,
            }
            for k, name in enumerate(order)
        }
        rates, margins = [], []
        for name, found in certificates.items():
            lost = 100.0 * np.min(found.margin / found.K, axis=1)
            rates.append(found.V_rate)
            margins.append(lost)
            shown = (np.maximum(found.V, FLOOR), found.V_rate, lost)
            for ax, y in zip(panels, shown, strict=True):
                ax.plot(*style.decimate(found.t, y, _BINS), **looks[name])
        panels[0].set_yscale("log")
        panels[0].set_ylabel("V, (108) [J]")
        panels[1].set_ylabel("dV/dt, (109) [W]")
        reach = max(1e-6, *(float(np.quantile(np.abs(rate), 0.99)) for rate in rates))
        panels[1].set_ylim(-1.15 * reach, 1.15 * reach)
        panels[2].set_ylabel("K less (123),\nworst joint [% of K]")
        low = min(float(np.quantile(y, 0.001)) for y in margins)
        panels[2].set_ylim(max(-400.0, 1.1 * min(low, 0.0) - 5.0), 105.0)
        style.plain_powers(panels[0].yaxis)
        for ax in panels[1:]:
            style.plain_numbers(ax)
            ax.axhline(0.0, **_ZERO)
        panels[2].set_xlabel("time [s]")
        panels[2].set_xlim(0.0, max(float(found.t[-1]) for found in certificates.values()))
        keys = [Line2D([], [], label=printable(name), **looks[name]) for name in certificates]
        finish_page(fig, title, subtitle, keys)
    return fig
