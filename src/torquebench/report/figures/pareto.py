"""Error against chattering: every law and choice of a sweep with its intervals, and which of them are best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.sweep_labels import key_label, key_values, law_name, value_text
from torquebench.statistics import Ratio, undominated
from torquebench.sweep.summary import level
from torquebench.sweep.table import (
    Rows,
    Table,
    completed,
    controllers,
    grid_keys,
    metric_keys,
    row_values,
    rows_by,
)

CHOSEN = ("controllers.", "run.control_period")
"""How keys begin that a designer chooses; the others are conditions that a law has to cope with."""
MOST_FAMILIES = 14
"""Lines that can be told apart; of more, each law is one family without lines."""
MOST_LABELS = 14


BESIDE = ((6.0, -7.0), (-6.0, -7.0), (6.0, 4.0), (-6.0, 4.0), (6.0, -16.0), (-6.0, -16.0), (6.0, 13.0), (-6.0, 13.0))
"""Where a label may stand beside its spot, the first first [pt]; at the left it ends there."""


class Spot(NamedTuple):
    """One choice of gains."""

    family: str
    """Choices that are joined by a line, in the order given."""
    label: str
    """Written beside the spot."""
    error: Ratio
    """RMS error [rad, or m]."""
    chattering: Ratio
    """HF [% of the torque limit]."""
    best: bool
    """Whether it is on the front."""


class Front(NamedTuple):
    """The spots of a figure of error against chattering, and how they are shown."""

    spots: tuple[Spot, ...]
    labels: str = ""
    """What the spots' labels are; empty without labels."""
    order: tuple[str, ...] = ()
    """Families whose places set colour and dash; empty for those of the spots."""
    joined: bool = True
    """Whether a line joins the spots of a family."""
    names: Mapping[str, str] = MappingProxyType({})
    """Family -> its name in the legend, with how many runs of its law failed; one without spots is named all the
    same."""


def draw_pareto(front: Front, title: str, subtitle: str, unit: str = "mrad") -> Figure:
    """Draw RMS error over chattering index on logarithmic axes, 95 % intervals as bars, the best choices ringed.

    Args:
        front: What is shown.
        title, subtitle: Headings.
        unit: Unit of a thousandth of the error.
    """
    spots, names = front.spots, front.names
    families = list(dict.fromkeys((*front.order, *(spot.family for spot in spots))))
    with style.journal_style():
        fig = new_page(1, 4.6, 4.6)
        ax = fig.add_subplot()
        for axis, figures in ((ax.xaxis, [s.chattering for s in spots]), (ax.yaxis, [s.error for s in spots])):
            style.fit_scale(axis, [figure.low for figure in figures] + [figure.high for figure in figures])
        keys = []
        for index, family in enumerate(families):
            own = [spot for spot in spots if spot.family == family]
            if not own:
                continue
            look = style.spot_look(index) | {"markersize": 4.0, "linewidth": 0.9}
            look |= {} if front.joined else {"linestyle": "none"}
            x, y = [s.chattering.ratio for s in own], [1e3 * s.error.ratio for s in own]
            ax.errorbar(
                x,
                y,
                elinewidth=0.9,
                capsize=1.5,
                **look,
                xerr=[
                    [a - s.chattering.low for a, s in zip(x, own, strict=True)],
                    [s.chattering.high - a for a, s in zip(x, own, strict=True)],
                ],
                yerr=[
                    [b - 1e3 * s.error.low for b, s in zip(y, own, strict=True)],
                    [1e3 * s.error.high - b for b, s in zip(y, own, strict=True)],
                ],
            )
            keys.append(Line2D([], [], label=names.get(family, family), **look))
        gone = [name for family, name in names.items() if family not in {spot.family for spot in spots}]
        keys += [Line2D([], [], linestyle="none", label=name) for name in gone]
        best = [spot for spot in spots if spot.best]
        ring: dict[str, Any] = {
            "marker": "o",
            "markersize": 10.0,
            "markerfacecolor": "none",
            "markeredgecolor": "black",
            "markeredgewidth": 0.8,
            "linestyle": "none",
        }
        ax.plot([s.chattering.ratio for s in best], [1e3 * s.error.ratio for s in best], **ring)
        ax.set_xlabel("chattering index HF [% of tau_max]")
        ax.set_ylabel(f"RMS error [{unit}]")
        keys.append(
            Line2D([], [], label="no choice is better in both" + (f"; {front.labels}" if front.labels else ""), **ring)
        )
        finish_page(fig, title, subtitle, keys)
        _label(ax, best)  # now that the panel has its place
    return fig


def _label(ax: Axes, spots: Sequence[Spot]) -> None:
    """Write each spot's label beside it, within the panel and clear of the others where that is possible."""
    taken: list[Bbox] = []
    for spot in sorted(spots, key=lambda spot: spot.chattering.ratio):
        label = ax.annotate(
            spot.label,
            (spot.chattering.ratio, 1e3 * spot.error.ratio),
            BESIDE[0],
            textcoords="offset points",
            fontsize=6.5,
            color="0.25",
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
    laws = controllers(table)
    if not {"rmse", "hf"} <= set(metric_keys(table)):
        return Front(())
    grid = [key for key in grid_keys(table) if len(key_values(table, key)) > 1 and key.startswith(CHOSEN)]
    chosen = {law: tuple(key for key in grid if _concerns(key, law)) for law in laws}
    along = {keys[0] for keys in chosen.values() if keys}
    alike = len(along) == 1 and all(chosen.values())
    by_law: dict[str, list[Rows]] = {law: [] for law in laws}
    for (law, _), rows in rows_by(table, "controller", "case").items():
        by_law[law].append(rows)
    found = [spot for law in laws for spot in _spots(table, law, by_law[law], chosen[law], alike)]
    whole = [place for place, spot in enumerate(found) if spot.best]
    best = undominated([(found[place].error.ratio, found[place].chattering.ratio) for place in whole])
    ringed = {whole[index] for index in best}
    labelled = len(ringed) <= MOST_LABELS
    spots = [
        spot._replace(best=place in ringed, label=spot.label if labelled else "") for place, spot in enumerate(found)
    ]
    labels = f"its {key_label(along.pop()).split('.')[-1]}" if alike else "which it is"
    labels = labels if labelled else ""
    families = {spot.family for spot in spots}
    if families <= set(laws):
        return Front(tuple(spots), labels, laws, True, _names(table, spots, laws))
    if len(families) <= MOST_FAMILIES:
        return Front(tuple(spots), labels, (), True, _names(table, spots, laws))
    lumped = [spot._replace(family=_law_of(spot, laws)) for spot in spots]
    return Front(tuple(lumped), labels, laws, False, _names(table, lumped, laws))


def _names(table: Table, spots: Sequence[Spot], laws: Sequence[str]) -> dict[str, str]:
    """Legend names of the families of spots, and of each law without one."""
    of_law = {spot.family: _law_of(spot, laws) for spot in spots}
    of_law |= {law: law for law in laws if law not in of_law.values()}
    rows = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    return {family: law_name(table, family, rows[law]) for family, law in of_law.items()}


def _spots(table: Table, law: str, cases_of: Sequence[Rows], keys: tuple[str, ...], alike: bool) -> list[Spot]:
    choices: dict[tuple[float | str | None, ...], list[Rows]] = {}
    for rows in cases_of:
        choices.setdefault(tuple(row_values(table, keys, int(rows[0])).values()), []).append(rows)
    found = []
    for values, cases in choices.items():
        error, chattering = (_worst([level(table, rows, key) for rows in cases]) for key in ("rmse", "hf"))
        if error is None or chattering is None:
            continue
        words = [
            (key.split(".")[-1], value_text(value))
            for key, value in zip(keys, values, strict=True)
            if value is not None
        ]
        family = ", ".join([law, *(" ".join(word) for word in words[1:])])
        label = (words[0][1] if alike else " ".join(words[0])) if words else law
        found.append(Spot(family, label, error, chattering, all(bool(completed(table, rows).all()) for rows in cases)))
    return found


def _law_of(spot: Spot, laws: Sequence[str]) -> str:
    return next(law for law in laws if _is_of(spot, law))


def _is_of(spot: Spot, law: str) -> bool:
    return spot.family == law or spot.family.startswith(f"{law}, ")


def _worst(levels: Sequence[Ratio | None]) -> Ratio | None:
    known = [level for level in levels if level is not None]
    return max(known, key=lambda level: level.ratio) if len(known) == len(levels) else None


def _concerns(key: str, law: str) -> bool:
    return not key.startswith("controllers.") or key.split(".")[1] in ("*", law)
