"""Motions and gains of an arm by name: ``reference: puma560/sine``, ``gains: {from: puma560/l, k: 0.6}``.

Of a set of gains a law takes those that it has, with the options that are chosen. ``gains: auto`` names no set: the
gains are chosen when all else has been read.
"""

from __future__ import annotations

import functools
from collections.abc import Collection
from typing import Any

from torquebench.errors import nearest
from torquebench.experiment.extends import AUTO, FROM, PRESET, Report, joined, preset_of, without
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, Map, Place, Seq, copied, parse_value, shortened
from torquebench.robot.library import PRESETS, model_folder, model_names

MOTION, GAINS = PRESET


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


def write_presets(root: Map, report: Report) -> None:
    """Put keys in place of the names of presets.

    Args:
        root: A config, changed in place.
        report: Receives mistakes.
    """
    _write(root, MOTION, (MOTION,), report)
    controllers = root.get("controllers")
    for i, item in enumerate(controllers if isinstance(controllers, Seq) else ()):
        if isinstance(item, Map):
            _write(item, GAINS, ("controllers", i, GAINS), report)


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
