"""The definition of a fuzzy inference system: variables, rules and operators, checked when it is made."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from torquebench.errors import FuzzyError
from torquebench.fuzzy.checks import system_errors
from torquebench.fuzzy.terms import NONE, Functions, Variable
from torquebench.kernel import IntArray


class Rule(NamedTuple):
    """If input 1 is when[0] (and input 2 is when[1]) then the output is `then`."""

    when: tuple[str, ...]
    then: str


@dataclass(frozen=True)
class FuzzySystem:
    """A fuzzy inference system of one or two inputs.

    Raises:
        FuzzyError: it has no meaning; every reason at once.
    """

    name: str
    inputs: tuple[Variable, ...]
    output: Variable | Functions
    """Terms: Mamdani's method. Functions: Sugeno's, where aggregation and defuzzification play no part."""
    rules: tuple[Rule, ...]
    conjunction: str = "min"
    """AND: ``min`` (131) or ``product``."""
    aggregation: str = "max-min"
    """See `aggregation.AGGREGATIONS`."""
    defuzzification: str = "coa"
    """``coa``: centre of the area under the aggregated set (136). ``cog``: centre of gravity of the rules' sets, each
    counted on its own (135); how the aggregation joins the rules then plays no part."""

    def __post_init__(self) -> None:
        mistakes = system_errors(self)
        if mistakes:
            raise FuzzyError(self.name, mistakes)

    @cached_property
    def table(self) -> IntArray:
        """Index of each rule's consequent, (n1, n2) or (n1,); -1 where there is no rule."""
        table = np.full([len(variable.terms) for variable in self.inputs], -1)
        for rule in self.rules:
            place = tuple(v.names.index(word) for v, word in zip(self.inputs, rule.when, strict=True))
            table[place] = self.output.names.index(rule.then)
        return table


def rules_of_table(inputs: Sequence[Sequence[str]], rows: Sequence[Sequence[str]]) -> tuple[Rule, ...]:
    """Return the rules of a table.

    Args:
        inputs: Names of the terms of each input.
        rows: Consequents: a row for each term of input 1 with a column for each of input 2; for one input a single
            row; ``none`` where there is no rule.

    Raises:
        ValueError: the table is not of that size.
    """
    sizes = [len(names) for names in inputs]
    if len(rows) != (sizes[0] if len(inputs) == 2 else 1) or any(len(row) != sizes[-1] for row in rows):
        raise ValueError(f"the table is not one of {' by '.join(map(str, sizes))} consequents")
    cells = zip(itertools.product(*inputs), itertools.chain.from_iterable(rows), strict=True)
    return tuple(Rule(when, then) for when, then in cells if then != NONE)
