"""Conditions: keys that a study sets over its config, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from torquebench.experiment.presets import write_presets
from torquebench.experiment.source import Document, assign, split_key
from torquebench.experiment.sweep_section import MAX_KEYS, NOT_VARIED
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import KeyPath, copied


def check_keys(document: Document, path: KeyPath, keys: Any, also: Iterable[str] = ()) -> None:
    """Record what keeps the keys of a condition from being set.

    Args:
        document: The config, which receives the mistakes.
        path: Where they stand.
        keys: Keys, as for ``--set``, and their values.
        also: Sections that they cannot be of, besides those that decide nothing.
    """
    if not isinstance(keys, dict):
        document.add(path, got=shown(keys), wanted="keys and their values, {} for none")
        return
    if len(keys) > MAX_KEYS:
        document.add(path, got=f"{len(keys)} keys", wanted=f"at most {MAX_KEYS}")
    for key in keys:
        if key.partition(".")[0] in (*NOT_VARIED, "controllers", *also):
            document.add((*path, key), "cannot be varied", at="key", wanted="a key that decides what is run")


def set_keys(document: Document, keys: Mapping[str, Any], file: Document, path: KeyPath) -> None:
    """Set the keys of a condition in a config; mistakes are recorded there.

    Args:
        document: The config.
        keys: Keys, as for ``--set``, and their values.
        file: Where they are written.
        path: Their place in it.
    """
    for key, value in keys.items():
        place = file.place((*path, key))
        assign(document, split_key(key) or [], copied(value), place, place)
    write_presets(document.root, document.add)
