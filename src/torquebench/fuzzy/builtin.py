"""Fuzzy systems that ship with the package: PD-like tables of 49, 25 and 9 rules, and seven rules of one input."""

from __future__ import annotations

from functools import cache

from torquebench.errors import ControllerError, did_you_mean
from torquebench.fuzzy.system import FuzzySystem, Rule
from torquebench.fuzzy.terms import Variable

DEFAULT = "pd-49"
_TERMS = {
    "pd-49": ("NB", "NM", "NS", "Z", "PS", "PM", "PB"),
    "pd-25": ("NB", "NS", "Z", "PS", "PB"),
    "pd-9": ("N", "Z", "P"),
    "s-7": ("NB", "NM", "NS", "Z", "PS", "PM", "PB"),
}
_ONE_INPUT = frozenset({"s-7"})
BUILTIN = tuple(_TERMS)
"""Names of the built-in systems."""


@cache
def builtin_system(name: str) -> FuzzySystem:
    """Return a built-in system: n triangles evenly spaced on [-1, 1], rule (i, j) -> i + j within the terms.

    The same triangles serve both inputs and the output; those at the ends of the output are whole, so that it spans
    [-4/3, 4/3] with 49 rules and reaches -1 and 1. max-min, centre of area. ``s-7`` has one input and the rules i -> i,
    which are those of ``pd-49`` where the second input is zero.

    Raises:
        ControllerError: there is no system of that name.
    """
    if name not in _TERMS:
        raise ControllerError(f"unknown fuzzy system '{name}'{did_you_mean(name, BUILTIN)}")
    names = _TERMS[name]
    last = len(names) - 1
    variable = Variable.of({term: (2 * k - last) / last for k, term in enumerate(names)})
    if name in _ONE_INPUT:
        return FuzzySystem(name, (variable,), variable, tuple(Rule((term,), term) for term in names))
    middle = last // 2
    rules = tuple(
        Rule((a, b), names[min(max(i + j - middle, 0), last)]) for i, a in enumerate(names) for j, b in enumerate(names)
    )
    return FuzzySystem(name, (variable, variable), variable, rules)
