"""The forms of a law: every choice of its options, and the gains that have an effect under each."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

from torquebench.laws import find_law, law_names

Options = dict[str, str | bool]


def shipped() -> list[str]:
    """Return the names of the laws of this package, without those that other tests register."""
    return [name for name in law_names() if find_law(name).function.__module__.startswith("torquebench.laws.")]


def forms(law: str) -> Iterator[Options]:
    """Yield every combination of the options of a law, the defaults first."""
    options = find_law(law).options
    for values in itertools.product(*(option.values for option in options.values())):
        yield dict(zip(options, values, strict=True))


def default_form(law: str) -> Options:
    """Return the defaults of a law's options."""
    return {name: option.values[0] for name, option in find_law(law).options.items()}


def acting(law: str, options: Options) -> list[str]:
    """Return the names of the gains that have an effect under all options of a law."""
    found = find_law(law)
    return [name for name in found.gains if found.gain_problem(name, False, options) is not None]


def filled(law: str, n: int, values: dict[str, Any]) -> Any:
    """Return a law's memory for `n` joints in which the fields named in `values` hold them."""
    memory = find_law(law).new_memory(n)
    for name, array in values.items():
        if name in memory._fields:
            getattr(memory, name)[:] = array[:n]
    return memory
