"""A config that extends another: mappings merge, lists replace, and a controller goes by its name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

from torquebench.errors import nearest
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, Map, Place, Seq, copied, shortened

EXTENDS = "extends"
OWN = (EXTENDS, "name", "description")
"""Keys of the top level that say something of their own file alone."""
FROM = "from"
"""Key that names a preset whose keys are taken over."""
AUTO = "auto"
"""In place of the name of a set of gains: those that are not given are chosen for the arm."""
PRESET = ("reference", "gains")
"""Keys whose value may be the name of a preset, or a mapping with `FROM` and other keys."""
TAGS = ("engine", "kind", "law")
"""Keys that decide which other keys there are: where they differ, a mapping replaces the other one."""
MAX_PARENTS = 8


class Text(NamedTuple):
    """The text of a config, and where it is from."""

    filename: str
    content: bytes


class Report(Protocol):
    """Records a mistake at a key; `parts` are those of a `Problem`."""

    def __call__(self, path: KeyPath, text: str = "", *, place: Place, **parts: Any) -> None:
        """Take the offending key, what is wrong, and where."""


def merged(own: Map, parent: Map) -> Map:
    """Return the keys of two mappings; where both have one, the own value counts.

    Values that are mappings themselves merge, unless a key of `TAGS` differs; ``null`` takes a parent's key away.
    """
    found = Map()
    found.is_whole = own.is_whole and parent.is_whole
    for key, value in parent.items():
        if key not in own:
            found.put(key, copied(value), *parent.places[key])
        elif own[key] is None:
            found.places[key] = own.places[key]  # where it was taken away
        else:
            if key in PRESET and isinstance(value, str):
                value = preset_of(value, parent.places[key][1])
            found.put(key, joined(own[key], value), *own.places[key])
    for key, value in own.items():
        if key not in parent:
            found.put(key, value, *own.places[key])
    return found


def preset_of(name: str, place: Place) -> Map:
    """Return the name of a preset as a mapping."""
    found = Map()
    found.put(FROM, name, place, place)
    return found


def without(mapping: Map, *keys: str) -> Map:
    """Return a mapping without some keys."""
    found = Map()
    found.is_whole = mapping.is_whole
    for key, value in mapping.items():
        if key not in keys:
            found.put(key, value, *mapping.places[key])
    return found


def joined(own: Any, parent: Any) -> Any:
    """Return two values as one: mappings merge unless a key of `TAGS` differs, else the own one counts."""
    if not (isinstance(own, Map) and isinstance(parent, Map)):
        return own
    differ = any(tag in own and tag in parent and own[tag] != parent[tag] for tag in TAGS)
    return own if differ else merged(own, parent)


def extended(own: Map, parent: Map, report: Report) -> Map:
    """Return a whole config that extends another; mistakes are reported."""
    items = own.get("controllers")
    if isinstance(items, Seq):
        known = parent.get("controllers")
        own["controllers"] = with_names(items, known if isinstance(known, Seq) else (), report)
    return merged(without(own, EXTENDS), without(parent, *OWN))


def with_names(items: Seq, known: Iterable[Any], report: Report) -> Seq:
    """Return a list of controllers with those that are given by name, or that extend one, written out.

    Args:
        items: Controllers: mappings, of which ``extends`` names one that is known or stands before it; or names.
        known: Controllers of the config that is extended.
        report: Receives mistakes.
    """
    there = {item["name"]: item for item in known if isinstance(item, Map) and isinstance(item.get("name"), str)}
    found = Seq()
    for i, (item, place) in enumerate(zip(items, items.places, strict=True)):
        path: KeyPath = ("controllers", i)
        if isinstance(item, Map) and EXTENDS in item:
            name, path, where = item[EXTENDS], (*path, EXTENDS), item.places[EXTENDS][1]
            own: Any = without(item, EXTENDS)
        elif isinstance(item, str):
            name, where, own = item, place, Map()
        else:
            name, where, own = None, place, item
        if name is not None and (not isinstance(name, str) or name not in there):
            near = nearest(name, tuple(there)) if isinstance(name, str) else None
            wanted = f"one of {', '.join(there)}" if there else "a mapping with the key 'law'"
            got = f"the text {shortened(name)}" if isinstance(name, str) else "no name"
            text = "no such controller to take over" if there else "there is no controller to take over"
            report(path, text, place=where, got=got, nearest=near or "", wanted="" if near else wanted)
            own = BROKEN
        elif name is not None:
            is_named = "name" in own
            own = joined(own, there[name])
            if "name" in own and not is_named:
                own.places["name"] = where, where
        elif isinstance(own, Map) and "law" not in own and isinstance(own.get("name"), str) and own["name"] in there:
            wanted = f"the key 'law', or {{extends: {own['name']}, ...}} to take over the one of that name"
            report((*path, "law"), "missing", place=where, wanted=wanted)
            own.is_whole = False
        _name_by_law(own)
        if isinstance(own, Map) and isinstance(own.get("name"), str):
            there.setdefault(own["name"], own)
        found.append(own)
        found.places.append(place)
    return found


def orphaned(own: Map) -> Map:
    """Return a config that extends one that cannot be read: what it leaves out, or takes over by name, is not known."""
    found = without(own, EXTENDS)
    items = found.get("controllers")
    if isinstance(items, Seq):
        taken = [BROKEN if isinstance(item, str) else item for item in items]
        kept = [without(item, EXTENDS) if isinstance(item, Map) else item for item in taken]
        found["controllers"] = Seq(kept, items.places)
    _mark(found)
    return found


def _mark(node: Any) -> None:
    """Note of all mappings in a tree that keys may be missing."""
    if isinstance(node, Map):
        node.is_whole = False
    for value in node.values() if isinstance(node, Map) else node if isinstance(node, Seq) else ():
        _mark(value)


def _name_by_law(item: Any) -> None:
    """Call a controller without a name like its law."""
    if isinstance(item, Map) and "name" not in item and isinstance(item.get("law"), str):
        item.put("name", item["law"], *item.places["law"])
