"""The definition of a fuzzy inference system: variables, rules and operators, checked when it is made.

The aggregation is how the rules' consequents become one fuzzy set. The paper lists seven names; each is read as (over
the rules) - (activation with consequent). With w_r the activation of rule r, mu_r(u) the membership of its consequent,
and r over **all** rules of the base:

| name | set mu_U(u) |
|---|---|
| `max-min` (133) | max_r min(w_r, mu_r) |
| `sum-min` (134) | sum_r min(w_r, mu_r), not limited to 1 |
| `max-bounded-product` | max_r max(0, w_r + mu_r - 1) |
| `max-drastic-product` | max_r (w_r where mu_r = 1; mu_r where w_r = 1; else 0) |
| `max-bounded-sum` | max_r min(1, w_r + mu_r) |
| `max-algebraic-sum` | max_r (w_r + mu_r - w_r mu_r) |
| `min-max` | min_r max(1 - w_r, mu_r) |

Only the first two have an equation in the paper. In the two sums a rule that does not fire still contributes its whole
consequent. Read without the 1 -, `min-max` is zero everywhere as soon as two consequents are disjoint; as written it is
the dual of `max-min`, "not w or mu". The drastic product of a triangle is a spike at its peak unless w = 1, so it
exists on points only, and the peaks must be among them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.errors import ControllerError, Finding, FuzzyError, did_you_mean
from torquebench.fuzzy.terms import ANY, NONE, SAME, Functions, Variable
from torquebench.kernel import Array, IntArray

CONJUNCTIONS = ("min", "product")
DEFUZZIFICATIONS = ("coa", "cog")
ONE = 1.0 - 1e-9
"""A degree from here on counts as 1 in the drastic product: peaks on a grid of output points are off by rounding."""

POINTS = 361
"""Points of the output's universe, evenly spaced from the lowest foot to the highest, by default."""

Combine: TypeAlias = Callable[[Array, Array], Array]


class Aggregation(NamedTuple):
    """One of the seven."""

    over_rules: np.ufunc
    """How the rules' sets are joined."""
    combine: Combine
    """Activation w and membership mu of the consequent -> membership of the rule's set; never falls as w grows, except
    with `min-max`, where it never rises."""


def _drastic(w: Array, mu: Array) -> Array:
    return np.where(mu >= ONE, w, np.where(w >= ONE, mu, 0.0))


AGGREGATIONS: dict[str, Aggregation] = {
    "max-min": Aggregation(np.fmax, np.fmin),
    "sum-min": Aggregation(np.add, np.fmin),
    "max-bounded-product": Aggregation(np.fmax, lambda w, mu: np.fmax(0.0, w + mu - 1.0)),
    "max-drastic-product": Aggregation(np.fmax, _drastic),
    "max-bounded-sum": Aggregation(np.fmax, lambda w, mu: np.fmin(1.0, w + mu)),
    "max-algebraic-sum": Aggregation(np.fmax, lambda w, mu: w + mu - w * mu),
    "min-max": Aggregation(np.fmin, lambda w, mu: np.fmax(1.0 - w, mu)),
}


class Rule(NamedTuple):
    """If input 1 is when[0] (and input 2 is when[1]) then the output is `then`.

    An input for which `ANY` stands, or for which nothing is said, is left open.
    """

    when: tuple[str, ...]
    then: str
    either: bool = False
    """Whether it is enough that one of the two holds (OR)."""

    @property
    def condition(self) -> str:
        """Its terms in words."""
        return f" {'or' if self.either else 'and'} ".join(self.when)

    def fires(self, inputs: Sequence[Variable]) -> bool:
        """Whether it does so anywhere in the ranges of the inputs."""
        reached = [variable.reaches(name) for variable, name in zip(inputs, self.when, strict=True)]
        return any(reached) if self.either else all(reached)


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
    """AND: ``min`` (131) or ``product``; OR is its dual, the maximum or a + b - a b."""
    aggregation: str = "max-min"
    """See `AGGREGATIONS`."""
    defuzzification: str = "coa"
    """``coa``: centre of the area under the aggregated set (136). ``cog``: centre of gravity of the rules' sets, each
    counted on its own (135); how the aggregation joins the rules then plays no part."""

    def __post_init__(self) -> None:
        open_ = (ANY,) * len(self.inputs)
        rules = (rule._replace(when=rule.when + open_[len(rule.when) :]) if rule.when else rule for rule in self.rules)
        object.__setattr__(self, "rules", tuple(rules))
        errors = self.errors()
        if errors:
            raise FuzzyError(self.name, errors)

    def errors(self) -> list[Finding]:
        """Return why the system has no meaning; nothing if it has one."""
        findings: list[Finding] = []
        if len(self.inputs) not in (1, 2):
            findings.append(Finding("inputs", "error", ("inputs",), f"got {len(self.inputs)} inputs, wanted 1 or 2"))
        for key, value, valid in (
            ("conjunction", self.conjunction, CONJUNCTIONS),
            ("aggregation", self.aggregation, tuple(AGGREGATIONS)),
            ("defuzzification", self.defuzzification, DEFUZZIFICATIONS),
        ):
            if value not in valid:
                message = f"got '{value}', wanted one of {', '.join(valid)}{did_you_mean(value, valid)}"
                findings.append(Finding("operator", "error", (key,), message))
        for i, variable in enumerate(self.inputs):
            findings += [error._replace(where=("inputs", i, *error.where)) for error in variable.errors()]
        terms = self.output.errors() if isinstance(self.output, Variable) else self.output.errors(len(self.inputs))
        findings += [error._replace(where=("output", *error.where)) for error in terms]
        return findings or self._rule_errors()

    def _rule_errors(self) -> list[Finding]:
        findings: list[Finding] = []
        said: dict[tuple[tuple[str, ...], bool], str] = {}
        for k, rule in enumerate(self.rules):
            unknown = []
            if len(rule.when) != len(self.inputs):
                unknown.append(
                    f"names {len(rule.when)} terms after 'if', wanted one for each of {len(self.inputs)} inputs"
                )
            if rule.either and (len(self.inputs) != 2 or ANY in rule.when):
                unknown.append("'or' wants a term of each of two inputs")
            for i, (word, variable) in enumerate(zip(rule.when, self.inputs, strict=False)):
                if word not in (*variable.names, ANY):
                    names = (*variable.names, ANY)
                    unknown.append(f"unknown term {word!r} of input {i + 1}{did_you_mean(word, names)}")
            if rule.then not in self.output.names:
                unknown.append(f"unknown consequent {rule.then!r}{did_you_mean(rule.then, self.output.names)}")
            findings += [Finding("rule", "error", ("rules", k), message) for message in unknown]
            condition = rule.when, rule.either
            if said.setdefault(condition, rule.then) != rule.then:
                both = f"if {rule.condition} then both {said[condition]} and {rule.then}"
                message = f"contradicts an earlier rule: {both}; remove one of them"
                findings.append(Finding("contradiction", "error", ("rules", k), message))
        if not self.rules:
            findings.append(Finding("no-rule", "error", ("rules",), "there is no rule, wanted at least one"))
        elif not findings and not any(rule.fires(self.inputs) for rule in self.rules):
            message = (
                "no rule ever fires: each names a term outside its input's range; widen the ranges or move the terms"
            )
            findings.append(Finding("no-rule", "error", ("rules",), message))
        if self.aggregation == "max-drastic-product" and isinstance(self.output, Variable):
            findings += _peaks_off_grid(self.output)
        return findings

    @cached_property
    def is_open(self) -> tuple[bool, ...]:
        """Whether some rule leaves an input open, for each input."""
        return tuple(any(rule.when[i] == ANY for rule in self.rules) for i in range(len(self.inputs)))

    @cached_property
    def columns(self) -> tuple[tuple[str, ...], ...]:
        """Names of the terms along each axis of the rule table, with `ANY` as the last where a rule has it."""
        return tuple(
            (*v.names, ANY) if is_open else v.names for v, is_open in zip(self.inputs, self.is_open, strict=True)
        )

    @cached_property
    def table(self) -> IntArray:
        """Index of each rule's consequent, (n1, n2) or (n1,), axes as `columns`; -1 where there is no rule."""
        return self._table(False)

    @cached_property
    def either_table(self) -> IntArray:
        """The same of the rules with OR; of no size where there are none."""
        has_any = any(rule.either for rule in self.rules)
        return self._table(True) if has_any else np.zeros((0,) * len(self.inputs), dtype=np.int64)

    def _table(self, either: bool) -> IntArray:
        table = np.full([len(names) for names in self.columns], -1)
        for rule in self.rules:
            if rule.either == either:
                place = tuple(names.index(word) for names, word in zip(self.columns, rule.when, strict=True))
                table[place] = self.output.names.index(rule.then)
        return table

    def covers(self, place: Sequence[int | None]) -> bool:
        """Whether some rule fires where the inputs are the terms of these numbers, None for none of them."""
        words = [None if k is None else v.names[k] for v, k in zip(self.inputs, place, strict=True)]
        for rule in self.rules:
            holds = [term in (ANY, word) for term, word in zip(rule.when, words, strict=True)]
            if any(holds) if rule.either else all(holds):
                return True
        return False


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


def _peaks_off_grid(output: Variable) -> list[Finding]:
    low, high = output.reach
    u = np.linspace(low, high, POINTS)
    findings = []
    for term in output.terms:
        if not np.any((u >= term.b - SAME * output.half) & (u <= term.c + SAME * output.half)):
            points = f"two of the {POINTS} points from {low:g} to {high:g} on which the drastic product is taken"
            move = f"move it to {u[np.argmin(np.abs(u - term.peak))]:.10g}, or choose another aggregation"
            message = f"its peak, {term.peak:g}, lies between {points}: {move}"
            findings.append(Finding("off-grid", "error", ("output", "terms", term.name), message))
    return findings


DEFAULT = "pd-49"
_SEVEN = ("NB", "NM", "NS", "Z", "PS", "PM", "PB")
_ONE_INPUT = "s-7"
_TERMS = {"pd-49": _SEVEN, "pd-25": ("NB", "NS", "Z", "PS", "PB"), "pd-9": ("N", "Z", "P"), _ONE_INPUT: _SEVEN}
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
    if name == _ONE_INPUT:
        return FuzzySystem(name, (variable,), variable, tuple(Rule((term,), term) for term in names))
    k = np.arange(len(names))
    rows = np.array(names)[np.clip(k[:, None] + k - last // 2, 0, last)].tolist()
    return FuzzySystem(name, (variable, variable), variable, rules_of_table([names, names], rows))
