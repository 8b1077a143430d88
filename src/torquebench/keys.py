"""Declaration of the keys of a kind: notes on the fields of its dataclass, and the registry of kinds of one sort."""

from __future__ import annotations

import dataclasses
import functools
import math
import types
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias, TypeVar, get_args, get_origin

from torquebench.errors import RegistryError
from torquebench.registry import Registry

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

T = TypeVar("T")
Vector: TypeAlias = float | tuple[float, ...]
"""One number for all joints, or one for each."""


class Key(NamedTuple):
    """Meaning of a key of a config: the note on a field of a dataclass, ``Annotated[float, Key("Mass", "kg")]``."""

    meaning: str
    """What it is, in words."""
    unit: str = ""
    """SI unit; ``1`` for a pure number, nothing for what is no number."""
    note: str = ""
    """Words that the reference of keys adds after the unit."""
    above: float | None = None
    """Numbers must be more than this."""
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    wanted: str = ""
    """Accepted values, in words, where the type does not say it well."""
    name: str = ""
    """The key in a config, where that is a keyword of Python."""
    end: str = "."
    """End of the sentence."""

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
    def required(self) -> bool:
        """Whether the key must be given."""
        return self.default is dataclasses.MISSING

    @property
    def is_vector(self) -> bool:
        """Whether the key takes one number for all joints, or one for each."""
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


class Units(NamedTuple):
    """Units of forces on joints and of their measurements: N and m where the joints slide."""

    torque: str
    viscous: str
    milli: str
    what: str


class Kinds(Registry[type]):
    """Kinds of one sort, of which a config names one. Calling it with a name gives the decorator of the kind's class.

    Args:
        noun: What one is called in messages.
        tag: The key by which configs name one; the attribute of a registered class that holds its name.
        defaults: Class attributes that a kind has where it does not set them.
        methods: Methods that a kind must have, with their arguments: ``describe(units)``; ``a()|b()`` for one of two.
    """

    def __init__(
        self,
        noun: str,
        tag: str = "kind",
        defaults: Mapping[str, Any] = types.MappingProxyType({}),
        methods: tuple[str, ...] = (),
    ) -> None:
        super().__init__(noun)
        self.tag, self._defaults, self._methods = tag, defaults, methods

    def __call__(self, name: str) -> Callable[[type[T]], type[T]]:
        """Return the decorator that registers a class under `name`.

        Raises:
            RegistryError: the name is taken, or is not a slug; or the class lacks a method.
        """

        def register(cls: type[T]) -> type[T]:
            missing = [
                methods.replace("|", " or ")
                for methods in self._methods
                if not any(hasattr(cls, method.partition("(")[0]) for method in methods.split("|"))
            ]
            if missing:
                raise RegistryError(
                    f"{self.noun} '{name}': class {cls.__name__} wants a method {' and '.join(missing)}"
                )
            self.register(name, cls)
            for attribute, value in {self.tag: name, **self._defaults}.items():
                if attribute == self.tag or not hasattr(cls, attribute):
                    setattr(cls, attribute, value)
            cls.tag = self.tag  # type: ignore[attr-defined]
            return cls

        return register


def values_of(item: Any) -> Mapping[str, Any]:
    """Return the values of an object's declared keys, by name."""
    cls: Any = type(item)
    return {declared.name: getattr(item, declared.attribute) for declared in declared_keys(cls)}


def altered(item: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass's object with other values, unchecked; what it has cached stays."""
    changed = object.__new__(type(item))
    changed.__dict__.update(item.__dict__, **changes)
    return changed
