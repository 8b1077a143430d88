"""Experiments that differ from a document in some keys: set and checked again, or numbers put in their place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from typing import Any

from pydantic import BaseModel

from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.overrides import assign, split_key
from torquebench.experiment.schema import ControllerKeys, Experiment
from torquebench.experiment.sweep_keys import EVERY
from torquebench.experiment.sweep_values import Value
from torquebench.laws.law import find_law, law_names


def varied(document: Document, values: Sequence[tuple[str, Value]]) -> tuple[Document, dict[str, list[KeyPath]]]:
    """Return a copy of a document with keys set, and where each of them is; mistakes are recorded in the copy.

    Args:
        document: The base, which is left as it is.
        values: Keys, which may be ``controllers.*.``, and what each is set to; in order.
    """
    copy, places = document.twin(), dict[str, list[KeyPath]]()
    for key, value in values:
        targets = expanded(copy, key)
        if not targets:
            copy.add(("sweep",), f"{key}: no controller's law has it", place=value.place)
        places[key] = [_indexed(copy.root, parts) for parts in targets]  # before a name is set, by which one is found
        for parts in targets:
            assign(copy, parts, deepcopy(value.raw), value.place, value.place)
    return copy, places


def overwritten(
    document: Document, values: Iterable[tuple[str, Value]], places: Mapping[str, Sequence[KeyPath]]
) -> list[tuple[str, str]]:
    """Return the keys whose value is not what it was set to, each with another key that sets it, or a part of it, too.

    Args:
        document: The copy in which they have been set.
        values: As of `varied`.
        places: Where they are.
    """
    found = []
    for key, value in values:
        if not all(_stands(_at(document.root, path), value.raw) for path in places[key]):
            others = (other for other in places if other != key and _meet(places[key], places[other]))
            found.append((key, next(others, "another key")))
    return found


def _meet(paths: Sequence[KeyPath], others: Sequence[KeyPath]) -> bool:
    return any(path[: len(other)] == other[: len(path)] for path in paths for other in others)


def _stands(node: Any, raw: Any) -> bool:
    """Whether what was set is still there; more may have been added to it."""
    if isinstance(raw, dict):
        return isinstance(node, dict) and all(key in node and _stands(node[key], raw[key]) for key in raw)
    if isinstance(raw, list):
        return isinstance(node, list) and len(node) == len(raw) and all(map(_stands, node, raw))
    return bool(node is raw or node == raw)


def _at(node: Any, path: KeyPath) -> Any:
    for part in path:
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            return BROKEN
    return node


def expanded(document: Document, key: str) -> list[list[str | int]]:
    """Return the keys that a key stands for: one, or one for each controller whose law has the gain or option."""
    if not key.startswith(EVERY):
        return [split_key(key) or []]
    rest = split_key(key.removeprefix(EVERY)) or []
    raw = document.root.get("controllers")
    items = list(enumerate(raw)) if isinstance(raw, list) else []
    return [["controllers", i, *rest] for i, item in items if isinstance(item, dict) and _has(item, rest)]


def _has(controller: Mapping[str, Any], rest: list[str | int]) -> bool:
    name = controller.get("law")
    if not isinstance(name, str) or name not in law_names():
        return False
    law, key = find_law(name), rest[0]
    if key == "gains" and len(rest) > 1:
        chosen = {option: controller.get(option, declared.values[0]) for option, declared in law.options.items()}
        return rest[1] in law.gains and law.gains[str(rest[1])].acts(chosen)
    return key in law.options or (key == "fuzzy" and bool(law.rules)) or key in ControllerKeys.model_fields


def _indexed(node: Any, parts: Iterable[str | int]) -> KeyPath:
    """Return a key with the indices of list items in place of their names."""
    path: KeyPath = ()
    for part in parts:
        if isinstance(node, list) and isinstance(part, str):
            named = (i for i, item in enumerate(node) if isinstance(item, dict) and item.get("name") == part)
            part = next(named, part)
        path, node = (*path, part), _at(node, (part,))
    return path


def with_number(experiment: Experiment, path: KeyPath, value: float) -> Experiment:
    """Return an experiment with one number in place of another, unchecked.

    Args:
        experiment: What is changed.
        path: Where a number, or a vector, is now.
        value: The number.
    """
    changed: Experiment = _replaced(experiment, path, value)
    return changed


def with_draw(experiment: Experiment, draw: int) -> Experiment:
    """Return an experiment with another ``run.draw``."""
    return experiment.model_copy(update={"run": experiment.run.model_copy(update={"draw": draw})})


def _replaced(node: Any, path: KeyPath, value: float) -> Any:
    if not path:
        return value
    key: Any = path[0]
    if isinstance(node, BaseModel):
        return node.model_copy(update={key: _replaced(getattr(node, key), path[1:], value)})
    if isinstance(node, tuple):
        return (*node[:key], _replaced(node[key], path[1:], value), *node[key + 1 :])
    return {**node, key: _replaced(node[key], path[1:], value)}
