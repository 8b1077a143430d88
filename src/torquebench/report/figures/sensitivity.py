"""Sensitivity of a metric: the strongest effects of constants and drawn keys on each law, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.report.figures.layout import LIMIT, finish_page, panel_grid, printable
from torquebench.report.sweep_tables import explained_text
from torquebench.sweep.effects import strongest
from torquebench.sweep.sensitivity import Sensitivity

MOST = 8
"""Effects shown for each law, more where more matter."""
COLUMNS = 3
_MATTERS: dict[str, Any] = {"color": "0.1"}
_OTHER: dict[str, Any] = {"color": "0.6", "markerfacecolor": "white"}
_SPOT: dict[str, Any] = {"marker": "o", "markersize": 4.0, "linewidth": 1.2}


def draw_sensitivity(sensitivities: Sequence[Sensitivity], title: str, subtitle: str) -> Figure:
    """Draw the effects on one metric, a panel for each law.

    Args:
        sensitivities: Of one metric; those without effects are passed over.
        title, subtitle: Headings.
    """
    shown = [(one, one.effects) for one in sensitivities if one.effects is not None]
    height = 0.45 + 0.17 * max(len(strongest(found.effects, MOST)) for _, found in shown)
    names = [one.controller for one, _ in shown]
    x_label = "rank regression coefficient [1]"
    fig, panels = panel_grid(names, x_label, [""] * len(shown), COLUMNS, (height, height))
    for ax, (one, found) in zip(panels, shown, strict=True):
        effects = strongest(found.effects, MOST)
        for place, effect in enumerate(effects):
            look = _SPOT | (_MATTERS if effect.matters else _OTHER)
            ax.plot((effect.low, effect.strength, effect.high), [place] * 3, markevery=(1, 2), **look)
        ax.axvline(0.0, **LIMIT)
        ax.set_yticks(range(len(effects)), [printable(effect.name) for effect in effects])
        ax.set_ylim(len(effects) - 0.4, -0.6)
        ax.set_xlim(-1.05, 1.05)
        ax.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0])
        ax.tick_params(labelbottom=True)
        ax.set_title(f"{printable(one.controller)}\n{one.draws} draws, {explained_text(found)}")
    handles = [
        Line2D([], [], label="matters; the 95 % intervals hold for all at once", **_SPOT | _MATTERS),
        Line2D([], [], label="cannot be told from none", **_SPOT | _OTHER),
    ]
    finish_page(fig, title, subtitle, handles)
    return fig
