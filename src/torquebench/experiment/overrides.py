"""``--set key=value``: edits to a config's raw values before they are checked."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from torquebench.errors import did_you_mean
from torquebench.experiment.document import BROKEN, Document, KeyPath, Place, dotted, shortened
from torquebench.experiment.yaml_tree import parse_value

MAX_CHARACTERS = 65_536
_PART = re.compile(r"([A-Za-z0-9_-]{1,64})((?:\[[0-9]{1,6}\])*)")
_FORM = "wanted KEY=VALUE, such as run.duration=2 or controllers[0].gains.k=0.5"


def apply_overrides(document: Document, overrides: Sequence[str]) -> None:
    """Apply each override in order, the last one winning; mistakes are recorded in the document.

    A list of named things also takes names: ``controllers.conventional.gains.k=0.5``.

    Args:
        document: What is edited; its root is a mapping.
        overrides: Texts ``key=value``; values follow the same rules as in the file.
    """
    for text in overrides:
        shown = text if text.isprintable() else ascii(text)
        document.overrides.append(shown if len(shown) <= 120 else shown[:120] + "...")
        _apply(document, text, Place(len(document.overrides)))


def _apply(document: Document, text: str, place: Place) -> None:
    key, equals, value_text = text.partition("=")
    parts = split_key(key.strip())
    if not equals or not parts:
        document.add((), _FORM, place=place)
        return
    if len(text) > MAX_CHARACTERS:
        document.add((), f"is {len(text)} characters long, at most {MAX_CHARACTERS} are read", place=place)
        return
    value = parse_value(document, value_text, tuple(parts), place)
    if value is not BROKEN:
        assign(document, parts, value, place, place)


def assign(document: Document, parts: Sequence[str | int], value: Any, key_place: Place, value_place: Place) -> None:
    """Set the value that a key addresses, making the mappings on the way that are not there; mistakes are recorded.

    Args:
        document: What is edited; its root is a mapping.
        parts: The key; see `split_key`.
        value: What to set.
        key_place, value_place: Where key and value were written.
    """
    node: Any = document.root
    path: KeyPath = ()
    for depth, part in enumerate(parts):
        if node is BROKEN:
            return
        index = _index(node, part)
        if index is None:
            document.add((*path, part), f"cannot be set: {_refusal(node, path, part)}", place=key_place)
            return
        path = (*path, index)
        last = depth == len(parts) - 1
        if last or (isinstance(node, dict) and node.get(part) is None):
            document.forget(path)
            document.mark(path, key_place, value_place)
            node[index] = value if last else {}
        node = node[index]


def split_key(key: str) -> list[str | int] | None:
    """Return the names and indices of a dotted key, or None when it is none."""
    parts: list[str | int] = []
    for text in key.split("."):
        match = _PART.fullmatch(text)
        if not match:
            return None
        parts.append(match.group(1))
        parts += [int(number) for number in re.findall(r"[0-9]+", match.group(2))]
    return parts


def _index(node: Any, part: str | int) -> str | int | None:
    """Return the key or index of the child of `node` that `part` addresses, or None."""
    if isinstance(node, dict):
        return part if isinstance(part, str) else None
    if not isinstance(node, list):
        return None
    if isinstance(part, int):
        return part if part < len(node) else None
    named = (i for i, item in enumerate(node) if isinstance(item, dict) and item.get("name") == part)
    return next(named, None)


def _refusal(node: Any, path: KeyPath, part: str | int) -> str:
    parent = dotted(path)
    if not isinstance(node, list):
        return f"{parent} is not a {'mapping' if isinstance(part, str) else 'list'}"
    has = f"{parent} has {len(node)} item{'s' * (len(node) != 1)}, counted from 0"
    if isinstance(part, int):
        return has
    names = [str(item["name"]) for item in node if isinstance(item, dict) and "name" in item]
    if node and (part.isdecimal() or not names):
        index = int(part) if part.isdecimal() and int(part) < len(node) else 0
        return f"{has}: write {parent}[{index}]{' for the first' * (index == 0)}"
    return f"nothing in {parent} is named {shortened(part)}{did_you_mean(part, names)}"
