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
    parse_value,
    tree_of,
    value_at,
)
from torquebench.keys import values_of
from torquebench.robot.library import PRESETS, model_folder, model_names
from torquebench.sim.friction import FRICTIONS

MOTION, GAINS = PRESET
NAMED: dict[KeyPath, Any] = {("chain",): CHAINS, ("plant", "friction"): FRICTIONS}
"""Keys at which a name may stand, alone or in a mapping with `FROM`, and the registry of these names."""


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
    controllers = root.get("controllers")
    each = range(len(controllers)) if isinstance(controllers, Seq) else ()
    for path in ((MOTION,), *NAMED, *(("controllers", i, GAINS) for i in each)):
        owner = value_at(root, path[:-1], None)
        if isinstance(owner, Map):
            _write(owner, str(path[-1]), path, report)


def _write(owner: Map, key: str, path: KeyPath, report: Report) -> None:
    """Put keys in place of a preset's name: alone, or, also of what is `NAMED`, in a mapping with keys of its own."""
    value = owner.get(key)
    if isinstance(value, Map) and FROM in value:
        name, place, at, own = value[FROM], value.places[FROM][1], (*path, FROM), without(value, FROM)
    elif isinstance(value, str) and path not in NAMED:
        name, place, at, own = value, owner.places[key][1], path, Map()
    else:
        return
    if name == AUTO and key == GAINS:
        if value == AUTO:
            owner.put(key, preset_of(AUTO, place), *owner.places[key])
        return
    known = [*NAMED[path]] if path in NAMED else [AUTO] * (key == GAINS) + [*presets(key)]
    if not isinstance(name, str) or name not in known:
        near = (nearest(name, known) if isinstance(name, str) else None) or ""
        wanted = f"{'' if path in NAMED else 'a mapping, or '}one of {', '.join(known)}"
        report(at, place=place, got=shown(name), nearest=near, wanted="" if near else wanted)
        owner[key] = BROKEN
        return
    keys: Any = keys_of_name(path, name, place) if path in NAMED else tree_of(presets(key)[name], place)
    if key == GAINS:
        keys = without(keys, *(set(keys) - set(_acting(owner))))
    owner.put(key, joined(own, keys), *owner.places[key])


def _acting(controller: Map) -> Collection[str]:
    """Names of the gains that a controller's law has with its options; none where there is no such law."""
    from torquebench.laws.law import find_law, law_names

    name: Any = controller.get("law")
    if name not in law_names():
        return ()
    law = find_law(name)
    options = {option: controller.get(option, declared.values[0]) for option, declared in law.options.items()}
    return [gain for gain, declared in law.gains.items() if declared.acts(options)]
