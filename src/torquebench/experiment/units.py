"""Numbers with a unit, such as ``1 ms`` or ``30 %``, as numbers in the unit of their key."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any

from torquebench.experiment.yaml_tree import NUMBER

MULTIPLES = {
    "s": {"ms": "1e-3", "us": "1e-6", "min": "60"},
    "rad": {"mrad": "1e-3", "urad": "1e-6"},
    "rad/s": {"mrad/s": "1e-3"},
    "Hz": {"kHz": "1e3"},
    "m": {"cm": "1e-2", "mm": "1e-3", "um": "1e-6"},
    "kg": {"g": "1e-3"},
    "N m": {"Nm": "1", "mN m": "1e-3", "mNm": "1e-3", "kN m": "1e3"},
    "N": {"kN": "1e3", "mN": "1e-3"},
    "1": {"%": "1e-2"},
    "% of tau_max": {"%": "1"},
}
"""Unit of a key -> other units of its dimension, and how many of the key's unit each is."""
TURNS = {"rad": "deg", "rad/s": "deg/s"}
"""Unit of a key -> the same in degrees, which no decimal number is a multiple of."""
_QUANTITY = re.compile(rf"({NUMBER.pattern}) *(\S.*)")


def units_of(unit: str) -> tuple[str, ...]:
    """Return the units that a number may have at a key with some unit, that one first."""
    own = () if unit in ("", "1") else (unit,)
    turns = (TURNS[unit],) if unit in TURNS else ()
    return (*own, *MULTIPLES.get(unit, ()), *turns)


def without_unit(raw: Any, unit: str) -> Any:
    """Return a value, or a list of values, with the numbers that have a unit as numbers in the key's unit.

    ``1 ms`` is 0.001, the same number as if it had been written so; degrees are multiplied by pi/180. What is no
    number with a unit of the right dimension stays as it is.

    Args:
        raw: The value, as it was read.
        unit: The key's unit.
    """
    if isinstance(raw, list):
        return [without_unit(item, unit) for item in raw] if any(isinstance(item, str | list) for item in raw) else raw
    found = _QUANTITY.fullmatch(raw) if isinstance(raw, str) and len(raw) <= 64 else None
    if found is None or found[2] not in units_of(unit):
        return raw
    if found[2] == TURNS.get(unit):
        return math.radians(float(found[1]))
    number = Decimal(found[1]) * Decimal(MULTIPLES.get(unit, {}).get(found[2], "1"))
    return float(number)
