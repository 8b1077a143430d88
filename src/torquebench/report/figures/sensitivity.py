"""Sensitivity of a metric: the strongest effects of constants and drawn keys on each law, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page, printable
from torquebench.sweep.effects import strongest
from torquebench.sweep.sensitivity import Sensitivity

MOST = 8
"""Effects shown for each law, more where more matter."""
COLUMNS = 3


def draw_sensitivity(sensitivities: Sequence[Sensitivity], title: str, subtitle: str) -> Figure:
    """Draw the effects on one metric, a panel for each law.

    Args:
        sensitivities: Of one metric; those without effects are passed over.
        title, subtitle: Headings.
    """
    shown = [one for one in sensitivities if one.effects is not None]
    with style.journal_style():
        columns = min(COLUMNS, len(shown))
        lines = -(-len(shown) // columns)
        height = 0.45 + 0.17 * max(len(strongest(one.effects.effects, MOST)) for one in shown if one.effects)
        fig = new_page(lines, height, height)
        grid = fig.add_gridspec(lines, columns)
        for place, one in enumerate(shown):
            ax = fig.add_subplot(grid[place // columns, place % columns])
            _panel(ax, one)
            if place + columns >= len(shown):
                ax.set_xlabel("rank regression coefficient [1]")
        look: dict[str, Any] = {"marker": "o", "markersize": 4.0, "linewidth": 1.2}
        handles = [
            Line2D([], [], color=style.COLOURS[0], label="matters; the 95 % intervals hold for all at once", **look),
            Line2D([], [], color="0.6", markerfacecolor="white", label="cannot be told from none", **look),
        ]
        finish_page(fig, title, subtitle, handles)
    return fig


def _panel(ax: Axes, one: Sensitivity) -> None:
    shown = strongest(one.effects.effects, MOST) if one.effects else []
    for place, effect in enumerate(shown):
        colour = style.COLOURS[0] if effect.matters else "0.6"
        ax.plot((effect.low, effect.high), (place, place), color=colour, linewidth=1.2)
        face = colour if effect.matters else "white"
        ax.plot(effect.strength, place, "o", color=colour, markersize=4.0, markerfacecolor=face)
    ax.axvline(0.0, color="0.4", linewidth=0.8, linestyle=(0, (1.5, 1.5)))
    ax.set_yticks(range(len(shown)), [printable(effect.name) for effect in shown])
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_xlim(-1.05, 1.05)
    ax.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["\u22121", "\u22120.5", "0", "0.5", "1"])
    explained = one.effects.explained if one.effects else None
    share = "one at a time" if explained is None else f"{100.0 * max(explained, 0.0):.0f} % explained"
    ax.set_title(f"{printable(one.controller)}\n{one.draws} draws, {share}", loc="left", pad=3.0)
