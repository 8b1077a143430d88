"""How values and mistakes are put into words: what a user wrote, what was wanted, and what may help."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from torquebench.errors import nearest
from torquebench.experiment.groups import Spec
from torquebench.experiment.yaml_tree import shortened

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
    return "a mapping" if isinstance(value, Mapping) else "something else"


_NUMBER_HINTS = (
    (r"[-+]?0[0-9]+(\.[0-9]*)?", "a number has no leading zeros"),
    (r"[-+]?[0-9.]+([eE][-+]?[0-9]+)?", "a number in quotes is text: remove the quotes"),
    (r"[0-9]+(:[0-9]+)+", "write one number, 90 rather than 1:30"),
    (r"[-+]?[0-9]+(_[0-9]+)+(\.[0-9]*)?", "write the digits without _"),
    (r"[-+]?[0-9]+,[0-9]+", "the decimal sign is a point"),
    (r"0[xob][0-9a-fA-F]+", "write it in decimal"),
    (r"[-+]?[0-9.]+ *%", "write a fraction, 0.3 rather than 30%"),
    (r"[-+]?[0-9.]+ *[a-zA-Z/^*2]+", "write the number alone; its unit is fixed"),
    (r"(?i)[-+]?\.?(nan|inf|infinity)", "it must be finite"),
    (r"[-+]?[0-9.]+ *[-+*/^].*", "write the result; there are no formulas"),
)


def _number_hint(value: object) -> str:
    if not isinstance(value, str):
        return ""
    hint = next((hint for pattern, hint in _NUMBER_HINTS if re.fullmatch(pattern, value[:64])), "")
    return hint


def unit(spec: Spec) -> str:
    """Return a key's unit in brackets, such as `` [s]``; nothing for pure numbers."""
    return f" [{spec.key.unit}]" if spec.key.unit not in ("", "1") else ""


def explain(error: Mapping[str, Any], spec: Spec, inner: bool) -> dict[str, str]:
    """Return one of pydantic's errors about a plain value as the parts of a `Problem`.

    Args:
        error: The error.
        spec: The key.
        inner: Whether it is about an item of the key's value, not about the whole of it.
    """
    kind, value, limits = error["type"], error["input"], error.get("ctx", {})
    got = shown(value)
    if kind == "literal_error":
        return {"got": got, **_choice(value, spec)}
    if spec.key.wanted and kind in ("too_short", "too_long", "tuple_type", "dict_type", "list_type"):
        named = kind == "dict_type" and not spec.key.wanted.startswith("a mapping")
        return {"got": got, "wanted": "a mapping of names to " * named + spec.key.wanted}
    if spec.key.wanted and kind == "float_type" and len(error["loc"]) and error["loc"][-1] == "number":
        return {"got": got, "wanted": spec.key.wanted}
    number, hint = f"a number{unit(spec)}", _number_hint(value)
    if spec.vector and not inner:
        number += ", or a list with one for each joint"
    if spec.vector and spec.choices:
        number = number if inner else f"{spec.choices[0]}, {number}"
    wanted, note = {
        "float_type": (number, hint),
        "int_type": ("a whole number", hint),
        "int_from_float": ("a whole number", ""),
        "finite_number": (f"a finite number{unit(spec)}", ""),
        "greater_than": (f"more than {_limit(limits.get('gt'))}{unit(spec)}", ""),
        "greater_than_equal": (f"at least {_limit(limits.get('ge'))}{unit(spec)}", ""),
        "less_than": (f"less than {_limit(limits.get('lt'))}{unit(spec)}", ""),
        "less_than_equal": (f"at most {_limit(limits.get('le'))}{unit(spec)}", ""),
        "multiple_of": ("an even number", ""),
        "string_type": ("a name" if inner else "text", "put it in quotes" if _is_number(value) and not inner else ""),
        "string_pattern_mismatch": (f"a slug: {SLUG_IN_WORDS}", ""),
        "string_too_long": (f"at most {limits.get('max_length')} characters", ""),
        "bool_type": ("true or false", "yes, no, on and off are text" if isinstance(value, str) else ""),
        "too_short": ("at least one number", ""),
    }.get(kind, (str(error["msg"]), ""))
    if kind == "less_than" and limits.get("lt") == 1:
        percent = value if _is_number(value) and value < 100 else 30
        note = f"it is a fraction: {percent / 100:g} for {percent:g} %"
    return {"got": got, "wanted": wanted, "note": note}


def _limit(x: Any) -> str:
    return f"{x:.17g}" if isinstance(x, float) else f"{x}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _choice(value: Any, spec: Spec) -> dict[str, str]:
    """Return what was wanted instead of a value that is none of a key's words."""
    names = [str(word).lower() if isinstance(word, bool) else word for word in spec.choices]
    text = str(value).lower() if isinstance(value, bool) else value
    wanted = f"one of {', '.join(names)}"
    if spec.vector:
        wanted = f"{names[0]}, a number{unit(spec)}, or a list with one for each joint"
    if "true" in names and str(value).lower() in ("yes", "no", "on", "off"):
        return {"wanted": wanted, "note": "yes, no, on and off are text"}
    if "true" in names and isinstance(value, str) and value.lower() in ("true", "false"):
        return {"wanted": wanted, "note": "true and false are written in small letters and without quotes"}
    near = nearest(text, names) if isinstance(text, str) else None
    return {
        "wanted": wanted,
        "nearest": near or "",
        "note": _number_hint(value) if spec.vector and near is None else "",
    }
