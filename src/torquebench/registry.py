"""Things of one kind by name: laws, references, metrics, figures; a decorator of each kind fills its registry."""

from __future__ import annotations

import ast
import contextlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

from torquebench.errors import RegistryError, TorquebenchError, did_you_mean
from torquebench.syntax import parse_python

SLUG = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")
SNAKE = re.compile(r"[a-z](?:[a-z0-9_]{0,62}[a-z0-9])?")

REGISTRIES: list[Registry[Any]] = []
"""Every registry there is."""

T = TypeVar("T")


def docstring(thing: Any) -> str:
    """Return the docstring of a function or class without its indentation, as written in its source.

    ``python -OO`` removes docstrings; what is shown to users is then read from the source.
    """
    if sys.flags.optimize >= 2:
        with contextlib.suppress(OSError, TypeError, SyntaxError):
            node = parse_python(textwrap.dedent(inspect.getsource(thing))).body[0]
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                return ast.get_docstring(node) or ""
    return inspect.cleandoc(thing.__doc__ or "")


class Registry(Generic[T]):
    """Things of one kind, in the order in which they were registered.

    Args:
        noun: What one of them is called in messages, such as ``metric``.
        pattern: Form of their names.
        error: Class of the errors it raises.
    """

    def __init__(
        self, noun: str, pattern: re.Pattern[str] = SLUG, error: type[TorquebenchError] = RegistryError
    ) -> None:
        self.noun, self._pattern, self._error = noun, pattern, error
        self._items: dict[str, T] = {}
        self._makers: dict[str, Any] = {}
        REGISTRIES.append(self)

    def register(self, name: str, item: T, maker: Any = None) -> T:
        """Add an item under a name and return it.

        Args:
            name: Its name.
            item: What is found under the name.
            maker: The function or class that was decorated; the item itself by default. A notebook's cell that runs
                again replaces its own.

        Raises:
            RegistryError: the name is taken, or is not of the form that names of this kind have.
        """
        if not self._pattern.fullmatch(name):
            separator = "_" if self._pattern is SNAKE else "-"
            raise self._error(
                f"{self.noun} name '{name}': wanted lower-case letters, digits and '{separator}', at most 64"
            )
        maker = item if maker is None else maker
        if name in self._items and not _is_rerun(self._makers[name], maker):
            raise self._error(f"a {self.noun} named '{name}' is already registered")
        self._items[name], self._makers[name] = item, maker
        return item

    def find(self, name: str) -> T:
        """Return the item called `name`.

        Raises:
            RegistryError: there is none; the message names the nearest one.
        """
        if name not in self._items:
            raise self._error(f"unknown {self.noun} '{name}'{did_you_mean(name, self._items)}")
        return self._items[name]

    def names(self) -> tuple[str, ...]:
        """Names of all items, in the order in which they were registered."""
        return tuple(self._items)

    def values(self) -> tuple[T, ...]:
        """All items, in the order in which they were registered."""
        return tuple(self._items.values())

    def items(self) -> tuple[tuple[str, T], ...]:
        """Names and items, in the order in which they were registered."""
        return tuple(self._items.items())

    def registered_by(self, module: str) -> tuple[str, ...]:
        """Names of the items that a module, such as a plug-in file, has registered."""
        return tuple(name for name, maker in self._makers.items() if maker.__module__ == module)

    def forget(self, module: str) -> None:
        """Remove the items that a module has registered."""
        for name in self.registered_by(module):
            del self._makers[name]
            self._items.pop(name, None)

    __getitem__ = find

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __contains__(self, name: object) -> bool:
        return name in self._items


def registered_by(module: str) -> tuple[str, ...]:
    """Names of all items, of whatever kind, that a module has registered."""
    return tuple(name for registry in REGISTRIES for name in registry.registered_by(module))


@contextlib.contextmanager
def registering_again(module: str) -> Iterator[None]:
    """Let a module that is run again register its items again; if it fails, those of before are there again."""
    before = [(registry, dict(registry._items), dict(registry._makers)) for registry in REGISTRIES]
    for registry in REGISTRIES:
        registry.forget(module)
    try:
        yield
    except BaseException:  # Ctrl-C, and a file that calls exit, leave nothing half registered either
        for registry, items, makers in before:
            registry._items, registry._makers = items, makers
        raise


@contextlib.contextmanager
def restored() -> Iterator[None]:
    """Forget, at the end, what was registered meanwhile by anyone but this package, which registers some kinds late."""
    before = [(registry, dict(registry._items), dict(registry._makers)) for registry in REGISTRIES]
    try:
        yield
    finally:
        for registry, items, makers in before:
            late = {name for name, maker in registry._makers.items() if maker.__module__.startswith("torquebench.")}
            registry._items = items | {name: registry._items[name] for name in late if name in registry._items}
            registry._makers = makers | {name: registry._makers[name] for name in late}


def _is_rerun(old: Any, new: Any) -> bool:
    here = (old.__module__, old.__qualname__) == (new.__module__, new.__qualname__)
    return here and old.__module__ == "__main__"
