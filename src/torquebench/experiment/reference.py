"""Reference of all keys: the JSON schema of a config, for editors, and the unit of a key."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from torquebench.chain import CHAINS
from torquebench.experiment.controllers import controllers
from torquebench.experiment.extends import EXTENDS, FROM
from torquebench.experiment.groups import Group, declare, group_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.start import KEY
from torquebench.experiment.units import units_of
from torquebench.keys import Declared, Key
from torquebench.laws import find_law
from torquebench.laws.law import law_names
from torquebench.sim.friction import FRICTIONS

PARENT = (
    "Config whose keys are taken over: the name of a shipped one, or a .yaml file beside this one. Mappings merge, "
    "lists and other values replace, null takes a key away; controllers may be named."
)
ANOTHER = {
    "type": "object",
    "title": "Another",
    "description": "A controller like another one of the file, or of the one that it extends, but for the given keys.",
    "properties": {EXTENDS: {"type": "string", "description": "Name of the controller whose keys are taken over."}},
    "required": [EXTENDS],
}
NAMED = {
    "type": ["string", "object"],
    "description": "auto, or a set of gains by name; with others of one's own as {from: auto, lam: 12}.",
    "required": [FROM],
}
"""Gains that are chosen for the arm, or taken of a set."""


def experiment_json_schema(laws: Iterable[str] | None = None) -> dict[str, Any]:
    """Return the JSON schema of a config, for editors; it knows all but the checks across keys.

    Args:
        laws: Names of the laws to describe; all that are registered if left out.
    """
    from torquebench.experiment.arena_section import Arena
    from torquebench.experiment.falsify_section import Falsify
    from torquebench.experiment.sweep_section import Sweep
    from torquebench.experiment.tune_section import Tune

    top, sweep = group_of(Experiment), Key("What `torquebench sweep` varies; not for other commands")
    falsify = Key("What `torquebench falsify` may do to the laws to break them; not for other commands")
    tune = Key("What `torquebench tune` tunes the laws for, all of them alike; not for other commands")
    arena = Key("Where `torquebench arena` tunes and judges laws; not for other commands")
    name = top.fields["name"]._replace(default=None)
    compared = top.fields["controllers"]._replace(type=controllers(laws))
    fields = top.fields | {
        "name": name,
        "controllers": compared,
        "sweep": declare("sweep", sweep, group_of(Sweep), None),
        "falsify": declare("falsify", falsify, group_of(Falsify), None),
        "tune": declare("tune", tune, group_of(Tune), None),
        "arena": declare("arena", arena, group_of(Arena), None),
    }
    whole = Group("Experiment", top.doc, fields.values(), dict).type().model_json_schema()
    groups = whole.pop("$defs")
    groups |= {"Experiment": whole, "Another": ANOTHER}
    for group in groups.values():
        for node in group["properties"].values():
            _accept_units(node, _unit_in(node))
    listed = whole["properties"]["controllers"]
    if "oneOf" not in listed["items"]:
        listed["items"] = {"oneOf": [listed["items"]]}
    listed["items"]["oneOf"] += [{"$ref": "#/$defs/Another"}, {"type": "string"}]
    noise = whole["properties"]["disturbances"]
    noise["type"], noise["pattern"] = ["array", "string"], "%$"
    start = groups["Run"]["properties"]["initial_q"]
    start["anyOf" if "anyOf" in start else "oneOf"].append({"type": "string", "pattern": f"^{KEY}"})
    for law in law_names() if laws is None else laws:
        properties = groups[law]["properties"]
        properties["gains"] = {"anyOf": [properties["gains"], NAMED], "description": properties["gains"]["description"]}
    for group, known in (("Chain", CHAINS), ("Friction", FRICTIONS)):
        differs = {"enum": [*known], "description": "Name of the one from which this differs by the other keys."}
        groups[group]["properties"] |= {FROM: differs}
    described = {key: {"description": node["description"]} for key, node in whole["properties"].items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "type": "object",
        "properties": {EXTENDS: {"type": "string", "description": PARENT}} | described,
        "additionalProperties": False,
        "if": {"not": {"required": [EXTENDS]}},
        "then": {"$ref": "#/$defs/Experiment"},
        "$defs": groups,
    }


def _unit_in(node: dict[str, Any]) -> str:
    """Return the unit that a key's description names; nothing where it names none."""
    found = re.search(r"\[([^\]]+)\]", node.get("description", ""))
    return found[1] if found else ""


def _accept_units(node: dict[str, Any], unit: str) -> None:
    """Let numbers have a unit, wherever they stand in a key's values."""
    units = units_of(unit)
    if node.get("type") == "number" and units:
        node["type"], node["pattern"] = ["number", "string"], f"[0-9.] *({'|'.join(map(re.escape, units))})$"
    for inner in (node.get("items"), node.get("additionalProperties"), *node.get("oneOf", ()), *node.get("anyOf", ())):
        if isinstance(inner, dict):
            _accept_units(inner, unit)
    for inner in node.get("prefixItems", ()):
        _accept_units(inner, unit)


def unit_of(key: str) -> str | None:
    """Return the unit of a key; ``1`` for a pure number, None for a word, a section, or what is not known.

    Args:
        key: Dotted path, such as ``plant.payload.mass``, ``disturbances[0].hold`` or ``controllers.*.gains.phi``.
    """
    parts = [re.sub(r"\[\d+\]", "", part) for part in key.split(".")]
    if parts[0] == "controllers" and "gains" in parts[:-1]:
        name = parts[parts.index("gains") + 1]
        gains = [find_law(law).gains for law in law_names()]
        return _only({own[name].unit for own in gains if name in own})
    found = _declared(parts)
    return None if found is None else _only({key.unit for key in found} - {""})


def meanings_of(key: str) -> list[str]:
    """Return what a key may mean, one for each kind of thing that has it; the key as of `unit_of`."""
    return [found.meaning for found in _declared([re.sub(r"\[\d+\]", "", part) for part in key.split(".")]) or ()]


def _declared(parts: Sequence[str]) -> list[Key] | None:
    """Return the keys that a path may be; None for a section's."""
    groups, found = [group_of(Experiment)], list[Declared]()
    for part in parts:
        if groups and not part.isdecimal():  # below a mapping of names to numbers, its own unit holds
            found = [group.fields[part] for group in groups if part in group.fields]
            groups = [inner for group in groups if part in group.nodes for inner in group.nodes[part].groups()]
    return None if groups else [declared.key for declared in found]


def _only(units: set[str]) -> str | None:
    return units.pop() if len(units) == 1 else None


def joint_units(unit: str, slides: Sequence[bool]) -> str:
    """Return a unit of joints that turn as one of an arm's joints: in m where they slide, both where only some do.

    Args:
        unit: Unit with rad, with or without a prefix; one without rad is returned as it is.
        slides: Of each joint, whether it slides.
    """
    return ", ".join(dict.fromkeys(unit.replace("rad", "m") if own else unit for own in sorted(slides)))
