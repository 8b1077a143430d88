"""Writing a resolved experiment: YAML that reads back equal, and a hash that identifies it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import yaml

from torquebench.chain import CHAINS, Chain
from torquebench.experiment.controllers import Controller
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.yaml_tree import BROKEN, NUMBER, Map, Seq
from torquebench.keys import values_of
from torquebench.robot.library import ArmFile
from torquebench.sim.friction import FRICTIONS, Friction


class _Dumper(yaml.SafeDumper):
    """Quotes whatever either YAML 1.1 or the subset read here would not take for text."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write every value out: aliases are not read back."""
        return True


_Dumper.add_representer(Map, yaml.SafeDumper.represent_dict)
_Dumper.add_representer(Seq, yaml.SafeDumper.represent_list)
# A config that cannot be read is written out as well, before its mistakes are told.
_Dumper.add_representer(type(BROKEN), lambda dumper, _: dumper.represent_none(None))
# YAML 1.1, which PyYAML writes for, takes 1e-3 for text.
_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))


def plain(experiment: Experiment) -> dict[str, Any]:
    """Return the resolved experiment as plain values, keys as in the file, every default filled in."""
    data: dict[str, Any] = plain_values(experiment)
    if not data["fuzzy"]:
        del data["fuzzy"]
    return data


def plain_values(item: Any) -> Any:
    """Return an object that declares its keys, or a collection of such, as plain values; keys without one left out."""
    if isinstance(item, Controller):
        fuzzy = {} if item.fuzzy is None else {"fuzzy": item.fuzzy}
        common = {"name": item.name, "law": item.law}
        return {**common, **item.options, **fuzzy, "gains": plain_values(item.gains), "expect": item.expect}
    for kind, known in ((Chain, CHAINS), (Friction, FRICTIONS)):
        if isinstance(item, kind) and item.name in known and known[item.name] == item:
            return item.name
    if isinstance(item, ArmFile):
        return str(item)
    if isinstance(item, Mapping):
        return {key: plain_values(value) for key, value in item.items()}
    if isinstance(item, tuple | list):
        return [plain_values(value) for value in item]
    if not dataclasses.is_dataclass(item):
        return item
    cls: Any = type(item)
    tags = [cls.tag] if hasattr(cls, "tag") else []
    found = {tag: getattr(item, tag) for tag in (*tags, *getattr(cls, "also", ()))}
    found |= {key: plain_values(value) for key, value in values_of(item).items() if value is not None}
    return found


def dump_experiment(experiment: Experiment) -> str:
    """Return the resolved experiment as YAML that loads to an equal experiment."""
    return dump_tree(plain(experiment))


def dump_tree(tree: Any) -> str:
    """Return plain values as YAML that reads back equal."""
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)


def flat_text(document: Document, text: str | bytes) -> bytes:
    """Return a config's own text, or, where it extends others, one text of them all.

    Args:
        document: The config.
        text: Its own text.
    """
    if document.parents:
        return dump_tree(document.root).encode()
    return text.encode() if isinstance(text, str) else text


def config_hash(experiment: Experiment) -> str:
    """Return the SHA-256 of the resolved experiment as canonical JSON."""
    return canonical_hash(plain(experiment))


def canonical_hash(tree: Any) -> str:
    """Return the SHA-256 of plain values as canonical JSON."""
    text = json.dumps(tree, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
