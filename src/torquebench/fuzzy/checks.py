"""What leaves a fuzzy system without meaning."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from torquebench.errors import Finding, did_you_mean
from torquebench.fuzzy.aggregation import AGGREGATIONS, POINTS
from torquebench.fuzzy.terms import NONE, SAME, TERM, Functions, Variable, shape_errors

if TYPE_CHECKING:
    from torquebench.fuzzy.system import FuzzySystem

CONJUNCTIONS = ("min", "product")
DEFUZZIFICATIONS = ("coa", "cog")
FAR = 1e6
"""A term that reaches this many times as far as the range is taken for a slip."""


def system_errors(system: FuzzySystem) -> list[Finding]:
    """Return why a system has no meaning; nothing if it has one."""
    found: list[Finding] = []

    def add(code: str, where: tuple[str | int, ...], message: str) -> None:
        found.append(Finding(code, "error", where, message))

    if len(system.inputs) not in (1, 2):
        add("inputs", ("inputs",), f"got {len(system.inputs)} inputs, wanted 1 or 2")
    for key, value, valid in (
        ("conjunction", system.conjunction, CONJUNCTIONS),
        ("aggregation", system.aggregation, tuple(AGGREGATIONS)),
        ("defuzzification", system.defuzzification, DEFUZZIFICATIONS),
    ):
        if value not in valid:
            add("operator", (key,), f"got '{value}', wanted one of {', '.join(valid)}{did_you_mean(value, valid)}")
    variables = [(("inputs", i), variable) for i, variable in enumerate(system.inputs)]
    for where, variable in [*variables, (("output",), system.output)]:
        message = range_error(variable.low, variable.high)
        if message is not None:
            add("range", (*where, "range"), message)
        found += _name_errors(where, variable, len(system.inputs))
    return found or _rule_errors(system)


def range_error(low: float, high: float) -> str | None:
    """Return why a variable cannot have the range from `low` to `high`, or None."""
    if low < high and math.isfinite(high - low):
        return None
    return f"got [{low:g}, {high:g}], wanted two finite numbers, the lower one first"


def _name_errors(where: tuple[str | int, ...], variable: Variable | Functions, inputs: int) -> list[Finding]:
    key = "terms" if isinstance(variable, Variable) else "functions"
    twice = {name for name in variable.names if variable.names.count(name) > 1}
    found = [Finding("name", "error", (*where, key, n), "this name is given twice") for n in sorted(twice)]
    if isinstance(variable, Variable):
        shapes = shape_errors({term.name: term[1:] for term in variable.terms})
        found += [finding._replace(where=(*where, *finding.where)) for finding in shapes]
        if not found and range_error(variable.low, variable.high) is None:
            with np.errstate(over="ignore"):
                far = np.max(np.abs(variable.corners()), axis=1)
            for term, distance in zip(variable.terms, far, strict=True):
                if not distance <= FAR:
                    message = f"reaches beyond {FAR:g} times the range; change it, or the range"
                    found.append(Finding("far", "error", (*where, key, term.name), message))
        return found
    for name, numbers in variable.coefficients:
        if not TERM.fullmatch(name):
            message = "its name is not 1 to 24 letters, digits, _, + or -"
            found.append(Finding("function", "error", (*where, key, name), message))
        if len(numbers) not in (1, inputs + 1) or not all(math.isfinite(x) for x in numbers):
            message = f"got {len(numbers)} numbers, wanted one, or {inputs + 1}: a constant and a factor of each input"
            found.append(Finding("function", "error", (*where, key, name), message))
        if name == NONE:
            message = f"no function may be called '{NONE}', which stands for a missing rule"
            found.append(Finding("function", "error", (*where, key, name), message))
    return found


def _rule_errors(system: FuzzySystem) -> list[Finding]:
    found: list[Finding] = []
    said: dict[tuple[str, ...], str] = {}
    for k, rule in enumerate(system.rules):
        unknown = []
        if len(rule.when) != len(system.inputs):
            unknown.append(
                f"names {len(rule.when)} terms after 'if', wanted one for each of {len(system.inputs)} inputs"
            )
        for i, (word, variable) in enumerate(zip(rule.when, system.inputs, strict=False)):
            if word not in variable.names:
                unknown.append(f"unknown term '{word}' of input {i + 1}{did_you_mean(word, variable.names)}")
        if rule.then not in system.output.names:
            unknown.append(f"unknown consequent '{rule.then}'{did_you_mean(rule.then, system.output.names)}")
        found += [Finding("rule", "error", ("rules", k), message) for message in unknown]
        if said.setdefault(rule.when, rule.then) != rule.then:
            message = f"contradicts an earlier rule: if {' and '.join(rule.when)} then both {said[rule.when]} and "
            message += f"{rule.then}; remove one of them"
            found.append(Finding("contradiction", "error", ("rules", k), message))
    if not system.rules:
        found.append(Finding("no-rule", "error", ("rules",), "there is no rule, wanted at least one"))
    elif not found and not any(all(map(Variable.reaches, system.inputs, rule.when)) for rule in system.rules):
        message = "no rule ever fires: each names a term outside its input's range; widen the ranges or move the terms"
        found.append(Finding("no-rule", "error", ("rules",), message))
    if system.aggregation == "max-drastic-product" and isinstance(system.output, Variable):
        found += _peaks_off_grid(system.output)
    return found


def _peaks_off_grid(output: Variable) -> list[Finding]:
    low, high = min(t.a for t in output.terms), max(t.d for t in output.terms)
    u = np.linspace(low, high, POINTS)
    found = []
    for term in output.terms:
        if not np.any((u >= term.b - SAME * output.half) & (u <= term.c + SAME * output.half)):
            nearest = u[np.argmin(np.abs(u - term.peak))]
            message = (
                f"its peak, {term.peak:g}, lies between two of the {POINTS} points from {low:g} to {high:g} on which "
            )
            message += f"the drastic product is taken: move it to {nearest:.10g}, or choose another aggregation"
            found.append(Finding("off-grid", "error", ("output", "terms", term.name), message))
    return found
