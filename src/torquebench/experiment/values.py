"""Plain values of a config: numbers, vectors, text and words, each checked by its type, and told in words if wrong."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, TypeAdapter, ValidationError

from torquebench.experiment.source import Document
from torquebench.experiment.units import without_unit
from torquebench.experiment.words import SLUG_IN_WORDS, a_value, choice, is_number, number_hint, shown, unit
from torquebench.experiment.yaml_tree import BROKEN, KeyPath
from torquebench.keys import Key

if TYPE_CHECKING:
    from torquebench.experiment.groups import Group, OneOf

Slug: TypeAlias = Annotated[str, Field(pattern=r"^[a-z0-9]([a-z0-9-]{0,62}[a-z0-9])?$")]
Count: TypeAlias = Annotated[int, Field(gt=0)]
T = TypeVar("T")
_STRICT = ConfigDict(strict=True, allow_inf_nan=False)
_SHAPES = frozenset(("too_short", "too_long", "tuple_type"))
"""Errors that say of a list that it is none, or has not so many items."""


def from_json(kind: type[T], content: bytes) -> T:
    """Return what JSON says as an object of a dataclass.

    Raises:
        ValueError: it is no JSON, or says something else.
    """
    return TypeAdapter(kind).validate_json(content, strict=True)


class Here(NamedTuple):
    """A place in a config that is being read."""

    document: Document
    """Receives the mistakes."""
    top: Group
    """All sections, among which the home of a misplaced key is looked for."""
    path: KeyPath = ()
    chosen: tuple[tuple[OneOf, str, int], ...] = ()
    """The kinds chosen on the way: of which sort, the kind's name, and how long the path to it is."""

    def add(self, text: str = "", below: KeyPath = (), **parts: Any) -> None:
        """Record a mistake here, or below; other arguments as of `Document.add`."""
        self.document.add((*self.path, *below), text, **parts)

    def below(self, *parts: str | int) -> Here:
        """Return a place below."""
        return self._replace(path=(*self.path, *parts))

    def read(self, node: Node, key: str, raw: Any) -> Any:
        """Return what raw values at a key below mean, where a node may stand; BROKEN where they are wrong."""
        if raw is None:
            self.add("nothing is given", (key,), wanted=node.wanted)
        return BROKEN if raw is None or raw is BROKEN else node.read(raw, self.below(key))


class Node(ABC):
    """Rule for the values that may stand at a key, and for the objects that they become."""

    wanted = "a value"
    """Words for the wanted value, shown where there is none or one of another shape."""
    is_vector = False
    """Whether it is one number for all joints, or one for each."""

    @abstractmethod
    def read(self, raw: Any, here: Here) -> Any:
        """Return what raw values mean; BROKEN, or that inside, where they are wrong, with every mistake recorded."""

    @abstractmethod
    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""

    def groups(self) -> Iterable[Group]:
        """Return the groups of keys that may stand there."""
        return ()


class Anything(Node):
    """Any value, as it is."""

    def read(self, raw: Any, here: Here) -> Any:
        """Return the value."""
        return raw

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Any


class AnyOf(Node):
    """Accepts what any of several nodes accepts, where it is not known which one stands there.

    Args:
        nodes: These nodes.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self._nodes = tuple(nodes)
        self.wanted, self.is_vector = nodes[0].wanted, all(node.is_vector for node in nodes)

    def read(self, raw: Any, here: Here) -> Any:
        """Return what the first node that accepts it makes of it; if none does, the mistakes are those of the first."""
        found = here.document.found
        before, first = len(found), list[Any]()
        for node in self._nodes:
            value = node.read(raw, here)
            if len(found) == before:
                return value
            first, found[before:] = first or found[before:], []
        found += first
        return BROKEN

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Any


class Word(Node):
    """One of some words, or of true and false.

    Args:
        words: Those that are accepted.
        note: Ends the message about another word.
    """

    def __init__(self, words: tuple[str | bool, ...], note: str = "") -> None:
        self.words, self._note = words, note
        self.wanted = choice("", words)["wanted"]

    def read(self, raw: Any, here: Here) -> Any:
        """Return the word."""
        if any(raw == word and type(raw) is type(word) for word in self.words):  # 1 == True
            return raw
        parts: dict[str, Any] = choice(raw, self.words)
        if self._note and isinstance(raw, str):
            parts["note"] = self._note
        here.add(got=shown(raw), **parts)
        return BROKEN

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Literal[self.words]


class Value(Node):
    """A value that pydantic checks.

    Args:
        key: What it means.
        kind: Its type for pydantic.
        word: The word that is accepted besides numbers, if any.
        is_vector: Whether it is one number for all joints, or one for each.
    """

    def __init__(self, key: Key, kind: Any, word: str = "", is_vector: bool = False) -> None:
        self._key, self._kind, self._word, self.is_vector = key, kind, word, is_vector
        self.wanted = a_value(key)

    @cached_property
    def _adapter(self) -> TypeAdapter[Any]:
        return TypeAdapter(self._kind, config=_STRICT)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return self._kind

    def read(self, raw: Any, here: Here) -> Any:
        """Return the value, lists as tuples."""
        try:
            return self._adapter.validate_python(without_unit(raw, self._key.unit))
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                path = tuple(part for part in detail["loc"] if isinstance(part, int))
                if detail["input"] is not BROKEN and not _is_echo(detail) and not here.document.full:
                    here.add(below=path, got=shown(detail["input"]), **self._explained(detail, inner=bool(path)))
            return BROKEN

    def _explained(self, error: Mapping[str, Any], inner: bool) -> dict[str, str]:
        """Return one of pydantic's errors, of the whole value or of an item inside, as parts of a `Problem`."""
        kind, value, limits = error["type"], error["input"], error.get("ctx", {})
        if self._key.wanted and (kind in _SHAPES or (kind == "float_type" and not inner)):
            return {"wanted": self._key.wanted}
        its_unit, hint = unit(self._key), number_hint(value, self._key.unit)
        number = f"a number{its_unit}"
        if self.is_vector and not inner:
            number = f"{self._word}, {number}" if self._word else number
            number += ", or a list with one for each joint"
        if kind == "literal_error":
            parts = choice(value, (self._word,))
            return {"note": hint * (not parts["nearest"]), **parts, "wanted": number}
        wanted, note = {
            "float_type": (number, hint),
            "int_type": ("a whole number", hint),
            "int_from_float": ("a whole number", ""),
            "finite_number": (f"a finite number{its_unit}", ""),
            "greater_than": (f"more than {_limit(limits.get('gt'))}{its_unit}", ""),
            "greater_than_equal": (f"at least {_limit(limits.get('ge'))}{its_unit}", ""),
            "less_than": (f"less than {_limit(limits.get('lt'))}{its_unit}", ""),
            "less_than_equal": (f"at most {_limit(limits.get('le'))}{its_unit}", ""),
            "multiple_of": ("an even number", ""),
            "string_type": ("a name" if inner else "text", "put it in quotes" * (is_number(value) and not inner)),
            "string_pattern_mismatch": (f"a slug: {SLUG_IN_WORDS}", ""),
            "string_too_long": (f"at most {limits.get('max_length')} characters", ""),
            "too_short": ("at least one number", ""),
        }.get(kind, (str(error["msg"]), ""))
        if kind == "less_than" and limits.get("lt") == 1:
            percent = value if value < 100 else 30
            note = f"it is a fraction: {percent / 100:g} for {percent:g} %"
        return {"wanted": wanted, "note": note}


def _is_echo(detail: Mapping[str, Any]) -> bool:
    """Whether pydantic calls a list too short only because its items were refused, each of which it tells too."""
    return detail["type"] == "too_short" and bool(len(detail["input"]) >= detail["ctx"]["min_length"])


def _limit(x: Any) -> str:
    return f"{x:.17g}" if isinstance(x, float) else f"{x}"


def number(key: Key) -> Any:
    """Return the type of a finite number within a key's limits."""
    limits = Field(gt=key.above, ge=key.at_least, lt=key.below, le=key.at_most)
    return Annotated[float, limits, AfterValidator(_positive_zero)]


def _positive_zero(x: float) -> float:
    """Return x, with 0.0 for -0.0: equal experiments must not differ in their text."""
    return x + 0.0


def some(item: Any, least: int, most: int | None = None) -> Any:
    """Return the type of a list of items, which becomes a tuple."""
    return Annotated[tuple[item, ...], Field(strict=False, min_length=least, max_length=most)]


def one_or_some(one: Any, more: Any, word: str = "") -> Any:
    """Return the type of a value that is one thing, a list of more, or a word.

    Args:
        one: Type of the one.
        more: Type of the list.
        word: The word, if any.
    """

    def shape(value: object) -> str:
        return "list" if isinstance(value, list | tuple) else "word" if word and isinstance(value, str) else "one"

    kinds: Any = Annotated[one, Tag("one")] | Annotated[more, Tag("list")]
    if word:
        kinds = kinds | Annotated[Literal[word], Tag("word")]
    return Annotated[kinds, Discriminator(shape)]


def vector(key: Key, word: str = "") -> Value:
    """Return the node of one number for all joints, or one for each; or a word, if any is given."""
    one = number(key)
    return Value(key, one_or_some(one, some(one, 1), word), word, is_vector=True)
