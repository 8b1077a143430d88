"""Motions, gains, chains and friction by name: ``reference: puma560/sine``, ``chain: {from: ur5e, jitter: 1 ms}``.

Of a set of gains a law takes those that it has, with the options that are chosen. ``gains: auto`` names no set: the
gains are chosen when all else has been read.
"""

from __future__ import annotations

import functools
from collections.abc import Collection
from typing import Any

from torquebench.chain import CHAINS
from torquebench.errors import nearest
from torquebench.experiment.extends import AUTO, FROM, PRESET, Report, joined, preset_of, without
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import (
    BROKEN,
    KeyPath,
    Map,
    Place,
    Seq,
    copied,
    parse_value,
    shortened,
    tree_of,
    value_at,
)
from torquebench.keys import values_of
from torquebench.robot.library import PRESETS, model_folder, model_names
from torquebench.sim.friction import FRICTIONS

MOTION, GAINS = PRESET
NAMED: dict[KeyPath, Any] = {("chain",): CHAINS, ("plant", "friction"): FRICTIONS}
"""Where a name may stand, or in a mapping with `FROM`, and what has names there."""


@functools.cache
def presets(section: str) -> dict[str, Map]:
    """Return what the arms' files name, ``ARM/NAME`` -> its keys.

    Args:
        section: `MOTION` or `GAINS`.
    """
    found = dict[str, Map]()
    for arm in model_names():
        file = model_folder(arm) / PRESETS
        if file.is_file():
            tree, _ = parse_value(file.read_text(encoding="utf-8"), _broken)
            found |= {f"{arm}/{name}": keys for name, keys in tree.get(section, {}).items()}
    return found


def _broken(path: KeyPath, text: str, *, place: Place) -> None:
    raise ValueError(f"{PRESETS}, line {place.line}: {text}")


def keys_of_name(path: KeyPath, name: str, place: Place) -> Map | None:
    """Return the keys that a name of a chain, or of a joint's friction, stands for; None where it stands for none.

    Args:
        path: Where the name stands.
        name: The name.
        place: Where the keys count as written.
    """
    from torquebench.experiment.dump import plain_values

    if path not in NAMED or name not in (known := NAMED[path]):
        return None
    named = known[name]
    ideal = values_of(type(named)())
    own = {key: plain_values(value) for key, value in values_of(named).items() if value != ideal[key]}
    keys: Map = tree_of(own, place)
    return keys


def write_presets(root: Map, report: Report) -> None:
    """Put keys in place of the names of presets.

    Args:
        root: A config, changed in place.
        report: Receives mistakes.
    """
    _write(root, MOTION, (MOTION,), report)
    for path in NAMED:
        _write_named(root, path, report)
    controllers = root.get("controllers")
    for i, item in enumerate(controllers if isinstance(controllers, Seq) else ()):
        if isinstance(item, Map):
            _write(item, GAINS, ("controllers", i, GAINS), report)


def _write_named(root: Map, path: KeyPath, report: Report) -> None:
    """Put keys in place of the name in a mapping such as ``chain: {from: ur5e, jitter: 1 ms}``."""
    owner, key = value_at(root, path[:-1], None), str(path[-1])
    value = owner.get(key) if isinstance(owner, Map) else None
    if not isinstance(value, Map) or FROM not in value:
        return
    name, place = value[FROM], value.places[FROM][1]
    keys = keys_of_name(path, name, place) if isinstance(name, str) else None
    if keys is None:
        near = (nearest(name, tuple(NAMED[path])) if isinstance(name, str) else None) or ""
        report((*path, FROM), place=place, got=shown(name), nearest=near, wanted=f"one of {', '.join(NAMED[path])}")
        owner[key] = BROKEN
        return
    owner.put(key, joined(without(value, FROM), keys), *owner.places[key])


def _write(owner: Map, key: str, path: KeyPath, report: Report) -> None:
    """Put keys in place of the preset that a value names, alone or in a mapping with more keys."""
    value = owner.get(key)
    name = value.get(FROM) if isinstance(value, Map) else value
    if not isinstance(name, str):
        return
    key_place, place = owner.places[key]
    if name == AUTO and key == GAINS:
        if not isinstance(value, Map):
            owner.put(key, preset_of(AUTO, place), key_place, place)
        return
    if isinstance(value, Map):
        path, place = (*path, FROM), value.places[FROM][1]
    keys = presets(key).get(name)
    if keys is None:
        names = [AUTO] * (key == GAINS) + [*presets(key)]
        near = nearest(name, names) or ""
        wanted = "" if near else f"a mapping, or one of {', '.join(names)}"
        report(path, place=place, got=f"the text {shortened(name)}", nearest=near, wanted=wanted)
        owner[key] = BROKEN
        return
    acts = _acting(owner) if key == GAINS else keys
    written = Map()
    for inner, item in keys.items():
        if inner in acts:
            own = Seq(item, [place] * len(item)) if isinstance(item, Seq) else copied(item)
            written.put(inner, own, place, place)
    own_keys = without(value, FROM) if isinstance(value, Map) else Map()
    owner.put(key, joined(own_keys, written), key_place, owner.places[key][1])


def _acting(controller: Map) -> Collection[str]:
    """Names of the gains that a controller's law has with its options; none where there is no such law."""
    from torquebench.laws.law import find_law, law_names

    name: Any = controller.get("law")
    if name not in law_names():
        return ()
    law = find_law(name)
    options = {option: controller.get(option, declared.values[0]) for option, declared in law.options.items()}
    return [gain for gain, declared in law.gains.items() if declared.acts(options)]
