"""Kinds that configs name: how one is registered and found, and how its dataclass declares its keys."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Generic, NamedTuple, TypeAlias, TypeVar, get_args, get_origin

from torquebench.errors import ControllerError, did_you_mean

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

T = TypeVar("T")
SLUG = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")
"""Names that configs may use: lower-case letters, digits and ``-``."""
Vector: TypeAlias = float | tuple[float, ...]
"""One number for all joints, or one for each."""


class Key(NamedTuple):
    """What a key of a config means: the note on a field of a dataclass, ``Annotated[float, Key("Mass", "kg")]``."""

    meaning: str
    """What it is, in words."""
    unit: str = ""
    """SI unit; ``1`` for a pure number, nothing for what is no number."""
    note: str = ""
    """What the reference of keys says after the unit."""
    above: float | None = None
    """Numbers must be more than this."""
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    wanted: str = ""
    """What is accepted, in words, where the type does not say it well."""
    name: str = ""
    """The key in a config, where that is a keyword of Python."""
    end: str = "."
    """What the sentence ends with."""

    @property
    def text(self) -> str:
        """Meaning, unit and note in one sentence, as the reference of keys has it."""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.meaning}{unit}{self.note}{self.end}"

    def fault(self, x: float) -> str | None:
        """Return what a number should have been, or None for one within the limits."""
        if not math.isfinite(x):
            return "a finite number"
        if self.above is not None and x <= self.above:
            return f"more than {self.above:g}"
        if self.at_least is not None and x < self.at_least:
            return f"at least {self.at_least:g}"
        if self.below is not None and x >= self.below:
            return f"less than {self.below:g}"
        if self.at_most is not None and x > self.at_most:
            return f"at most {self.at_most:g}"
        return None


class Declared(NamedTuple):
    """One key of a kind."""

    name: str
    """The key in a config."""
    attribute: str
    """The dataclass's field."""
    type: Any
    """Annotation without the key; other notes on it stay."""
    key: Key
    default: Any
    """``dataclasses.MISSING`` for a required key."""

    @property
    def is_vector(self) -> bool:
        """Whether it takes one number for all joints, or one for each."""
        return tuple[float, ...] in get_args(self.type)


@functools.cache
def declared_keys(cls: Any) -> tuple[Declared, ...]:
    """Return the keys that a dataclass declares, in order; fields without a `Key` are none of a config's."""
    from typing import get_type_hints

    hints = get_type_hints(cls, include_extras=True)
    found = []
    for field in dataclasses.fields(cls):
        hint = hints[field.name]
        notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        key = next((note for note in notes if isinstance(note, Key)), None)
        if key is None:
            continue
        others = tuple(note for note in notes if note is not key)
        plain: Any = get_args(hint)[0]
        factory = field.default_factory
        default = factory() if factory is not dataclasses.MISSING else field.default
        found.append(
            Declared(key.name or field.name, field.name, Annotated[(plain, *others)] if others else plain, key, default)
        )
    return tuple(found)


def check_numbers(item: Any) -> None:
    """Refuse numbers of an object made in Python that its keys do not allow; for ``__post_init__``.

    Raises:
        ValueError: a number is out of its key's range or not finite.
    """
    cls: Any = type(item)
    for name, attribute, _, key, _ in declared_keys(cls):
        value = getattr(item, attribute)
        for x in value if isinstance(value, tuple) else (value,):
            wanted = key.fault(x) if isinstance(x, int | float) else None
            if wanted is not None:
                raise ValueError(f"{type(item).__name__.lower()}: {name} is {value}, wanted {wanted}")


def as_vector(value: Any, n: int) -> npt.NDArray[np.float64]:
    """Return a config's vector with one entry for each joint.

    Args:
        value: One number for all joints, or `n` numbers.
        n: Number of joints.

    Returns:
        Array (n,), in the unit of `value`.
    """
    import numpy as np

    vector = np.empty(n)
    vector[:] = value
    return vector


def in_words(vector: Any) -> str:
    """Return a number, or several, as text."""
    return " ".join(f"{x:g}" for x in (vector if isinstance(vector, tuple) else (vector,)))


class Registry(Generic[T]):
    """Named kinds of one sort. Calling it with a name gives the decorator that registers a class under it.

    Args:
        noun: What its items are called in messages.
        tag: Attribute of a registered item that holds its name; the key by which configs give it.
        error: Class of the errors it raises.
    """

    def __init__(self, noun: str, tag: str = "kind", error: type[Exception] = ControllerError) -> None:
        self.noun, self.tag, self._error = noun, tag, error
        self._items: dict[str, T] = {}

    def __call__(self, name: str) -> Callable[[T], T]:
        """Return the decorator that registers a class under `name`.

        Raises:
            ControllerError: the name is taken, or is not a slug.
        """

        def register(item: T) -> T:
            return self.register(name, item)

        return register

    def register(self, name: str, item: T) -> T:
        """Register an item under a name, which becomes its attribute; return the item.

        Raises:
            ControllerError: the name is taken, or is not a slug.
        """
        if not SLUG.fullmatch(name):
            raise self._error(
                f"{self.noun} name '{name}' is not a slug (lower-case letters, digits and '-', at most 64)"
            )
        if name in self._items and not _same_place(self._items[name], item):
            raise self._error(f"a {self.noun} named '{name}' is already registered")
        if isinstance(item, type):
            setattr(item, self.tag, name)
            item.tag = self.tag  # type: ignore[attr-defined]
        self._items[name] = item
        return item

    def find(self, name: str) -> T:
        """Return what is registered under a name.

        Raises:
            ControllerError: nothing is; the message names the nearest one.
        """
        if name not in self._items:
            raise self._error(f"unknown {self.noun} '{name}'{did_you_mean(name, sorted(self._items))}")
        return self._items[name]

    def names(self) -> tuple[str, ...]:
        """Names of all items, in the order in which they were registered."""
        return tuple(self._items)

    def items(self) -> tuple[tuple[str, T], ...]:
        """Names and items, in the order in which they were registered."""
        return tuple(self._items.items())

    def values(self) -> tuple[T, ...]:
        """All items, in the order in which they were registered."""
        return tuple(self._items.values())

    __getitem__ = find

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


def _same_place(old: Any, new: Any) -> bool:
    """Whether something replaces itself, as when a notebook's cell runs again."""
    places = [(getattr(x, "__module__", None), getattr(x, "__qualname__", None)) for x in (old, new)]
    return places[0] == places[1] and places[0][0] == "__main__"


def values_of(item: Any) -> Mapping[str, Any]:
    """Return the values of an object's declared keys, by name."""
    cls: Any = type(item)
    return {declared.name: getattr(item, declared.attribute) for declared in declared_keys(cls)}


def altered(item: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass's object with other values, unchecked; what it has cached stays."""
    changed = object.__new__(type(item))
    changed.__dict__.update(item.__dict__, **changes)
    return changed
