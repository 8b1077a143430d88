"""Things of one kind by name: laws, references, metrics, figures; a decorator of each kind fills its registry."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

from torquebench.errors import RegistryError, did_you_mean

SLUG = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")
SNAKE = re.compile(r"[a-z](?:[a-z0-9_]{0,62}[a-z0-9])?")

REGISTRIES: list[Registry[Any]] = []
"""Every registry there is."""

T = TypeVar("T")


class Registry(Generic[T]):
    """Things of one kind, in the order in which they were registered.

    Args:
        kind: What one of them is called in messages, such as ``metric``.
        pattern: Form of their names.
    """

    def __init__(self, kind: str, pattern: re.Pattern[str] = SLUG) -> None:
        self.kind, self._pattern = kind, pattern
        self._things: dict[str, T] = {}
        self._makers: dict[str, Callable[..., Any]] = {}
        REGISTRIES.append(self)

    def register(self, name: str, thing: T, maker: Callable[..., Any]) -> None:
        """Add a thing.

        Args:
            name: Its name.
            thing: What is found under the name.
            maker: The function or class that was decorated; a notebook's cell that runs again replaces its own.

        Raises:
            RegistryError: the name is taken, or is not of the form that names of this kind have.
        """
        if not self._pattern.fullmatch(name):
            separator = "_" if self._pattern is SNAKE else "-"
            raise RegistryError(
                f"{self.kind} name '{name}': wanted lower-case letters, digits and '{separator}', at most 64"
            )
        if name in self._things and not _is_rerun(self._makers[name], maker):
            raise RegistryError(f"a {self.kind} named '{name}' is already registered")
        self._things[name], self._makers[name] = thing, maker

    def find(self, name: str) -> T:
        """Return the thing called `name`.

        Raises:
            RegistryError: there is none; the message names the nearest one.
        """
        if name not in self._things:
            raise RegistryError(f"unknown {self.kind} '{name}'{did_you_mean(name, self._things)}")
        return self._things[name]

    def registered_by(self, module: str) -> tuple[str, ...]:
        """Names of the things that a module, such as a plug-in file, has registered."""
        return tuple(name for name, maker in self._makers.items() if maker.__module__ == module)

    def names(self) -> tuple[str, ...]:
        """Names in the order of registration."""
        return tuple(self._things)

    def __iter__(self) -> Iterator[T]:
        return iter(self._things.values())

    def __len__(self) -> int:
        return len(self._things)

    def __contains__(self, name: object) -> bool:
        return name in self._things


def registered_by(module: str) -> tuple[str, ...]:
    """Names of all things, of whatever kind, that a module has registered."""
    return tuple(name for registry in REGISTRIES for name in registry.registered_by(module))


def _is_rerun(old: Callable[..., Any], new: Callable[..., Any]) -> bool:
    here = (old.__module__, old.__qualname__) == (new.__module__, new.__qualname__)
    return here and old.__module__ == "__main__"
