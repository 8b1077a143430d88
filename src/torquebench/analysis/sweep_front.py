"""Error and chattering of every law and choice of a sweep: what is chosen, what is a condition, and which are best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from torquebench.analysis.front_page import Spot
from torquebench.analysis.sweep_parts import key_label, key_values, law_name, value_text
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


class Front(NamedTuple):
    """The spots of a figure of error against chattering, and how they are shown."""

    spots: tuple[Spot, ...]
    labels: str
    """What the spots' labels are; empty without labels."""
    order: tuple[str, ...]
    """Families in order; empty for that of the spots."""
    joined: bool
    """Whether a family's spots are joined by lines."""
    names: Mapping[str, str]
    """Family -> its name with how many runs of its law failed; laws that have no spot too."""


def front_of(table: Table) -> Front:
    """Return error and chattering of every law and choice, each in the condition in which it is worst.

    Keys of the grid that start as `CHOSEN` are choices, a key of one controller for this one alone; all others are
    conditions. Figures are geometric means over draws. A choice of which no draw completed in some condition is left
    out, one of which any run failed is not among the best. Spots are joined along the first key that is chosen.

    Args:
        table: The table.
    """
    laws = controllers(table)
    if not {"rmse", "hf"} <= set(metric_keys(table)):
        return Front((), "", (), True, {})
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
    """Return what each family of spots is called, and each law without one."""
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
