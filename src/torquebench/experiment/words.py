"""Puts values and mistakes into words: what a user wrote, what was wanted, and what may help."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from torquebench.errors import nearest
from torquebench.experiment.units import units_of
from torquebench.experiment.yaml_tree import shortened
from torquebench.keys import Key

SLUG_IN_WORDS = "1 to 64 of a-z, 0-9 and -, a letter or digit at both ends"


def shown(value: object) -> str:
    """Return what the user wrote, in words that fit on one line."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text {shortened(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"{value}"
    if isinstance(value, int | float):
        return f"{value!r}"
    if isinstance(value, list):
        return f"a list of {len(value)}" if value else "an empty list"
    if isinstance(value, Mapping):
        return "a mapping" if value else "an empty mapping"
    return "something else"


_NUMBER_HINTS = (
    (r"[-+]?0[0-9]+(\.[0-9]*)?", "a number has no leading zeros"),
    (r"[-+]?[0-9.]+([eE][-+]?[0-9]+)?", "a number in quotes is text: remove the quotes"),
    (r"[0-9]+(:[0-9]+)+", "write one number, 90 rather than 1:30"),
    (r"[-+]?[0-9]+(_[0-9]+)+(\.[0-9]*)?", "write the digits without _"),
    (r"[-+]?[0-9]+,[0-9]+", "the decimal sign is a point"),
    (r"0[xob][0-9a-fA-F]+", "write it in decimal"),
    (r"(?i)[-+]?\.?(nan|inf|infinity)", "it must be finite"),
    (r"[-+]?[0-9.]+ *[-+*/^].*", "write the result; there are no formulas"),
)


def number_hint(value: object, unit: str) -> str:
    """Return what may help who wrote a text in place of a number; nothing where that is not known.

    Args:
        value: What was written.
        unit: The key's unit.
    """
    text = value[:64] if isinstance(value, str) else ""
    if re.fullmatch(r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)? *(?:%|[a-zA-Zµ][a-zA-Z/^*2 ]*)", text):
        units = units_of(unit)
        return f"a number here may have one of the units {', '.join(units)}" if units else "write the number alone"
    return next((hint for pattern, hint in _NUMBER_HINTS if re.fullmatch(pattern, text)), "")


def unit(key: Key) -> str:
    """Return a key's unit in brackets, such as `` [s]``; nothing for pure numbers."""
    return f" [{key.unit}]" if key.unit not in ("", "1") else ""


def a_value(key: Key) -> str:
    """Return what is wanted of who gives none."""
    return f"a value ({key.text.rstrip('.')})"


def is_number(value: object) -> bool:
    """Whether a value is a number; true and false count as numbers."""
    return isinstance(value, int | float)


def choice(value: Any, words: tuple[str | bool, ...]) -> dict[str, str]:
    """Return what was wanted instead of a value that is none of a key's words, as parts of a `Problem`."""
    names = [str(word).lower() if isinstance(word, bool) else word for word in words]
    text, note = str(value).lower() if isinstance(value, bool) else value, ""
    if "true" in names and str(value).lower() in ("yes", "no", "on", "off"):
        note = "yes, no, on and off are text"
    elif "true" in names and isinstance(value, str) and value.lower() in ("true", "false"):
        note = "true and false are written in small letters and without quotes"
    near = nearest(text, names) if isinstance(text, str) and not note else None
    return {"wanted": f"one of {', '.join(names)}", "nearest": near or "", "note": note}
