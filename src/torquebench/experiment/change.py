"""Python's values as a config takes them: changed keys, mappings, arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torquebench.errors import ConfigError, Problem


def edits_of(changes: Mapping[str, Any]) -> list[str]:
    """Return changed keys as edits ``key=value``, the value as YAML.

    Raises:
        ConfigError: a value is nothing that YAML can hold.
    """
    edits = []
    for key, value in changes.items():
        try:
            edits.append(f"{key}={json.dumps(value, default=_plain, allow_nan=False)}")
        except (TypeError, ValueError) as error:
            raise ConfigError([Problem("changes", str(key), f"got {value!r}, wanted a value for a config")]) from error
    return edits


def _plain(value: Any) -> Any:
    """Return what JSON can hold for an array or a number of numpy, or a path."""
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no value of a config")


def tree_of(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return keys of a config, which may hold arrays and paths, as plain values.

    Raises:
        ConfigError: a value is nothing that YAML can hold.
    """
    try:
        tree: dict[str, Any] = json.loads(json.dumps(keys, default=_plain, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigError([Problem("experiment", "", f"cannot be written as YAML ({error})")]) from error
    return tree
