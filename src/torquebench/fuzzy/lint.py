"""Lint of a rule base: continuous, complete, consistent, as the paper asks, and what else is likely a slip.

What leaves a system without meaning is an error, raised when the system is made (`FuzzySystem.errors`); the
warnings here are about a system that works, but perhaps not as intended.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from torquebench.errors import Finding
from torquebench.fuzzy.fis import TABLE
from torquebench.fuzzy.prepare import Prepared
from torquebench.fuzzy.system import POINTS, FuzzySystem
from torquebench.fuzzy.terms import ANY, SAME, Variable

WEAK = 0.5
"""An output that reaches less than this part of its range is worth a warning."""
THIN = 6
"""A term of fewer steps of the output's universe is worth a warning: its area comes out wrong."""
_GRID = np.linspace(-1.0, 1.0, 61)  # has both ends, the origin, and the peaks of 7, 5 and 3 even terms
_ODD = 1e-9  # asymmetry above rounding


Place = tuple[str | int, ...]


def lint(prepared: Prepared, is_law: bool = True) -> tuple[Finding, ...]:
    """Return the warnings about a system, in the order of its definition.

    Args:
        prepared: The system.
        is_law: Whether its output acts on a joint, so that it has to be odd about the origin, and to reach its range.
    """
    system = prepared.system
    findings = [*_terms(system), *_thin_terms(prepared), *_rules(system), *(_outputs(prepared) if is_law else ())]
    return tuple(Finding(code, "warning", where, message) for code, where, message in findings)


def _terms(system: FuzzySystem) -> Iterator[tuple[str, Place, str]]:
    for i, variable in enumerate(system.inputs):
        where = ("inputs", i, "terms")
        outside = "lies outside the range, so no rule with it ever fires: move it, or widen the range"
        yield from (("dead-term", (*where, name), outside) for name in variable.names if not variable.reaches(name))
        others = [[None] if k == i else range(len(v.terms)) for k, v in enumerate(system.inputs)]
        matters = not all(map(system.covers, itertools.product(*others)))
        for low, high in gaps(variable) if matters else ():
            nothing = f"no term covers {low:g} to {high:g}; there no rule fires and the output is 0"
            yield "gap", where, f"{nothing}: widen the terms beside it"
    used = {rule.then for rule in system.rules}
    key = "terms" if isinstance(system.output, Variable) else "functions"
    for name in system.output.names:
        if name not in used:
            yield "dead-term", ("output", key, name), "no rule has this consequent: use it or remove it"


def _thin_terms(prepared: Prepared) -> Iterator[tuple[str, Place, str]]:
    output = prepared.system.output
    if prepared.fis.method != TABLE or not isinstance(output, Variable):
        return
    low, high = output.reach
    for term in output.terms:
        if term.base < THIN * (high - low) / (POINTS - 1):
            steps = f"{THIN} of the {POINTS - 1} steps from {low:g} to {high:g} in which the output is computed"
            yield "thin-term", ("output", "terms", term.name), f"is narrower than {steps}: widen it"


def gaps(variable: Variable) -> list[tuple[float, float]]:
    """Return the stretches of an input's range in which every term has degree 0, in its own units."""
    uncovered, covered = [], variable.low
    for term in sorted(variable.terms, key=lambda term: term.a):
        if term.a > covered + SAME * variable.half and covered < variable.high:
            uncovered.append((covered, min(term.a, variable.high)))
        covered = max(covered, term.d)
    if covered < variable.high - SAME * variable.half:
        uncovered.append((covered, variable.high))
    return uncovered


def _rules(system: FuzzySystem) -> Iterator[tuple[str, Place, str]]:
    for place in itertools.product(*(range(len(variable.names)) for variable in system.inputs)):
        if system.covers(place):
            continue
        words = [v.names[k] for v, k in zip(system.inputs, place, strict=True)]
        message = f"no rule for {' and '.join(words)}: where only that would fire the output is 0; add it"
        yield "missing-rule", ("rules",), message
    first = {rule: k for k, rule in reversed([*enumerate(system.rules)])}
    for k, rule in enumerate(system.rules):
        if first[rule] < k:
            yield "duplicate-rule", ("rules", k), f"repeats an earlier rule (if {rule.condition}): remove one"
        dead = [w for v, w in zip(system.inputs, rule.when, strict=True) if not v.reaches(w)]
        if not rule.fires(system.inputs):
            yield "dead-rule", ("rules", k), f"never fires, because {' and '.join(dead)} lies outside the range"
    if isinstance(system.output, Variable):
        yield from _jumps(system, system.output)


def _jumps(system: FuzzySystem, output: Variable) -> Iterator[tuple[str, Place, str]]:
    """Neighbouring rules are continuous when their consequents overlap; one with OR has no place among them."""
    at: dict[tuple[str, ...], int] = {}
    for k, rule in enumerate(system.rules):
        if not rule.either:
            at.setdefault(rule.when, k)
    terms = dict(zip(output.names, output.terms, strict=True))
    for axis, variable in enumerate(system.inputs):
        after = dict(itertools.pairwise(variable.names))
        for when, k in at.items():
            beside = (*when[:axis], after.get(when[axis], ""), *when[axis + 1 :])
            if beside not in at:
                continue
            one, two = (terms[system.rules[j].then] for j in (k, at[beside]))
            if not (one.a < two.d and two.a < one.d):
                message = (
                    f"jumps from {one.name} to {two.name} beside it (if {' and '.join(beside)}), whose terms do not "
                )
                yield "jump", ("rules", k), f"{message}overlap: choose one between them"


def _outputs(prepared: Prepared) -> Iterator[tuple[str, Place, str]]:
    system = prepared.system
    two = len(system.inputs) == 2
    x, y = np.meshgrid(_GRID, _GRID if two else np.zeros(1), indexing="ij")
    outputs = prepared.outputs(x, y)
    at_rest = float(prepared.outputs(np.zeros(1), np.zeros(1))[0])
    if abs(at_rest) > _ODD:
        yield "origin", (), f"the output at the origin is {at_rest:.4g}, wanted 0: a law would push with no error"
    skew = np.abs(outputs + outputs[::-1, ::-1])
    worst = np.unravel_index(int(np.argmax(skew)), skew.shape)
    if skew[worst] > 2.0 * abs(at_rest) + _ODD:
        place = f"({x[worst]:.3g}, {y[worst]:.3g})" if two else f"{x[worst]:.3g}"
        message = f"the output is not odd about the origin: at {place} and at its mirror image it adds up to "
        lopsided = ", ".join(_lopsided(system)[:4])
        blame = f"; rules without their mirror image: {lopsided}" if lopsided else ""
        yield "asymmetric", ("rules",), f"{message}{skew[worst]:.3g}, not 0{blame}"
    reach = float(np.max(np.abs(outputs)))
    if reach < WEAK:
        message = f"the output reaches only {100 * reach:.2g} % of its range"
        if isinstance(system.output, Variable):
            message += f"; {system.aggregation} may give no more"
        yield "weak", ("output", "range"), f"{message}: narrow the range, or choose other operators"


def _lopsided(system: FuzzySystem) -> list[str]:
    """Rules whose place, mirrored at the origin, does not hold the mirrored consequent, by number of terms."""
    mirrored = [
        dict(zip(names, reversed(names), strict=True)) | {ANY: ANY}
        for names in (*(variable.names for variable in system.inputs), system.output.names)
    ]
    rules = set(system.rules)
    odd = []
    for rule in dict.fromkeys(system.rules):
        *when, then = (names[word] for names, word in zip(mirrored, (*rule.when, rule.then), strict=True))
        if rule._replace(when=tuple(when), then=then) not in rules:
            odd.append(rule.condition)
    return odd
