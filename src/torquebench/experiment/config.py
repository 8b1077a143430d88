"""Checking a config: pydantic's errors and those of the rules as mistakes with a place and the nearest valid name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from torquebench.errors import Fault, nearest
from torquebench.experiment.groups import FAULT, Group, Many, Node, OneOf, Spec, group_of
from torquebench.experiment.rules import check_rules
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, read_bytes, read_document
from torquebench.experiment.words import SLUG_IN_WORDS, explain, shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, value_at
from torquebench.keys import values_of

SWEEP, AUDIT = "sweep", "audit"
MANY = {
    SWEEP: "torquebench sweep FILE, or one of its runs by torquebench run --from-sweep DIR --index K",
    AUDIT: "torquebench audit FILE, or one of its conditions by torquebench sweep DIR/conditions/CONDITION/sweep.yaml",
}
"""Section that makes many runs of an experiment -> what to type instead of ``torquebench run``."""
TYPO = 0.8
"""So alike are a word and the key that it surely was meant to be, wherever else such a key may be valid."""
_STRUCTURE = frozenset(("model_type", "tuple_type", "list_type", "dict_type", "too_short", "too_long"))
"""Errors that say of a section that it is none."""


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> Experiment:
    """Read and check an experiment's file.

    Args:
        path: The YAML file.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: the file cannot be read, or it or an override has mistakes; all of them at once.
    """
    return parse_experiment(read_bytes(path), str(path), overrides)


def parse_experiment(text: str | bytes, filename: str = "", overrides: Sequence[str] = ()) -> Experiment:
    """Check an experiment given as YAML text.

    Args:
        text: The YAML.
        filename: What to call it in messages.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: something in it or in an override is wrong; all mistakes at once, in reading order.
    """
    document = read_document(text, filename)
    apply_overrides(document, overrides)
    return check_experiment(document)


def check_experiment(document: Document) -> Experiment:
    """Check an experiment given as a document.

    Raises:
        ConfigError: something in it is wrong; all mistakes at once, in reading order. Sections are held against each
            other where each is right by itself.
    """
    found = check_group(document, (), group_of(Experiment))
    check_rules(document, _parts(found) if found is not None else _valid_parts(document))
    document.raise_problems()
    if found.run.metrics_from is None:
        run = dataclasses.replace(found.run, metrics_from=found.reference.metrics_from)
        found = dataclasses.replace(found, run=run)
    return found  # type: ignore[no-any-return]


def check_group(document: Document, path: KeyPath, group: Group) -> Any:
    """Return the object of what a document has at a place, or None after recording what is wrong with it.

    Args:
        document: Holds the values, and receives the mistakes.
        path: Where they are.
        group: What they should be.
    """
    raw = value_at(document.root, path)
    before = len(document.found)
    try:
        found = group.validate(raw)
    except ValidationError as error:
        _Explainer(document, path, group, raw).record(error)
        return None
    return found if len(document.found) == before else None


def _parts(experiment: Experiment) -> dict[str, Any]:
    """Return the sections of an experiment as the rules take them."""
    parts = dict(values_of(experiment))
    for key in ("controllers", "disturbances"):
        parts[key] = {(key, i): item for i, item in enumerate(parts[key])}
    parts["fuzzy"] = {("fuzzy", name): item for name, item in experiment.fuzzy.items()}
    return parts


def _valid_parts(document: Document) -> dict[str, Any]:
    """Return the sections of a document that are valid by themselves, as the rules take them."""
    parts: dict[str, Any] = {}
    for key, spec in group_of(Experiment).fields.items():
        raw, node = document.root.get(key), spec.node
        if isinstance(node, Many):
            found = {(key, name): _valid_or_none(node.item.type(False), item) for name, item in node.items(raw)}
            parts[key] = {path: item for path, item in found.items() if item is not None}
        elif key in document.root:
            parts[key] = _valid_or_none(spec.type(False), raw)
        else:
            parts[key] = None if spec.required else spec.default
    return parts


def _valid_or_none(kind: Any, raw: Any) -> Any:
    try:
        return TypeAdapter(kind).validate_python(raw)
    except ValidationError:
        return None


class _Explainer:
    """Turns the errors of one validation into mistakes of a document."""

    def __init__(self, document: Document, base: KeyPath, node: Node, raw: Any) -> None:
        self._document, self._base, self._node, self._raw = document, base, node, raw
        self._meant: set[KeyPath] = set()
        """Keys that are missing, but were only misspelt."""

    def record(self, error: ValidationError) -> None:
        """Record every mistake, misspelt keys first: what they were meant to be is not missing."""
        details: Sequence[Mapping[str, Any]] = error.errors(include_url=False)
        for detail in details:
            if detail["type"] == "extra_forbidden" and not self._document.full:
                self._unknown(detail["loc"])
        for detail in details:
            known = detail["type"] == "extra_forbidden" or detail["input"] is BROKEN or _is_echo(detail)
            if not known and not self._document.full:
                self._wrong(detail)

    def _walk(self, loc: tuple[int | str, ...]) -> tuple[KeyPath, list[tuple[Group, Any]], Spec | None, Node, Any]:
        """Follow an error's place through the raw values.

        Returns:
            The path; the groups on the way, each with its raw values; the last key passed; what is expected at the end;
            and what is there.
        """
        path, groups, spec = self._base, list[tuple[Group, Any]](), None
        node, raw = self._node, self._raw
        for part in loc:
            if isinstance(node, OneOf):
                node = node.pick(raw)
            if isinstance(node, Group) and isinstance(part, str):
                groups.append((node, raw))
                spec = node.fields.get(str(part))
                node = None if spec is None else spec.node
                path, raw = (*path, part), raw.get(part) if isinstance(raw, dict) else None
            elif _has(raw, part):
                node = node.item if isinstance(node, Many) else None
                path, raw = (*path, part), raw[part]
        return path, groups, spec, node, raw

    def _unknown(self, loc: tuple[int | str, ...]) -> None:
        path, groups, _, _, _ = self._walk(loc)
        group, raw = groups[-1]
        key, every = str(path[-1]), list(group.fields)
        absent = [name for name in every if name not in raw]
        first = every if self._document.overridden(path) else absent
        near = nearest(key, first, TYPO)
        elsewhere = self._elsewhere(path, group, key) if near is None else None
        if elsewhere is not None:
            self._document.add_fault(elsewhere)
            return
        near = near or nearest(key, every, TYPO) or nearest(key, first) or nearest(key, every)
        self._meant.add((*path[:-1], near or ""))
        wanted = "" if near else f"one of {', '.join(every)}" if every else "none"
        self._document.add(path, f"unknown {group.noun}", at="key", nearest=near or "", wanted=wanted)

    def _elsewhere(self, path: KeyPath, group: Group, key: str) -> Fault | None:
        """Return the fault of a key that is not valid here but would be somewhere else."""
        if group.noun == "gain":
            beside = self._walk(path[len(self._base) : -1])[1][-1][0].fields
            option = Fault(path, f"unknown gain: '{key}' is an option of the law", wanted="it beside gains", at="key")
            return option if key in beside else None
        other = self._belongs(path, group, key)
        if other is not None:
            return other
        if key in MANY and len(path) == 1:
            return Fault(path, "is for many runs", wanted=MANY[key], at="key")
        home = homes().get(key)
        if home is None or home == path[0]:
            return None
        return Fault(path, "does not belong here", wanted=f"it in {home}", at="key")

    def _belongs(self, path: KeyPath, group: Group, key: str) -> Fault | None:
        """Return the fault of a key that other kinds have, or that is a gain."""
        loc = path[len(self._base) : -1]
        for cut in range(len(loc), -1, -1):
            _, _, _, owner, raw = self._walk(loc[:cut])
            if not isinstance(owner, OneOf) or not isinstance(raw, dict) or raw.get(owner.tag) not in owner.names():
                continue
            name = raw[owner.tag]
            groups = {kind: _below(other, loc[cut:]) for kind, other in owner.groups().items()}
            kinds = [kind for kind, other in groups.items() if other is not None and key in other.fields]
            if kinds:
                text = f"has no effect with {owner.tag}: {name} (it belongs to {owner.tag}: {', '.join(kinds)})"
                return Fault(path, text, at="key")
            gains = group.fields["gains"].node if "gains" in group.fields else None
            if isinstance(gains, Group) and key in gains.fields:
                return Fault(path, f"is a gain of law '{name}'", wanted="it under gains", at="key")
        return None

    def _wrong(self, detail: Mapping[str, Any]) -> None:
        document, loc = self._document, detail["loc"]
        named = bool(loc) and loc[-1] == "[key]"
        path, groups, spec, node, _ = self._walk(loc)
        if named and path and path[-1] == "[key]" and not document.written(path):
            path, groups, spec, node, _ = self._walk(loc[:-1])
        kind, value = detail["type"], detail["input"]
        nothing = value is None and bool(path) and isinstance(path[-1], str)
        if kind == "missing":
            if path not in self._meant and not (path and isinstance(path[-1], int)):
                group = groups[-1][0]
                what = f"gain '{path[-1]}' is missing" if group.noun == "gain" else "missing"
                document.add(path, what, at="key", wanted=_a_value(spec))
        elif named and path[-1] != "[key]":
            self._wrong_name(path, spec)
        elif nothing and not (kind == FAULT and detail["ctx"]["got"]):
            self._nothing(path, spec, node)
        elif kind == FAULT:
            fault = Fault(**detail["ctx"])
            document.add_fault(fault._replace(path=path, got=fault.got or shown(value)))
        elif isinstance(node, Many) and kind in _STRUCTURE:
            wanted = {"wanted": spec.key.wanted} if spec is not None and spec.key.wanted else {}
            document.add(path, **{"got": shown(value), **node.fault(value), **wanted})
        elif isinstance(node, Group | OneOf) and kind in _STRUCTURE:
            document.add(path, got=shown(value), wanted=_mapping(node))
        elif spec is not None and node is None:
            parts: dict[str, Any] = explain(detail, spec, inner=not groups or path[-1] not in groups[-1][0].fields)
            owner = self._walk(path[len(self._base) : -1])[3]
            if isinstance(owner, OneOf) and path[-1] == owner.tag and isinstance(value, str) and owner.more:
                parts["note"] = owner.more
            document.add(path, **parts)
        else:
            document.add(path, str(detail["msg"]), got=shown(value))

    def _nothing(self, path: KeyPath, spec: Spec | None, node: Node) -> None:
        if spec is not None and isinstance(spec.node, Many) and isinstance(node, Group | OneOf):
            self._document.add(path, "nothing is given", wanted=_mapping(node))
            return
        self._document.add(path, "nothing is given", wanted=_a_value(spec))

    def _wrong_name(self, path: KeyPath, spec: Spec | None) -> None:
        """Record that a name in a mapping of names is not one that is accepted."""
        if spec is None or not spec.names:
            self._document.add(path, "its name is not a slug", at="key", wanted=SLUG_IN_WORDS)
            return
        near = nearest(str(path[-1]), spec.names)
        others = "" if near else f"one of {', '.join(spec.names)}"
        self._document.add(path, "unknown name", at="key", nearest=near or "", wanted=others)


def _below(group: Group, loc: tuple[int | str, ...]) -> Group | None:
    """Return the group of keys at a place below another, or None where there is none."""
    node: Node = group
    for part in loc:
        spec = node.fields.get(str(part)) if isinstance(node, Group) else None
        node = spec.node if spec is not None else None
    return node if isinstance(node, Group) else None


def _is_echo(detail: Mapping[str, Any]) -> bool:
    """Whether pydantic calls a list too short only because its items were refused, each of which it tells too."""
    return detail["type"] == "too_short" and bool(len(detail["input"]) >= detail["ctx"]["min_length"])


def _has(raw: Any, part: int | str) -> bool:
    if isinstance(part, str):
        return isinstance(raw, dict) and part in raw
    return isinstance(raw, list) and part < len(raw)


def _a_value(spec: Spec | None) -> str:
    return "a value" if spec is None else f"a value ({spec.key.text.rstrip('.')})"


def _mapping(node: Group | OneOf) -> str:
    if isinstance(node, OneOf):
        return f"a mapping with the key '{node.tag}'"
    return f"a mapping ({', '.join(node.fields)})"


def homes() -> dict[str, str]:
    """Return the section of each key that only one section has."""
    top = group_of(Experiment).fields
    found = {key: {"the top level"} for key in top}
    for section, spec in top.items():
        node = spec.node.item if isinstance(spec.node, Many) else spec.node
        if section in ("controllers", "fuzzy") or node is None:
            continue
        for group in node.groups().values() if isinstance(node, OneOf) else [node]:
            for key in group.fields:
                found.setdefault(key, set()).add(section)
    return {key: sections.pop() for key, sections in found.items() if len(sections) == 1}
