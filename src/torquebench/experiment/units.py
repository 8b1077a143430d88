"""The unit of a key of an experiment, as its description or its law gives it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, get_args

from torquebench.experiment.keys import Keys
from torquebench.experiment.schema import Experiment
from torquebench.laws import find_law
from torquebench.laws.law import law_names

_UNIT = re.compile(r"\[([^\[\]]+)\]")


def unit_of(key: str) -> str | None:
    """Return the unit of a key; ``1`` for a pure number, None for a word, a section, or what is not known.

    Args:
        key: Dotted path, such as ``plant.payload.mass``, ``disturbances[0].hold`` or ``controllers.*.gains.phi``.
    """
    parts = [re.sub(r"\[\d+\]", "", part) for part in key.split(".")]
    if parts[0] == "controllers" and "gains" in parts[:-1]:
        name = parts[parts.index("gains") + 1]
        gains = [find_law(law).gains for law in law_names()]
        return _only({own[name].unit for own in gains if name in own})
    sections: list[type[Keys]] = [Experiment]
    fields: list[Any] = []
    for part in parts:
        if sections and not part.isdecimal():  # below a mapping of names to numbers, its description holds
            fields = [section.model_fields[part] for section in sections if part in section.model_fields]
            sections = [section for field in fields for section in _sections(field.annotation)]
    return None if sections else _only({unit for field in fields for unit in _UNIT.findall(field.description or "")})


def _sections(annotation: Any) -> list[type[Keys]]:
    if isinstance(annotation, type) and issubclass(annotation, Keys):
        return [annotation]
    return [section for inner in get_args(annotation) for section in _sections(inner)]


def _only(units: set[str]) -> str | None:
    return units.pop() if len(units) == 1 else None


def joint_units(unit: str, slides: Sequence[bool]) -> str:
    """Return a unit of joints that turn as one of an arm's joints: in m where they slide, both where only some do.

    Args:
        unit: Unit with rad, with or without a prefix; one without rad is returned as it is.
        slides: Of each joint, whether it slides.
    """
    return ", ".join(dict.fromkeys(unit.replace("rad", "m") if own else unit for own in sorted(slides)))
