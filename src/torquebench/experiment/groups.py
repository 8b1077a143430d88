"""Groups of keys as classes declare them, and what else holds values: one of several groups, lists, mappings, names."""

from __future__ import annotations

import dataclasses
import functools
import re
import types
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, create_model

from torquebench.errors import Fault, nearest
from torquebench.experiment.arm import ArmValue
from torquebench.experiment.extends import EXTENDS
from torquebench.experiment.values import AnyOf, Here, Node, Slug, Value, Word, number, some, vector
from torquebench.experiment.words import SLUG_IN_WORDS, a_value, shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath
from torquebench.keys import Declared, Key, declared_keys
from torquebench.registry import docstring
from torquebench.robot.library import ArmFile
from torquebench.sim.friction import FRICTIONS, Friction
from torquebench.sim.joints import JOINTS, Transmission

SWEEP, AUDIT, FALSIFY, TUNE, ARENA = "sweep", "audit", "falsify", "tune", "arena"
MANY = {
    SWEEP: "torquebench sweep FILE, or one of its runs by torquebench run --from-sweep DIR --index K",
    AUDIT: "torquebench audit FILE, or one of its conditions by torquebench sweep DIR/conditions/CONDITION/sweep.yaml",
    FALSIFY: "torquebench falsify FILE, or one of its cases by torquebench run DIR/NAME/worst.yaml",
    TUNE: "torquebench tune FILE, or the tuned laws by torquebench run DIR/tuned.yaml",
    ARENA: "torquebench arena FILE, or one of its entries by torquebench run DIR/entries/CHAIN/ENTRY.yaml",
}
"""Section that makes many runs of an experiment -> what to type instead of ``torquebench run``."""
WORDS: dict[Any, Any] = {Friction: FRICTIONS, Transmission: JOINTS}
"""Class -> words for some of it."""
TYPO = 0.8
"""So alike are a word and the key that it surely was meant to be, wherever else such a key may be valid."""


class Group(Node):
    """A mapping with fixed keys, which becomes one object.

    Args:
        name: Title in the JSON schema.
        doc: What it is.
        fields: Its keys.
        make: From the values of all keys to the object.
        noun: What a key is called in messages.
        one_of: Whether just one of the keys is given.
        kind: The class of the object, where one declares the keys.
    """

    def __init__(
        self,
        name: str,
        doc: str,
        fields: Iterable[Declared],
        make: Callable[[dict[str, Any]], Any],
        noun: str = "key",
        one_of: bool = False,
        kind: Any = None,
    ) -> None:
        self.kind = kind
        self.fields = {declared.name: declared for declared in fields}
        self.doc, self.noun, self._name, self._make, self._one_of = doc, noun, name, make, one_of
        names = ", ".join(self.fields)
        self.wanted = f"a mapping with one of {names}" if one_of else f"a mapping ({names})"

    @functools.cached_property
    def nodes(self) -> dict[str, Node]:
        """Node of each key: the values that may stand there."""
        return {name: node_of(declared) for name, declared in self.fields.items()}

    def groups(self) -> Iterable[Group]:
        """Return the group itself."""
        return (self,)

    def read(self, raw: Any, here: Here) -> Any:
        """Return the object."""
        if not isinstance(raw, dict):
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        values = self.values(raw, here)
        if is_broken(values) or not raw.keys() <= self.fields.keys():
            return BROKEN
        given = [name for name in self.fields if name in raw]
        if self._one_of and len(given) != 1:
            if not given:
                here.add(f"missing: one of {', '.join(self.fields)}", at="key")
            for name in given[1:]:
                here.add(f"{given[0]} is given already", (name,), at="key", wanted="one of the two")
            return BROKEN
        made = self._make(values)
        faults = list(made.faults()) if hasattr(made, "faults") else []
        for fault in faults:
            here.document.add_fault(fault, here.path)
        return BROKEN if faults else made

    def values(self, raw: dict[str, Any], here: Here) -> dict[str, Any]:
        """Return the value of every key, BROKEN where it is wrong or missing; all mistakes are recorded."""
        meant = {self._unknown(key, raw, here) for key in raw if key not in self.fields and not here.document.full}
        found = {}
        for name, declared in self.fields.items():
            if name in raw:
                found[name] = here.read(self.nodes[name], name, raw[name])
            elif not declared.required:
                found[name] = declared.default
            else:
                found[name] = BROKEN
                if name not in meant and getattr(raw, "is_whole", True):
                    what = f"gain '{name}' is missing" if self.noun == "gain" else "missing"
                    here.add(what, (name,), at="key", wanted=self._asked(declared))
        here.document.groups[here.path] = self, found
        return found

    def _asked(self, declared: Declared) -> str:
        """Return what is wanted of who leaves out a key: a value, or a mapping with the keys that it must have."""
        node = self.nodes[declared.name]
        least = [one.name for one in node.fields.values() if one.required] if isinstance(node, Group) else []
        keys = ", ".join(f"{name}: .." for name in least)
        return a_value(declared.key).replace("a value", f"{{{keys}}}" if least else "a value", 1)

    def _unknown(self, key: str, raw: Any, here: Here) -> str:
        """Record that a key is none of the group's, and return the one that it was meant to be, if any."""
        extends = not here.path or (here.path[0] == "controllers" and len(here.path) == 2)
        every = [*self.fields, *([EXTENDS] if extends else [])]
        absent = [name for name in every if name not in raw or name == "name"]  # that may have been filled in
        first = every if here.document.overridden((*here.path, key)) else absent
        near = nearest(key, first, TYPO)
        elsewhere = self._elsewhere(key, here) if near is None else None
        if elsewhere is not None:
            here.document.add_fault(elsewhere, here.path)
            return ""
        more = every if len(first) < len(every) else ()
        near = near or nearest(key, more, TYPO) or nearest(key, first) or nearest(key, more) or ""
        wanted = "" if near else f"one of {', '.join(every)}" if every else "none"
        here.add(f"unknown {self.noun}", (key,), at="key", nearest=near, wanted=wanted)
        return near

    def _elsewhere(self, key: str, here: Here) -> Fault | None:
        """Return what to say of a key that would be valid somewhere else."""
        unknown = Fault((key,), f"unknown {self.noun}", at="key")
        if key in MANY and not here.path:
            return unknown._replace(text="is for many runs", wanted=MANY[key])
        under = next((name for name, node in self.nodes.items() if isinstance(node, Group) and key in node.fields), "")
        if under and here.path:
            return unknown._replace(wanted=f"it under {under}")
        for owner, name, depth in reversed(here.chosen):
            place = here.path[depth:]
            around = _below(owner.group(name), place[:-1]) if place else None
            if around is not None and key in around.fields:
                return unknown._replace(wanted=f"it beside {place[-1]}")
            if self.noun == "gain":
                return None
            groups = {kind: _below(group, place) for kind, group in owner.kinds().items()}
            kinds = [kind for kind, group in groups.items() if group is not None and key in group.fields]
            if kinds:
                having = f"it belongs to {owner.tag}: {', '.join(kinds)}"
                return unknown._replace(text=f"has no effect with {owner.tag}: {name} ({having})")
        home = home_of(here.top, key)
        return unknown._replace(wanted=f"it in {home}") if home and here.path[:1] != (home,) else None

    @functools.cached_property
    def _model(self) -> type[BaseModel]:
        fields: dict[str, Any] = {}
        for name, declared in self.fields.items():
            default = declared.default
            known: dict[str, Any] = {"default": default}
            if dataclasses.is_dataclass(default):
                known = {"default": getattr(default, "name", {})}
            if default in (None, (), {}):  # in a config, what there is none of is left out
                known = {"default_factory": types.NoneType}
            if declared.required:
                known = {}
            fields[name] = self.nodes[name].type(), Field(**known, description=declared.key.text)
        extra: Any = {"minProperties": 1, "maxProperties": 1} if self._one_of else None
        config = ConfigDict(extra="forbid", protected_namespaces=(), json_schema_extra=extra)
        with warnings.catch_warnings():
            # A user's gain may be called like one of BaseModel's methods, which no one calls here.
            warnings.simplefilter("ignore", UserWarning)
            return create_model(self._name, __config__=config, __doc__=self.doc, **fields)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return self._model


def _below(group: Group, path: KeyPath) -> Group | None:
    """Return the group of keys at a place below another, or None where there is none."""
    node: Node | None = group
    for part in path:
        node = node.nodes.get(str(part)) if isinstance(node, Group) else None
    return node if isinstance(node, Group) else None


def home_of(top: Group, key: str) -> str:
    """Return the section that alone has a key; nothing where none has, or several."""
    found = ["the top level"] if key in top.fields else []
    found += [section for section, node in top.nodes.items() if any(key in group.fields for group in node.groups())]
    return found[0] if len(found) == 1 else ""


def is_broken(value: Any) -> bool:
    """Whether a value that was read, or anything in a collection of such, is BROKEN."""
    if isinstance(value, dict | tuple):
        return any(map(is_broken, value.values() if isinstance(value, dict) else value))
    return value is BROKEN


@functools.cache
def group_of(kind: Any, tag: tuple[str, str, str] | None = None, is_usual: bool = False) -> Group:
    """Return the group of a class that declares its keys.

    Args:
        kind: The class, a dataclass.
        tag: Key, value and meaning of what tells it from others, where there are any.
        is_usual: Whether the tag may be left out.
    """
    fixed = [(name, getattr(kind, name), meaning, True) for name, meaning in getattr(kind, "also", {}).items()]
    if tag is not None:
        fixed.insert(0, (*tag, is_usual))
    constants = [
        declare(name, Key(meaning.removesuffix(".")), Word((value,)), value if usual else dataclasses.MISSING)
        for name, value, meaning, usual in fixed
    ]
    keys = declared_keys(kind)

    def make(values: dict[str, Any]) -> Any:
        return kind(**{declared.attribute: values[declared.name] for declared in keys})

    doc = " ".join(docstring(kind).partition("\n\n")[0].split())
    return Group(kind.__name__, doc, [*constants, *keys], make, one_of=getattr(kind, "one_of", False), kind=kind)


def declare(name: str, key: Key, node: Any, default: Any = dataclasses.MISSING) -> Declared:
    """Return a key that no class declares.

    Args:
        name: The key.
        key: What it means.
        node: What may stand there.
        default: Its default; required if left out.
    """
    return Declared(name, name, node, key, default)


class OneOf(Node):
    """A mapping whose one key, the tag, decides which other keys there are.

    Args:
        registry: The kinds.
        meaning: What the tag is.
        tag: The key; that of the registry if left out.
        closed: Whether plug-ins add no kinds; where they do, the message about an unknown one says how.
        usual: The kind if the tag is left out; none if there is no such.
    """

    def __init__(self, registry: Any, meaning: str, tag: str = "", closed: bool = False, usual: str = "") -> None:
        self.tag, self._registry, self._meaning, self._usual = tag or registry.tag, registry, meaning, usual
        self.wanted = f"a mapping with the key '{self.tag}'"
        more = f"a {registry.noun} of your own needs --plugin FILE, the file that registers it"
        self._more = "" if closed else more
        self._of_any: tuple[tuple[Group, ...], Group | None] = (), None

    def names(self) -> tuple[str, ...]:
        """Names of the kinds."""
        return tuple(self._registry)

    def group(self, name: str) -> Group:
        """Return the group of one kind."""
        return group_of(self._registry.find(name), (self.tag, name, self._meaning), is_usual=name == self._usual)

    def kinds(self) -> dict[str, Group]:
        """Return the group of every kind by name."""
        return {name: self.group(name) for name in self.names()}

    def groups(self) -> Iterable[Group]:
        """Return the group of every kind."""
        return self.kinds().values()

    def read(self, raw: Any, here: Here) -> Any:
        """Return the object of the kind that is named."""
        name = raw.get(self.tag, self._if_left_out(raw)) if isinstance(raw, dict) else None
        if isinstance(raw, dict) and name in self.names():
            return self.group(name).read(raw, here._replace(chosen=(*here.chosen, (self, name, len(here.path)))))
        if isinstance(raw, dict):
            self._unknown().values(raw, here)
        else:
            here.add(got=shown(raw), wanted=self.wanted)
        return BROKEN

    def _if_left_out(self, raw: dict[str, Any]) -> str:
        """Return the kind of a mapping without the tag; none where a key looks like the tag, mistyped."""
        return "" if nearest(self.tag, raw.keys(), TYPO) else self._usual

    def _unknown(self) -> Group:
        """Return the group of a kind that could not be told: it has the keys of all, and accepts what some accept."""
        groups = tuple(self.groups())
        known, any_of_them = self._of_any
        if any_of_them is None or known != groups:
            tag = declare(self.tag, Key(self._meaning.removesuffix(".")), Word(self.names(), self._more))
            any_of_them = _one_of_these(groups, tag)
            self._of_any = groups, any_of_them
        return any_of_them

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        models = tuple(group.type() for group in self.groups())
        union: Any = Union[models]  # noqa: UP007  (a union of a computed list)
        return Annotated[union, Field(discriminator=self.tag)] if len(models) > 1 else union


def _one_of_these(groups: Sequence[Group], tag: Declared | None = None) -> Group:
    """Return a group that stands for one of several, where it is not known for which.

    Args:
        groups: The groups.
        tag: A key that would tell them apart.
    """
    fields = {} if tag is None else {tag.name: tag}
    for name in dict.fromkeys(name for group in groups for name in group.fields):
        having = [group for group in groups if name in group.fields]
        own = having[0].fields[name]
        if len(having) == len(groups) and all(group.fields[name].key == own.key for group in having):
            fields.setdefault(name, own)
        elif name not in fields:
            nodes = [group.nodes[name] for group in having]
            inner = [node for node in nodes if isinstance(node, Group)]
            node = _one_of_these(inner) if len(inner) == len(nodes) else AnyOf(nodes)
            fields[name] = declare(name, own.key, node, None)
    return type(groups[0])("unknown", "", fields.values(), dict, groups[0].noun)


class Many(Node):
    """A list.

    Args:
        noun: What its items are called in messages.
        least, most: How many there may be.
        item: What each is.
        wanted: What is wanted in place of another value, where its own words do not say it well.
    """

    def __init__(self, noun: str, least: int, most: int, item: Node, wanted: str = "") -> None:
        self._least, self._most, self._item, self._noun = least, most, item, noun
        usual = f"a list of at least one {noun.removesuffix('s')}" if least else f"a list of {noun}, [] for none"
        self.wanted = wanted or usual

    def groups(self) -> Iterable[Group]:
        """Return the groups that an item may be."""
        return self._item.groups()

    def read(self, raw: Any, here: Here) -> Any:
        """Return the items, a tuple."""
        if isinstance(raw, list) and self._least <= len(raw) <= self._most:
            return tuple(self._read_item(item, here.below(i)) for i, item in enumerate(raw))
        if isinstance(raw, list) and raw:
            here.add(got=f"{len(raw)} {self._noun}", wanted=f"at most {self._most}")
        else:
            here.add(got=shown(raw), wanted=self.wanted)
        return BROKEN

    def _read_item(self, item: Any, here: Here) -> Any:
        return BROKEN if item is BROKEN or here.document.full else self._item.read(item, here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        item: Any = self._item.type()
        return Annotated[list[item], Field(min_length=self._least or None, max_length=self._most)]


class Named(Node):
    """A mapping of names.

    Args:
        wanted: What is wanted in place of another value.
        item: What each name stands for.
        names: The names, or the form that they have; any if left out.
        least, most: How many there may be.
    """

    def __init__(
        self,
        wanted: str,
        item: Node,
        names: tuple[str, ...] | re.Pattern[str] | None = None,
        least: int = 0,
        most: int | None = None,
    ) -> None:
        self.wanted, self._item, self._names, self._least, self._most = wanted, item, names, least, most

    def groups(self) -> Iterable[Group]:
        """Return the groups that a name may stand for."""
        return self._item.groups()

    def read(self, raw: Any, here: Here) -> Any:
        """Return what each name stands for."""
        if not isinstance(raw, dict) or len(raw) < self._least:
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        if self._most is not None and len(raw) > self._most:
            here.add(got=f"{len(raw)} {self.wanted.rpartition(' to ')[2]}", wanted=f"at most {self._most}")
            return BROKEN
        refused = [name for name in raw if not self._accepts(name)]
        for name in refused:
            self._refuse(name, here)
        found = {name: here.read(self._item, name, value) for name, value in raw.items()}
        return BROKEN if refused else found

    def _accepts(self, name: str) -> bool:
        if isinstance(self._names, tuple):
            return name in self._names
        return self._names is None or self._names.fullmatch(name) is not None

    def _refuse(self, name: str, here: Here) -> None:
        if not isinstance(self._names, tuple):
            here.add("its name is not a slug", (name,), at="key", wanted=SLUG_IN_WORDS)
            return
        near = nearest(name, self._names) or ""
        others = "" if near else f"one of {', '.join(self._names)}"
        here.add("unknown name", (name,), at="key", nearest=near, wanted=others)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        name: Any = Literal[self._names] if isinstance(self._names, tuple) else Slug if self._names else str
        extra: Any = {"additionalProperties": False} if name is Slug else None
        limits = Field(min_length=self._least or None, max_length=self._most, json_schema_extra=extra)
        return Annotated[dict[name, self._item.type()], limits]  # type: ignore[misc]


class NameOr(Node):
    """The name of something registered, or a mapping that describes one.

    Args:
        registry: What is registered, or just names.
        kind: Class that declares the mapping's keys; None where only a name will do.
    """

    def __init__(self, registry: Any, kind: Any = None) -> None:
        self._registry, self._group = registry, None if kind is None else group_of(kind)

    @property
    def wanted(self) -> str:  # type: ignore[override]
        """Values that are accepted, in words."""
        names = f"one of {', '.join(self._registry)}"
        return names if self._group is None else f"{names}, or {self._group.wanted}"

    def groups(self) -> Iterable[Group]:
        """Return the group of the mapping, if any."""
        return () if self._group is None else (self._group,)

    def read(self, raw: Any, here: Here) -> Any:
        """Return what a name stands for, the name itself where it stands for nothing, or the mapping's object."""
        if isinstance(raw, dict) and self._group is not None:
            return self._group.read(raw, here)
        if isinstance(raw, str) and raw in self._registry:
            return raw if self._group is None or isinstance(self._registry, tuple) else self._registry[raw]
        near = nearest(raw, tuple(self._registry)) if isinstance(raw, str) else None
        here.add(got=shown(raw), wanted=self.wanted, nearest=near or "")
        return BROKEN

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        names: Any = Literal[tuple(self._registry)]
        return names if self._group is None else Union[names, self._group.type()]  # noqa: UP007  (computed types)


class AllOr(Node):
    """The word ``all``, or a list of names of things registered.

    Args:
        registry: What is registered.
    """

    def __init__(self, registry: Any) -> None:
        self._names = Many("names", 1, 100, NameOr(registry), "all, or a list of names")
        self.wanted = self._names.wanted

    def read(self, raw: Any, here: Here) -> Any:
        """Return the word, or the names, a tuple."""
        return raw if raw == "all" else self._names.read(raw, here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Literal["all"] | self._names.type()


def _list_of(plain: Any, key: Key) -> Any:
    """Return the type of a list that a tuple stands for: of so many items, or of at least one."""
    item, *more = get_args(plain)
    count = (1, None) if more[-1:] == [...] else (1 + len(more), 1 + len(more))
    kind = _list_of(item, key) if get_origin(item) is tuple else number(key) if item is float else item
    return some(kind, *count)


def node_of(declared: Declared) -> Node:
    """Return what may stand at a key."""
    plain, notes, key = declared.type, list[Any](), declared.key
    if get_origin(plain) is Annotated:
        plain, *notes = get_args(plain)
    found = next((note for note in (plain, *notes) if isinstance(note, Node)), None)
    if found is not None:
        return found
    union = get_origin(plain) in (Union, types.UnionType)
    members = [x for x in get_args(plain) if x is not types.NoneType] if union else [plain]
    words = next((get_args(x) for x in members if get_origin(x) is Literal), ())
    if declared.is_vector:
        return vector(key, *words)
    if words:
        return Word(words)
    if ArmFile in members:
        return ArmValue()
    if len(members) == 1:
        (plain,) = members
    args = get_args(plain)
    if plain in WORDS:
        return NameOr(WORDS[plain], plain)
    if isinstance(plain, type) and dataclasses.is_dataclass(plain):
        return group_of(plain)
    if get_origin(plain) is dict:
        return Named(key.wanted, Value(key._replace(wanted=""), number(key)), get_args(args[0]), least=1)
    if get_origin(plain) is tuple:
        return Value(key, _list_of(plain, key))
    kinds = {float: number(key), int: Annotated[int, Field(ge=key.at_least, le=key.at_most)]}
    kind = kinds.get(plain, plain)
    return Value(key, Annotated[kind, *notes] if notes else kind)
