"""Experiments made from others and from Python's values: changed keys, mappings, arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torquebench.errors import ConfigError, Problem
from torquebench.experiment.config import parse_experiment
from torquebench.experiment.dump import dump_experiment
from torquebench.experiment.schema import Experiment


def with_changes(experiment: Experiment, changes: Mapping[str, Any]) -> Experiment:
    """Return an experiment with some keys changed.

    Args:
        experiment: The experiment.
        changes: Dotted key, as for ``--set``, -> value: ``{"run.duration": 2, "controllers.band.gains.phi": 0.1}``.

    Raises:
        ConfigError: a key does not exist, or a value does not go with the rest.
    """
    return parse_experiment(dump_experiment(experiment), experiment.name, edits_of(changes))


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
