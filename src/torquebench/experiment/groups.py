"""From classes that declare their keys to pydantic, which checks values and writes the JSON schema."""

from __future__ import annotations

import dataclasses
import functools
import types
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    TypeAdapter,
    ValidationError,
    create_model,
)
from pydantic_core import PydanticCustomError

from torquebench.errors import Fault, nearest
from torquebench.keys import Declared, Key, Kinds, declared_keys
from torquebench.registry import Registry

FAULT = "fault"
"""Type of those of pydantic's errors that carry the parts of a `Fault`."""
Node: TypeAlias = "Group | OneOf | Many | None"
"""What may stand at a key: a group of keys, one of several, many of these, or a plain value."""
_CONFIG = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, protected_namespaces=())


def positive_zero(x: float) -> float:
    """Return x, with 0.0 for -0.0: equal experiments must not differ in their text."""
    return x + 0.0


def not_a_number(value: object) -> object:
    """Refuse numbers where words and booleans are accepted: 1 == True would pass for one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise PydanticCustomError("literal_error", "a number")
    return value


def refusal(faults: Iterable[Fault], raw: Any) -> ValidationError:
    """Return pydantic's error for mistakes found by our own code in a value."""
    lines: Any = [
        {"type": PydanticCustomError(FAULT, "{text}", fault._asdict()), "loc": fault.path, "input": raw}
        for fault in faults
    ]
    return ValidationError.from_exception_data("value", lines)


class Spec(NamedTuple):
    """One key of a group."""

    key: Key
    type: Callable[[bool], Any]
    """Returns the type for pydantic: False for the one that validates, True for the one that describes."""
    default: Any = dataclasses.MISSING
    node: Node = None
    choices: tuple[str | bool, ...] = ()
    """Values of a key that takes words."""
    vector: bool = False
    """Whether it takes one number for all joints, or one for each."""
    names: tuple[str, ...] = ()
    """Names that a mapping of names to numbers accepts; none for any."""

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is dataclasses.MISSING


def always(kind: Any) -> Callable[[bool], Any]:
    """Return the `Spec.type` of a key whose type for pydantic is the same in both uses."""
    return lambda describes: kind


class Group:
    """A mapping with fixed keys, which becomes one object.

    Args:
        name: Title in the JSON schema.
        doc: What it is.
        fields: Its keys.
        make: From the values of all keys to the object.
        noun: What a key is called in messages.
        extra: What the JSON schema says besides.
    """

    def __init__(
        self,
        name: str,
        doc: str,
        fields: Mapping[str, Spec],
        make: Callable[[dict[str, Any]], Any],
        noun: str = "key",
        extra: dict[str, Any] | None = None,
    ) -> None:
        self.name, self.doc, self.fields, self.noun = name, doc, fields, noun
        self._make, self._extra = make, extra

    def model(self, describes: bool) -> type[BaseModel]:
        """Return pydantic's model of the keys; see `Spec.type`."""
        fields: dict[str, Any] = {}
        for name, spec in self.fields.items():
            default = ... if spec.required else spec.default
            info: dict[str, Any] = {"description": spec.key.text}
            if describes and dataclasses.is_dataclass(default):
                info["json_schema_extra"] = {"default": getattr(default, "name", {})}
            if describes and isinstance(default, dict):
                default = None
            fields[name] = spec.type(describes), Field(default, **info)
        config = ConfigDict(**_CONFIG, json_schema_extra=self._extra) if describes and self._extra else _CONFIG
        with warnings.catch_warnings():
            # A user's gain may be called like one of BaseModel's methods, which no one calls here.
            warnings.simplefilter("ignore", UserWarning)
            made: type[BaseModel] = create_model(self.name, __config__=config, __doc__=self.doc, **fields)
        return made

    @functools.cached_property
    def _adapter(self) -> TypeAdapter[Any]:
        return TypeAdapter(self.model(False))

    def validate(self, raw: Any) -> Any:
        """Return the object of raw values.

        Raises:
            ValidationError: there are mistakes; all of them.
        """
        return self._make(dict(self._adapter.validate_python(raw)))

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        return self.model(True) if describes else Annotated[Any, PlainValidator(self.validate)]


@functools.cache
def group_of(kind: Any, tag: tuple[str, str, str] | None = None) -> Group:
    """Return the group of a class that declares its keys.

    Args:
        kind: The class, a dataclass.
        tag: Key, value and meaning of what tells it from others, where there are any.
    """
    fields = {} if tag is None else {tag[0]: _constant(tag[1], tag[2])}
    for name, meaning in getattr(kind, "also", {}).items():
        fields[name] = _constant(getattr(kind, name), meaning)
    constants, declared = set(fields), declared_keys(kind)
    fields |= {one.name: spec_of(one) for one in declared}
    attributes = {one.name: one.attribute for one in declared}

    def make(values: dict[str, Any]) -> Any:
        return kind(**{attributes[name]: value for name, value in values.items() if name not in constants})

    doc = " ".join((kind.__doc__ or "").partition("\n\n")[0].split())
    extra = {"minProperties": 1, "maxProperties": 1} if getattr(kind, "one_of", False) else None
    return Group(kind.__name__, doc, fields, make, extra=extra)


def _constant(value: str, meaning: str) -> Spec:
    kind: Any = Literal[value]
    return Spec(Key(meaning.removesuffix(".")), always(kind), choices=(value,))


class OneOf:
    """A mapping whose one key, the tag, decides which other keys there are.

    Args:
        registry: The kinds.
        meaning: What the tag is.
        more: Where further kinds may come from; ends the message about an unknown one.
    """

    _unknown: tuple[list[Group], Group | None] = ([], None)
    """The kinds that there were when `unknown` was asked last, and its answer."""

    def __init__(self, registry: Kinds, meaning: str, more: str = "") -> None:
        self.registry, self.meaning, self.more = registry, meaning, more
        self.tag = registry.tag

    def names(self) -> tuple[str, ...]:
        """Names of the kinds."""
        return self.registry.names()

    def group(self, name: str) -> Group:
        """Return the group of one kind."""
        cls: Any = self.registry.find(name)
        return group_of(cls, (self.tag, name, self.meaning))

    def groups(self) -> dict[str, Group]:
        """Return the group of every kind by name."""
        return {name: self.group(name) for name in self.names()}

    def pick(self, raw: Any) -> Group:
        """Return the group that raw values name; where they name none, what all kinds share."""
        name = raw.get(self.tag) if isinstance(raw, dict) else None
        return self.group(name) if isinstance(name, str) and name in self.names() else self.unknown()

    def unknown(self) -> Group:
        """Return the group of a kind that could not be told: what all have is checked, what some have is accepted."""
        groups = list(self.groups().values())
        if self._unknown[0] == groups:
            return self._unknown[1]  # type: ignore[return-value]
        fields: dict[str, Spec] = {}
        for group in groups:
            for name, spec in group.fields.items():
                shared = all(name in other.fields and other.fields[name].key == spec.key for other in groups)
                fields.setdefault(name, spec if shared else Spec(spec.key, always(Any), None))
        names = self.names()
        kind: Any = Literal[names]
        fields[self.tag] = Spec(Key(self.meaning.removesuffix(".")), always(kind), choices=names)
        self._unknown = groups, Group("unknown", "", fields, lambda values: None, noun=groups[0].noun)
        return self._unknown[1]

    def validate(self, raw: Any) -> Any:
        """Return the object of raw values.

        Raises:
            ValidationError: there are mistakes; all of them.
        """
        return self.pick(raw).validate(raw)

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        if not describes:
            return Annotated[Any, PlainValidator(self.validate)]
        models = tuple(group.model(True) for group in self.groups().values())
        union: Any = Union[models]  # noqa: UP007  (a union of a computed list)
        return Annotated[union, Field(discriminator=self.tag)] if len(models) > 1 else union


class Many:
    """A list of groups.

    Args:
        noun: What its items are called in messages.
        least, most: How many there may be.
        item: What each is.
    """

    def __init__(self, noun: str, least: int, most: int, item: Group | OneOf) -> None:
        self.noun, self.least, self.most, self.item = noun, least, most, item

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        item: Any = self.item.type(describes)
        if describes:
            return Annotated[list[item], Field(min_length=self.least or None, max_length=self.most)]
        return Annotated[tuple[item, ...], Field(min_length=self.least, strict=False), BeforeValidator(self._short)]

    def _short(self, raw: Any) -> Any:
        """Refuse more items than there may be before looking at any."""
        if isinstance(raw, list | dict) and len(raw) > self.most:
            raise refusal([Fault((), **self.fault(raw))], raw)
        return raw

    def items(self, raw: Any) -> Iterable[tuple[int | str, Any]]:
        """Return the items of raw values with the index or name of each; none where they are no such list."""
        return enumerate(raw) if isinstance(raw, list) and len(raw) <= self.most else ()

    def fault(self, raw: Any) -> dict[str, Any]:
        """Return what was wanted instead of a value that is no such list."""
        if isinstance(raw, list) and len(raw) > self.most:
            return {"got": f"{len(raw)} {self.noun}", "wanted": f"at most {self.most}"}
        some = f"a list of at least one {self.noun.removesuffix('s')}"
        return {"wanted": some if self.least else f"a list of {self.noun}, [] for none"}


class ManyNamed(Many):
    """A mapping of names to groups."""

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        item: Any = self.item.type(describes)
        if not describes:
            return Annotated[dict[Slug, item], BeforeValidator(self._short)]
        extra: Any = {"additionalProperties": False}
        return Annotated[dict[Slug, item], Field(max_length=self.most, json_schema_extra=extra)]

    def items(self, raw: Any) -> Iterable[tuple[int | str, Any]]:
        """Return the items of raw values with the index or name of each; none where they are no such mapping."""
        return raw.items() if isinstance(raw, dict) and len(raw) <= self.most else ()

    def fault(self, raw: Any) -> dict[str, Any]:
        """Return what was wanted instead of a value that is no such mapping."""
        if isinstance(raw, dict) and len(raw) > self.most:
            return {"got": f"{len(raw)} {self.noun}", "wanted": f"at most {self.most}"}
        return {"wanted": f"a mapping of names to {self.noun}"}


class Named:
    """The name of something registered, or a mapping that describes one.

    Args:
        registry: What is registered.
        kind: Class of what is registered, which declares the mapping's keys; None where only a name will do, which
            then stays one.
    """

    def __init__(self, registry: Any, kind: Any = None) -> None:
        self.registry, self.node = registry, None if kind is None else group_of(kind)

    @property
    def choices(self) -> tuple[str, ...]:
        """Names of what is registered."""
        return tuple(self.registry)

    def validate(self, raw: Any) -> Any:
        """Return what a name stands for, or the object of a mapping's raw values.

        Raises:
            ValidationError: there are mistakes; all of them.
        """
        if isinstance(raw, dict) and self.node is not None:
            return self.node.validate(raw)
        if isinstance(raw, str) and raw in self.registry:
            return self.registry[raw] if self.node is not None and isinstance(self.registry, Registry) else raw
        wanted = f"one of {', '.join(self.registry)}"
        if self.node is not None:
            wanted += f", or a mapping ({', '.join(self.node.fields)})"
        near = nearest(raw, tuple(self.registry)) if isinstance(raw, str) else None
        raise refusal([Fault((), wanted=wanted, nearest=near or "")], raw)

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        if not describes:
            return Annotated[Any, PlainValidator(self.validate)]
        names: Any = Literal[tuple(self.registry)]
        return names if self.node is None else Union[names, self.node.model(True)]  # noqa: UP007  (computed types)


@dataclass(frozen=True)
class Text:
    """Note of a key that takes text: its form and length."""

    pattern: str | None = None
    longest: int | None = None


SLUG = Text(r"^[a-z0-9]([a-z0-9-]{0,62}[a-z0-9])?$")
Slug: TypeAlias = Annotated[str, Field(pattern=SLUG.pattern)]


@dataclass(frozen=True)
class Ints:
    """Note of a key that takes a few whole numbers: their bounds, and of what they are multiples."""

    least: int
    most: int
    step: int


@dataclass(frozen=True)
class Checked:
    """Note of a key whose value our own function checks; `described` is its type in the JSON schema."""

    check: Callable[[Any], Any]
    described: Any
    node: Node = None

    def type(self, describes: bool) -> Any:
        """Return the type for pydantic; see `Spec.type`."""
        return self.described if describes else Annotated[Any, PlainValidator(self.check)]


def spec_of(declared: Declared) -> Spec:
    """Return a declared key as one of a group."""
    plain, notes = declared.type, list[Any]()
    if get_origin(plain) is Annotated:
        plain, *notes = get_args(plain)
    key, default = declared.key, declared.default
    for note in notes:
        if hasattr(note, "type"):
            node = note if isinstance(note, OneOf | Many) else getattr(note, "node", None)
            return Spec(key, note.type, default, node, getattr(note, "choices", ()))
    union = get_origin(plain) in (Union, types.UnionType)
    members = [x for x in get_args(plain) if x is not types.NoneType] if union else [plain]
    words = next((get_args(x) for x in members if get_origin(x) is Literal), ())
    if tuple[float, ...] in members:
        vector = always(Annotated[Any, NumberOrList(key, words[0] if words else None)])
        return Spec(key, vector, default, choices=words, vector=True)
    (plain,) = members
    if dataclasses.is_dataclass(plain):
        group = group_of(plain)  # type: ignore[arg-type]
        return Spec(key, group.type, default, group)
    kind = functools.partial(_plain_type, plain, key, notes)
    names = get_args(get_args(plain)[0]) if get_origin(plain) is dict else ()
    return Spec(key, kind, default, choices=words, names=names)


def number(key: Key) -> Any:
    """Return the type of a finite number within a key's limits."""
    limits = Field(strict=True, allow_inf_nan=False, gt=key.above, ge=key.at_least, lt=key.below, le=key.at_most)
    return Annotated[float, limits, AfterValidator(positive_zero)]


def _plain_type(plain: Any, key: Key, notes: Iterable[Any], describes: bool) -> Any:
    if plain is float:
        return number(key)
    if plain is int:
        return Annotated[int, Field(strict=True, ge=key.at_least, le=key.at_most)]
    if plain is str:
        text = next((note for note in notes if isinstance(note, Text)), Text())
        return Annotated[str, Field(strict=True, pattern=text.pattern, max_length=text.longest)]
    if get_origin(plain) is tuple:
        item: Any = number(key)
        args, note = get_args(plain), next((note for note in notes if isinstance(note, Ints)), None)
        if note is not None:
            item = Annotated[int, Field(strict=True, ge=note.least, le=note.most, multiple_of=note.step)]
        if describes:
            return tuple.__class_getitem__((item,) * len(args))
        return Annotated[tuple[item, ...], Field(strict=False, min_length=len(args), max_length=len(args))]
    if get_origin(plain) is dict:
        names, value = get_args(plain)[0], number(key)
        return dict[names, value]  # type: ignore[valid-type]
    return plain


@dataclass(frozen=True)
class NumberOrList:
    """Annotation of a key that takes one number or a list of some, within its limits, and optionally one word."""

    key: Key
    word: str | None = None
    least: int = 1
    most: int | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema for a number, or a list of them, in strict mode."""
        one: Any = number(self.key)
        numbers = Annotated[tuple[one, ...], Field(strict=False, min_length=self.least, max_length=self.most)]
        kinds: Any = Annotated[one, Tag("number")] | Annotated[numbers, Tag("list")]
        if self.word is not None:
            kinds = kinds | Annotated[Literal[self.word], Tag("word")]
        return handler.generate_schema(Annotated[kinds, Discriminator(self._shape)])

    def _shape(self, value: object) -> str:
        if isinstance(value, list | tuple):
            return "list"
        return "word" if isinstance(value, str) and self.word is not None else "number"


def option_type(values: tuple[str | bool, ...]) -> Any:
    """Return the type of a law's option."""
    if set(values) == {True, False}:
        return bool
    # a validator of its own: typing takes two lists of the same values for one, and would keep the first one's order
    return Annotated[Literal[values], BeforeValidator(functools.partial(not_a_number))]
