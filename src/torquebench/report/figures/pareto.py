"""Error against chattering: every law and choice of a sweep with its intervals, and which of them are best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, least_font, new_page
from torquebench.report.figures.sweep_labels import key_label, key_values, law_name, value_text
from torquebench.statistics import Ratio, undominated
from torquebench.sweep.summary import level
from torquebench.sweep.table import Rows, Table, completed, grid_keys, metric_keys, row_values, rows_by

CHOSEN = ("controllers.", "run.control_period")
"""Beginnings of the keys that a designer chooses; the others are conditions that a law has to cope with."""
MOST_FAMILIES = 14
"""Lines that can be told apart; of more, each law is one family without lines."""
MOST_LABELS = 14
"""Ringed spots that have room for a label each."""
BESIDE = ((6.0, -7.0), (-6.0, -7.0), (6.0, 4.0), (-6.0, 4.0), (6.0, -16.0), (-6.0, -16.0), (6.0, 13.0), (-6.0, 13.0))
"""Where a label may stand beside its spot, the first first [pt]; at the left it ends there."""
_RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 10.0,
    "markerfacecolor": "none",
    "markeredgecolor": "black",
    "markeredgewidth": 0.8,
    "linestyle": "none",
}


class Spot(NamedTuple):
    """One choice of gains."""

    law: str
    family: str
    """Choices that are joined by a line, in the order given."""
    label: str
    """Written beside the spot, if it is on the front."""
    error: Ratio
    """RMS error [rad, or m]."""
    chattering: Ratio
    """Chattering [% of the torque limit]."""
    best: bool
    """Whether it is on the front."""


class Front(NamedTuple):
    """The spots of a figure of error against chattering, and how they are shown."""

    spots: tuple[Spot, ...]
    families: Mapping[str, str]
    """Family -> its name in the legend; one without spots is named all the same."""
    labels: str = ""
    """Labels of the spots; empty without labels."""
    joined: bool = True
    """Whether a line joins the spots of a family."""


def draw_pareto(front: Front, unit: str, laws: Mapping[str, str], title: str, subtitle: str) -> Figure:
    """Draw RMS error over chattering index on logarithmic axes, 95 % intervals as bars, the best choices ringed.

    Args:
        front: What is shown.
        unit: Unit of a thousandth of the error.
        laws: Controller -> name of its law.
        title, subtitle: Headings.
    """
    fig = new_page(1, 4.6, 4.6)
    ax = fig.subplots()
    style.fit_scale(ax.xaxis, [end for spot in front.spots for end in spot.chattering[1:3]])
    style.fit_scale(ax.yaxis, [end for spot in front.spots for end in spot.error[1:3]])
    keys = []
    owners = {spot.family: spot.law for spot in front.spots}
    for family, look in style.spot_looks({one: laws[owners.get(one, one)] for one in front.families}).items():
        look |= {"markersize": 4.0, "linewidth": 0.9}
        look |= {} if front.joined else {"linestyle": "none"}
        own = [spot for spot in front.spots if spot.family == family]
        if own:
            x = np.array([spot.chattering[:3] for spot in own]).T
            y = 1e3 * np.array([spot.error[:3] for spot in own]).T
            ax.errorbar(x[0], y[0], _arms(y), _arms(x), elinewidth=0.9, capsize=1.5, **look)
        keys.append(Line2D([], [], label=front.families[family], **look if own else {"linestyle": "none"}))
    best = [spot for spot in front.spots if spot.best]
    ax.plot([spot.chattering.ratio for spot in best], [1e3 * spot.error.ratio for spot in best], **_RING)
    ax.set_xlabel("chattering [% of tau_max]")
    ax.set_ylabel(f"RMS error [{unit}]")
    named = f"; {front.labels}" if front.labels else ""
    keys.append(Line2D([], [], label=f"no choice is better in both{named}", **_RING))
    finish_page(fig, title, subtitle, keys)
    _label(ax, best if front.labels else ())  # now that the panel has its place
    return fig


def _arms(values: Array) -> Array:
    """Return how far the ends of intervals are from their middles; rows of `values`: middle, lower, upper end."""
    return np.stack([values[0] - values[1], values[2] - values[0]])


def _label(ax: Axes, spots: Sequence[Spot]) -> None:
    """Write each spot's label beside it, within the panel and clear of the others where that is possible."""
    taken: list[Bbox] = []
    for spot in sorted(spots, key=lambda spot: spot.chattering.ratio):
        at = (spot.chattering.ratio, 1e3 * spot.error.ratio)
        label = ax.annotate(
            spot.label, at, BESIDE[0], textcoords="offset points", fontsize=least_font(6.5), color="0.25"
        )
        for x, y in (*BESIDE, BESIDE[1]):  # at the left, if it meets another one everywhere
            label.set_position((x, y))
            label.set_horizontalalignment("left" if x > 0.0 else "right")
            box = label.get_window_extent()
            inside = ax.bbox.x0 <= box.x0 and box.x1 <= ax.bbox.x1
            if inside and not any(box.overlaps(other) for other in taken):
                break
        taken.append(box)


def front_of(table: Table) -> Front:
    """Collect error and chattering of every law and choice, each in the condition in which it is worst.

    Keys of the grid that start as `CHOSEN` are choices, a key of one controller for this one alone; all others are
    conditions. Figures are geometric means over draws. A choice of which no draw completed in some condition is left
    out, one of which any run failed is not among the best. Spots are joined along the first key that is chosen.

    Args:
        table: The table.
    """
    laws = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    if not {"rmse", "chattering"} <= set(metric_keys(table)):
        return Front((), {})
    grid = [key for key in grid_keys(table) if len(key_values(table, key)) > 1 and key.startswith(CHOSEN)]
    chosen = {law: tuple(key for key in grid if _concerns(key, law)) for law in laws}
    along = {keys[0] for keys in chosen.values() if keys}
    alike = len(along) == 1 and all(chosen.values())
    choices: dict[str, dict[tuple[Any, ...], list[Rows]]] = {law: {} for law in laws}
    for (law, _), rows in rows_by(table, "controller", "case").items():
        values = row_values(table, chosen[law], int(rows[0]))
        choices[law].setdefault(tuple(values.items()), []).append(rows)
    found = []
    for law, own in choices.items():
        for choice, cases in own.items():
            error, chattering = (_worst([level(table, rows, key) for rows in cases]) for key in ("rmse", "chattering"))
            if error is None or chattering is None:
                continue
            words = [(key.split(".")[-1], value_text(value)) for key, value in choice if value is not None]
            family = ", ".join([law, *(" ".join(word) for word in words[1:])])
            label = (words[0][1] if alike else " ".join(words[0])) if words else law
            all_ran = all(bool(completed(table, rows).all()) for rows in cases)
            found.append(Spot(law, family, label, error, chattering, all_ran))
    whole = [place for place, spot in enumerate(found) if spot.best]
    points = [(found[place].error.ratio, found[place].chattering.ratio) for place in whole]
    best = {whole[place] for place in undominated(points)}
    spots = [spot._replace(best=place in best) for place, spot in enumerate(found)]
    families = {spot.family for spot in spots}
    joined = families <= set(laws) or len(families) <= MOST_FAMILIES
    if not joined:
        spots = [spot._replace(family=spot.law) for spot in spots]
    names = {
        family: law_name(table, family, rows)
        for law, rows in laws.items()
        for family in dict.fromkeys([spot.family for spot in spots if spot.law == law] or [law])
    }
    labels = f"its {key_label(along.pop()).split('.')[-1]}" if alike else "which it is"
    return Front(tuple(spots), names, labels if len(best) <= MOST_LABELS else "", joined)


def _worst(levels: Sequence[Ratio | None]) -> Ratio | None:
    known = [level for level in levels if level is not None]
    return max(known, key=lambda level: level.ratio) if len(known) == len(levels) else None


def _concerns(key: str, law: str) -> bool:
    return not key.startswith("controllers.") or key.split(".")[1] in ("*", law)
