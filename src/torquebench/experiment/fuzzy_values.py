"""Checking the values of a fuzzy system's keys: ranges, shapes, functions and rules, each with its place."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.fuzzy_schema import MAX_RULES, FuzzyRule
from torquebench.experiment.sections import as_mapping, check_fields
from torquebench.experiment.values import shown
from torquebench.fuzzy.terms import range_error, shape_errors

SHAPE = "one number (a peak), 3 numbers (a triangle) or 4 (a trapezoid)"
FUNCTION = "one number, or a list of a constant and a factor of each input"
RULE_FORMS = "rows of consequents, one row of them for one input, or rules {if: [...], then: ...}"


def refuse(document: Document, path: KeyPath, value: Any, wanted: str) -> Any:
    """Record in `document` what was wanted instead of `value` at `path`, unless that is BROKEN; return BROKEN."""
    if value is not BROKEN:
        document.add(path, f"got {shown(value)}, wanted {wanted}")
    return BROKEN


def check_range(document: Document, path: KeyPath, raw: Any) -> Any:
    """Return a range as two numbers, or BROKEN."""
    if not isinstance(raw, list) or len(raw) != 2:
        return refuse(document, path, raw, "a list of two numbers, such as [-1, 1]")
    numbers = _numbers(document, path, raw)
    message = None if numbers is BROKEN else range_error(*numbers)
    if message is not None:
        document.add(path, message)
        return BROKEN
    return numbers


def check_terms(document: Document, path: KeyPath, raw: Any) -> Any:
    """Return the shapes of a variable's terms by name, or BROKEN."""
    values = _named(document, path, raw, SHAPE, (3, 4))
    findings = [] if values is BROKEN else shape_errors(values)
    for finding in findings:
        document.add((*path[:-1], *finding.where), finding.message)
    return BROKEN if findings else values


def check_functions(document: Document, path: KeyPath, raw: Any) -> Any:
    """Return the numbers of an output's functions by name, or BROKEN."""
    return _named(document, path, raw, FUNCTION, (1, 2, 3))


def check_rules(document: Document, path: KeyPath, raw: Any) -> Any:
    """Return rules, all of one form, or BROKEN."""
    if not isinstance(raw, list) or not 1 <= len(raw) <= MAX_RULES:
        return refuse(document, path, raw, f"a list: {RULE_FORMS}")
    forms: dict[type, Callable[[Document, KeyPath, Any], Any]] = {str: _word, list: _words, dict: _rule}
    form = forms.get(type(raw[0]))
    if form is None:
        return refuse(document, (*path, 0), raw[0], RULE_FORMS)
    found = []
    for i, item in enumerate(raw):
        if isinstance(item, type(raw[0])):
            found.append(form(document, (*path, i), item))
        else:
            found.append(refuse(document, (*path, i), item, f"{shown(raw[0])} like the first: {RULE_FORMS}"))
    return BROKEN if BROKEN in found else found


def _word(document: Document, path: KeyPath, raw: Any) -> Any:
    return raw if isinstance(raw, str) else refuse(document, path, raw, "a name")


def _words(document: Document, path: KeyPath, raw: Any) -> Any:
    words = [_word(document, (*path, i), item) for i, item in enumerate(raw)]
    if not words:
        return refuse(document, path, raw, "names")
    return BROKEN if BROKEN in words else words


def _rule(document: Document, path: KeyPath, raw: Any) -> Any:
    def antecedent(here: KeyPath, value: Any) -> Any:
        return _words(document, here, value) if isinstance(value, list) else _word(document, here, value)

    def consequent(here: KeyPath, value: Any) -> Any:
        return _word(document, here, value)

    values = check_fields(document, path, raw, FuzzyRule, {"if": antecedent, "then": consequent})
    return FuzzyRule(**values) if len(values) == len(FuzzyRule.model_fields) else BROKEN


def _named(document: Document, path: KeyPath, raw: Any, wanted: str, sizes: tuple[int, ...]) -> Any:
    """Return a mapping of names to a number or several, or BROKEN."""
    mapping = as_mapping(document, path, raw, f"a mapping of names to {wanted}")
    if mapping is None:
        return BROKEN
    values = {}
    for name, item in mapping.items():
        here = (*path, name)
        if not isinstance(item, list):
            values[name] = _number(document, here, item, wanted)
        elif len(item) not in sizes:
            values[name] = refuse(document, here, item, wanted)
        else:
            values[name] = _numbers(document, here, item)
    return BROKEN if BROKEN in values.values() else values


def _numbers(document: Document, path: KeyPath, raw: list[Any]) -> Any:
    numbers = [_number(document, (*path, i), item, "a number") for i, item in enumerate(raw)]
    return BROKEN if BROKEN in numbers else numbers


def _number(document: Document, path: KeyPath, raw: Any, wanted: str) -> Any:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        return refuse(document, path, raw, wanted)
    return float(raw) + 0.0 if math.isfinite(raw) else refuse(document, path, raw, "a finite number")
