"""Torque limits in a small YAML file: a list of numbers in the joints' order, or a mapping from names to numbers."""

from __future__ import annotations

from pathlib import Path

import yaml

from torquebench.errors import ModelError
from torquebench.robot.links import read_yaml


def read_limits(path: Path) -> dict[str, float] | tuple[float, ...]:
    """Return the torque limits of a file [N m; N for slides].

    Raises:
        ModelError: it cannot be read, or is neither a list of numbers nor a mapping to numbers.
    """
    try:
        tree = read_yaml(path)
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        raise ModelError(f"{path}: cannot be read ({' '.join(str(error).split())})") from error
    numbers = tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else [None]
    if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers):
        raise ModelError(f"{path}: wanted a list of numbers, or lines such as 'elbow: 87'")
    if isinstance(tree, dict):
        return {str(name): float(x) for name, x in tree.items()}
    return tuple(float(x) for x in tree)
