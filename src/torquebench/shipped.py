"""Configs that come with the package: where they are, what they are called, and the keys that a config may have."""

from __future__ import annotations

import functools
import json
import os
import re
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from torquebench.errors import ConfigError, Problem, nearest, nearest_path

YAML = r"\.ya?ml"
"""What a config's name ends in, a regular expression."""


def data_root() -> Path:
    """Return the folder that holds ``models/`` and ``configs/``.

    The checkout wins over the copy inside an installed wheel: an editable install leaves a stale copy behind.
    The environment variable ``TORQUEBENCH_DATA`` wins over both.
    """
    chosen = os.environ.get("TORQUEBENCH_DATA")
    return Path(chosen) if chosen else _own_data()


def how_to_install(extra: str) -> str:
    """Return the command that installs an extra: the script of the checkout whose ``.venv`` runs this, else pip."""
    in_checkout = Path(sys.prefix) == _own_data() / ".venv" and (_own_data() / "scripts" / "extras").is_file()
    return f"scripts/extras {extra}" if in_checkout else f"pip install 'torquebench[{extra}]'"


@functools.cache
def _own_data() -> Path:
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file() and (checkout / "models").is_dir():
        return checkout
    return Path(__file__).resolve().parent / "_data"


def from_checkout(folder: str) -> ModuleType:
    """Return a package of the checkout that no wheel has, such as ``benchmarks`` or ``tests/trust``.

    Raises:
        ConfigError: there is none, as where torquebench was installed from a wheel.
    """
    place = data_root() / folder
    if not (place / "__init__.py").is_file():
        why = f"no folder {place}: it comes with the repository and the sdist, not with a wheel; run it in a checkout"
        raise ConfigError([Problem(place.name, "", why)])
    if str(place.parent) not in sys.path:
        sys.path.insert(0, str(place.parent))
    return import_module(place.name)


def model_names() -> tuple[str, ...]:
    """Names of the models that can be used in a config, sorted."""
    folder = data_root() / "models"
    return tuple(sorted(p.name for p in folder.iterdir() if (p / f"{p.name}.xml").is_file())) if folder.is_dir() else ()


def configs() -> dict[str, Path]:
    """Return the shipped configs by name: ``fig9-chattering``, or ``studies/robustness`` where two share a name."""
    root = data_root() / "configs"
    files = sorted(root.rglob("*.yaml"))
    stems = [file.stem for file in files]
    found = {}
    for file in files:
        unique = stems.count(file.stem) == 1
        found[file.stem if unique else file.relative_to(root).with_suffix("").as_posix()] = file
    return dict(sorted(found.items()))


def find_config(text: str, others: Iterable[str] = ()) -> Path:
    """Return the file that a user means: one that exists, else the shipped config of this name.

    A shipped config is called ``fig9-chattering``, ``paper/fig9-chattering`` or ``configs/paper/fig9-chattering.yaml``.

    Args:
        text: What the user wrote.
        others: Other names that may be meant.

    Raises:
        ConfigError: there is neither.
    """
    path = Path(text)
    try:
        if path.exists():
            return path
    except (OSError, ValueError):
        return path  # whoever opens it says what is wrong with the name
    if found := shipped_config(text):
        return found
    known = configs()
    begun = [name for name in known if text and name.startswith(text)]
    near = "" if begun else nearest_path(path, YAML) or nearest(text, [*others, *known]) or ""
    wanted = f"one of: {', '.join(begun)}" if begun else ""
    shown = text if text.isprintable() else ascii(text)
    raise ConfigError([Problem(shown, text="does not exist", wanted=wanted, nearest=near)])


def shipped_names() -> list[str]:
    """Names of the shipped configs: with and without their folders."""
    root, known = data_root() / "configs", configs()
    return list(
        dict.fromkeys([*known, *(file.relative_to(root).with_suffix("").as_posix() for file in known.values())])
    )


def shipped_config(text: str) -> Path | None:
    """Return the shipped config of a name, one of the forms that `find_config` tells, or None."""
    root, known = data_root() / "configs", configs()
    if text in known:
        return known[text]
    inside = root / (text.removeprefix("configs/") if text.startswith("configs/") else f"{text}.yaml")
    return inside if inside in known.values() else None


def first_line(config: Path) -> str:
    """Return a shipped config's description, or the name that it has instead."""
    text = config.read_text(encoding="utf-8")
    found = re.search(r"^description: *(.+)$", text, flags=re.MULTILINE) or re.search(r"^# *(.+)$", text, re.MULTILINE)
    return found[1].strip("'\"") if found else config.stem


def config_keys() -> tuple[str, ...]:
    """Return the dotted keys of every section of a config that is not a list: ``run.duration``, ``plant.payload``."""
    schema = json.loads((data_root() / "configs" / "schema.json").read_text(encoding="utf-8"))
    found: list[str] = []
    for section, rule in schema["$defs"]["Experiment"]["properties"].items():
        keys = dict.fromkeys(key for part in _alternatives(schema, rule) for key in part.get("properties", ()))
        found += [f"{section}.{key}" for key in keys] or [section]
    return tuple(found)


def _alternatives(schema: dict[str, Any], rule: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the schemas that a value may follow, references and alternatives resolved."""
    if "$ref" in rule:
        return _alternatives(schema, schema["$defs"][rule["$ref"].rpartition("/")[2]])
    inner = [part for word in ("anyOf", "oneOf", "allOf") for part in rule.get(word, ())]
    return [found for part in inner for found in _alternatives(schema, part)] or [rule]
