"""The JSON document that every command prints with ``--json``."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from torquebench.cli.terminal import Voice
from torquebench.errors import Problem


def document(command: str | None, status: int, problems: Iterable[Problem], error: str | None, voice: Voice) -> str:
    """Return one JSON document: the envelope that all commands share, then what this one has told.

    Args:
        command: Its name; None where none was understood.
        status: The exit status.
        problems: What was wrong with the input.
        error: Why the command ended early, other than by bad input.
        voice: What was told and warned of.
    """
    envelope = {
        "command": command, "status": status, "problems": [problem.to_json() for problem in problems], "error": error,
        "remarks": voice.remarks,
    }  # fmt: skip
    return json.dumps(plain(envelope | voice.facts), indent=2, allow_nan=False)


def plain(value: Any) -> Any:
    """Return `value` as what JSON can hold: NaN and infinities become None, paths text, tuples lists."""
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if hasattr(value, "tolist"):  # an array, which needs no numpy to be told by this
        return plain(value.tolist())
    return [plain(inner) for inner in value]
