"""The kinds of value a config holds, and how a refused one is put into words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, GetCoreSchemaHandler, Tag
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError

from torquebench.errors import did_you_mean
from torquebench.experiment.document import shortened
from torquebench.kernel import Array

LEAST_SIDE, LARGEST_SIDE = 160, 3840
"""Sides of a film's frame [px]; its format takes even ones only."""
Vector: TypeAlias = float | tuple[float, ...]
"""One number for all joints, or one for each."""


def positive_zero(x: float) -> float:
    """Return x, with 0.0 for -0.0: equal experiments must not differ in their text."""
    return x + 0.0


@dataclass(frozen=True)
class EachJoint:
    """Annotation of a vector key: finite numbers within bounds, and optionally one accepted word."""

    gt: float | None = None
    ge: float | None = None
    word: str | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema for a number, or a list of them, in strict mode."""
        limits = Field(strict=True, allow_inf_nan=False, gt=self.gt, ge=self.ge)
        number = Annotated[float, limits, AfterValidator(positive_zero)]
        numbers = Annotated[tuple[number, ...], Field(strict=False, min_length=1)]
        kinds: Any = Annotated[number, Tag("number")] | Annotated[numbers, Tag("list")]
        if self.word is not None:
            kinds = kinds | Annotated[Literal[self.word], Tag("word")]
        return handler.generate_schema(Annotated[kinds, Discriminator(self._shape)])

    def _shape(self, value: object) -> str:
        if isinstance(value, list | tuple):
            return "list"
        return "word" if isinstance(value, str) and self.word is not None else "number"


Slug: TypeAlias = Annotated[str, Field(pattern=r"^[a-z0-9]([a-z0-9-]{0,62}[a-z0-9])?$")]
Positive: TypeAlias = Annotated[float, Field(gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0), AfterValidator(positive_zero)]
AnyVector: TypeAlias = Annotated[Vector, EachJoint()]
NotNegativeVector: TypeAlias = Annotated[Vector, EachJoint(ge=0)]
PositiveVector: TypeAlias = Annotated[Vector, EachJoint(gt=0)]


def _three(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) != 3:
        raise PydanticCustomError("three_numbers", "wanted a list of 3 numbers")
    return value


_Coordinate: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False), AfterValidator(positive_zero)]
Triple: TypeAlias = Annotated[
    tuple[_Coordinate, ...], Field(strict=False, min_length=3, max_length=3), BeforeValidator(_three)
]
"""Three numbers, the coordinates of a point."""


def _two(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise PydanticCustomError("frame_size", "wanted width and height, as [640, 480]")
    return value


_Side: TypeAlias = Annotated[int, Field(strict=True, ge=LEAST_SIDE, le=LARGEST_SIDE, multiple_of=2)]
FrameSize: TypeAlias = Annotated[tuple[_Side, _Side], Field(strict=False), BeforeValidator(_two)]
HomeOrVector: TypeAlias = Annotated[Vector | Literal["home"], EachJoint(word="home")]


def as_vector(value: Vector, n: int) -> Array:
    """Return a config's vector with one entry for each joint.

    Args:
        value: One number for all joints, or `n` numbers.
        n: Number of joints.

    Returns:
        Array (n,), in the unit of `value`.
    """
    vector = np.empty(n)
    vector[:] = value
    return vector


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
    return f"; {hint}" if hint else ""


def choices(info: FieldInfo) -> list[str]:
    """Return the values that an enumerated key accepts, as the user writes them."""
    values = get_args(info.annotation) if get_origin(info.annotation) is Literal else ()
    return [str(v).lower() if isinstance(v, bool) else str(v) for v in values]


def unit(info: FieldInfo) -> str:
    """Return the unit that a key's description ends with, such as ``[s]``; nothing for pure numbers."""
    found = re.findall(r"\[[^\]]+\]", info.description or "")
    return f" {found[-1]}" if found and found[-1] != "[1]" else ""


def explain(error: ErrorDetails, info: FieldInfo) -> str:
    """Return one of pydantic's errors as ``got ..., wanted ...``."""
    kind, value, limits = error["type"], error["input"], error.get("ctx", {})
    each = ", or a list with one for each joint" if set(error["loc"]) & {"number", "word"} else ""
    number = f"a number{unit(info)}{each}{_number_hint(value)}"
    if kind == "literal_error":
        names = choices(info) or ["home"]
        text = str(value).lower() if isinstance(value, bool) else value
        wanted = f"one of {', '.join(names)}" if choices(info) else f"home, {number}"
        near = did_you_mean(text, names) if isinstance(text, str) else ""
        hint = near if "did you mean" in near else ""
        if "true" in names and str(value).lower() in ("yes", "no", "on", "off"):
            hint = "; yes, no, on and off are text"
        elif "true" in names and isinstance(value, str) and value.lower() in ("true", "false"):
            hint = "; true and false are written in small letters and without quotes"
        return f"got {shown(value)}, wanted {wanted}{hint}"
    phrases = {
        "float_type": number,
        "int_type": f"a whole number{_number_hint(value)}",
        "int_from_float": "a whole number",
        "finite_number": f"a finite number{unit(info)}",
        "greater_than": f"more than {limits.get('gt', 0):.17g}{unit(info)}",
        "greater_than_equal": f"at least {limits.get('ge')}{unit(info)}",
        "less_than": f"less than {limits.get('lt', 0):.17g}{unit(info)}",
        "multiple_of": "an even number",
        "less_than_equal": f"at most {limits.get('le')}{unit(info)}",
        "string_type": "text" + ("; put it in quotes" if isinstance(value, int | float) else ""),
        "string_pattern_mismatch": "a slug: 1 to 64 of a-z, 0-9 and -, a letter or digit at both ends",
        "string_too_long": f"at most {limits.get('max_length')} characters",
        "bool_type": "true or false" + ("; yes, no, on and off are text" if isinstance(value, str) else ""),
        "too_short": "at least one number",
        "tuple_type": "a list of 3 numbers",
    }
    if kind == "less_than" and limits.get("lt") == 1:
        percent = value if isinstance(value, int | float) and value < 100 else 30
        phrases[kind] += f"; it is a fraction: {percent / 100:g} for {percent:g} %"
    said = f"wanted {phrases[kind]}" if kind in phrases else error["msg"]
    return f"got {shown(value)}, {said}"
