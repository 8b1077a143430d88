"""How a law is registered and found: the `@controller` decorator and the registry."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from torquebench.errors import ControllerError, did_you_mean
from torquebench.laws.declare import check_conditions, declared_fields
from torquebench.laws.law import Law

SLUG = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")

_REGISTRY: dict[str, Law] = {}


def controller(
    name: str, *, gains: type[Any], memory: type[Any] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a law under `name`.

    Args:
        name: Slug by which configs call the law.
        gains: NamedTuple class; array fields are gains (annotate with `Gain`), integer fields are options
            (annotate with `Option`), a field of type `Fis` is the law's fuzzy system (annotate with `Rules`, and any
            others with `FixedRules`).
        memory: NamedTuple class of (n,) arrays kept between control instants; a field called `s` is recorded as
            the sliding variable.

    Raises:
        ControllerError: the name is taken or is not a slug, a field is not a gain, an option or a fuzzy system, or a
            gain depends on a choice that the law does not have.
    """
    if not SLUG.fullmatch(name):
        raise ControllerError(f"law name '{name}' is not a slug (lower-case letters, digits and '-', at most 64)")

    def register(function: Callable[..., None]) -> Callable[..., None]:
        if name in _REGISTRY and not _same_place(_REGISTRY[name].function, function):
            raise ControllerError(f"a law named '{name}' is already registered")
        vectors, choices, systems, fixed = declared_fields(name, gains)
        check_conditions(name, {**vectors, **systems}, choices)
        _REGISTRY[name] = Law(name, function, gains, memory, vectors, choices, systems, fixed)
        return function

    return register


def _same_place(old: Callable[..., None], new: Callable[..., None]) -> bool:
    """Whether a function replaces itself, as when a notebook's cell runs again."""
    return (old.__module__, old.__qualname__) == (new.__module__, new.__qualname__) and old.__module__ == "__main__"


def find_law(name: str) -> Law:
    """Return the registered law called `name`.

    Raises:
        ControllerError: there is none; the message names the nearest one.
    """
    if name not in _REGISTRY:
        raise ControllerError(f"unknown law '{name}'{did_you_mean(name, sorted(_REGISTRY))}")
    return _REGISTRY[name]


def law_names() -> tuple[str, ...]:
    """Names of all registered laws, sorted."""
    return tuple(sorted(_REGISTRY))
