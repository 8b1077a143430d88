"""The figure of an arena: the front of every law, error against chattering on test draws, a panel for each chain."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.arena.pages import unit_of
from torquebench.arena.record import SELF, TUNED, Record
from torquebench.metrics import METRICS
from torquebench.report.figures.layout import finish_page, least_font, panel_grid
from torquebench.report.figures.style import fit_scale, journal_style, spot_looks
from torquebench.statistics import undominated

MOST = 10
"""Laws with a colour of their own; the others are grey."""
GREY: dict[str, Any] = {"color": "0.75", "linewidth": 0.8, "marker": "o", "markersize": 2.5, "zorder": 1.0}


@journal_style()
def fronts(record: Record) -> Figure:
    """Draw the tuned gains of each level, means over tunings, burdens and draws, joined; rings: nobody beats both.

    Entries that are nowhere among the best are grey. A hollow mark is an entry with the gains that it has by itself.

    Args:
        record: The arena.
    """
    unit, scale = unit_of(record)
    title = METRICS[record.metric].title
    fig, panels = panel_grid(
        list(record.chains), "chattering on test draws [% of tau_max]", [f"{title} [{unit}]"] * len(record.chains)
    )
    spots = {chain: _spots(record, chain, TUNED) for chain in record.chains}
    rings = {chain: _best(own) for chain, own in spots.items()}
    count = dict[str, int]()
    for ringed in rings.values():
        for entry, *_ in ringed:
            count[entry] = count.get(entry, 0) + 1
    laws = {row.entry: row.law for row in record.rows}
    shown = sorted(count if len(laws) > MOST else laws, key=lambda entry: -count.get(entry, 0))[:MOST]
    looks = spot_looks({entry: laws[entry] for entry in shown})
    for ax, chain in zip(panels, record.chains, strict=True):
        given = _spots(record, chain, SELF)
        every = [spot for own in (*spots[chain].values(), *given.values()) for spot in own]
        if every:
            fit_scale(ax.xaxis, [x for x, _ in every])
            fit_scale(ax.yaxis, [scale * y for _, y in every])
        for entry, own in spots[chain].items():
            x, y = np.array(own).T if own else ([], np.zeros(0))
            ax.plot(x, scale * y, **(looks[entry] | {"markersize": 4.0, "linewidth": 1.0} if entry in looks else GREY))
        for entry, own in given.items():
            colour = looks[entry]["color"] if entry in looks else GREY["color"]
            for x, y in own:
                ax.plot(
                    [x], [scale * y], marker="D", markersize=3.5, markerfacecolor="none", color=colour, linestyle=""
                )
        for _, x, y in rings[chain]:
            ax.plot(
                [x], [scale * y], marker="o", markersize=9.0, markerfacecolor="none", color="black", markeredgewidth=0.8
            )
    keys = [Line2D([], [], label=entry, **looks[entry]) for entry in shown]
    keys.append(Line2D([], [], label="other laws", **GREY))
    keys.append(Line2D([], [], label="as given", marker="D", markerfacecolor="none", color="0.4", linestyle=""))
    keys.append(
        Line2D(
            [], [], label="nobody is better in both", marker="o", markerfacecolor="none", color="black", linestyle=""
        )
    )
    words = f"{record.evaluations} evaluations x {record.seeds} tunings of every law; {record.draws} test draws"
    finish_page(fig, f"{record.name}: error against chattering, tuned alike", words, keys)
    for ax in panels:
        ax.tick_params(labelsize=least_font(7.0))
    return fig


def _spots(record: Record, chain: str, ruleset: str) -> dict[str, list[tuple[float, float]]]:
    """Return chattering and error of each entry at each level, those that completed, by chattering."""
    found = dict[str, list[tuple[float, float]]]()
    levels = record.levels if ruleset == TUNED else (math.inf,)
    for level in levels:
        for own in record.standings(chain, level, "", ruleset):
            if own.value == own.value and not own.note.startswith("expired"):
                found.setdefault(own.entry, []).append((own.chattering, own.value))
    return {entry: sorted(set(own)) for entry, own in found.items()}


def _best(spots: dict[str, list[tuple[float, float]]]) -> list[tuple[str, float, float]]:
    """Return the spots than which no other is better in both."""
    every = [(entry, x, y) for entry, own in spots.items() for x, y in own]
    return [every[i] for i in undominated([(x, y) for _, x, y in every])]
