"""Motions and gains of an arm by name: ``reference: puma560/sine``, ``gains: puma560/l``."""

from __future__ import annotations

import functools
from typing import Any

from torquebench.errors import nearest
from torquebench.experiment.extends import Report
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, Map, Place, Seq, copied, parse_value, shortened
from torquebench.robot.library import PRESETS, model_folder, model_names

MOTION, GAINS = "reference", "gains"


@functools.cache
def presets(section: str) -> dict[str, Map]:
    """Return what the arms' files name, ``ARM/NAME`` -> its keys.

    Args:
        section: `MOTION` or `GAINS`.
    """
    found = {}
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
    _replace(root, MOTION, (MOTION,), report)
    controllers = root.get("controllers")
    for i, item in enumerate(controllers if isinstance(controllers, Seq) else ()):
        if isinstance(item, Map) and isinstance(item.get(GAINS), str):
            _replace(item, GAINS, ("controllers", i, GAINS), report)
            if isinstance(item[GAINS], Map):
                _keep_those_that_act(item)


def _replace(owner: Map, key: str, path: KeyPath, report: Report) -> None:
    name = owner.get(key)
    if not isinstance(name, str):
        return
    key_place, place = owner.places[key]
    keys = presets(key).get(name)
    if keys is None:
        near = nearest(name, presets(key)) or ""
        wanted = "" if near else f"a mapping, or one of {', '.join(presets(key))}"
        report(path, place=place, got=f"the text {shortened(name)}", nearest=near, wanted=wanted)
        owner.put(key, BROKEN, key_place, place)
        return
    written = Map()
    for inner, value in keys.items():
        own = Seq(value, [place] * len(value)) if isinstance(value, Seq) else copied(value)
        written.put(inner, own, place, place)
    owner.put(key, written, key_place, place)


def _keep_those_that_act(controller: Map) -> None:
    """Take out of a controller's gains those that its law, with its options, does not have."""
    from torquebench.laws.law import find_law, law_names

    name: Any = controller.get("law")
    if name not in law_names():
        return
    law = find_law(name)
    options = {option: controller.get(option, declared.values[0]) for option, declared in law.options.items()}
    for gain in list(controller[GAINS]):
        if gain not in law.gains or not law.gains[gain].acts(options):
            del controller[GAINS][gain]
