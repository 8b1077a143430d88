"""From a config's keys to a fuzzy system."""

from __future__ import annotations

from typing import Any

from torquebench.experiment.document import KeyPath
from torquebench.experiment.fuzzy_schema import FuzzyKeys, SugenoSystem
from torquebench.experiment.schema import Experiment
from torquebench.fuzzy import BUILTIN, Functions, FuzzySystem, Rule, Variable, builtin_system
from torquebench.fuzzy.system import rules_of_table
from torquebench.fuzzy.terms import NONE
from torquebench.laws.law import find_law

RULES = "rules"


def fuzzy_system(name: str, keys: FuzzyKeys) -> FuzzySystem:
    """Return the system that a config's keys describe.

    Raises:
        FuzzyError: it has no meaning.
    """
    inputs = tuple(Variable.of(variable.terms, *variable.range) for variable in keys.inputs)
    rules = _rules(keys)
    if isinstance(keys, SugenoSystem):
        functions = Functions.of(keys.output.functions, *keys.output.range)
        return FuzzySystem(name, inputs, functions, rules, keys.conjunction)
    output = Variable.of(keys.output.terms, *keys.output.range)
    return FuzzySystem(name, inputs, output, rules, keys.conjunction, keys.aggregation, keys.defuzzification)


def systems_of(experiment: Experiment) -> dict[str, FuzzySystem]:
    """Return the fuzzy systems of an experiment by name: its own, and the built-in ones that its controllers use."""
    used = names_used(experiment)
    own = {name: fuzzy_system(name, keys) for name, keys in experiment.fuzzy.items()}
    return own | {name: builtin_system(name) for name in BUILTIN if name in used}


def names_used(experiment: Experiment) -> list[str]:
    """Return the names of the fuzzy systems that an experiment's controllers use: those chosen, and the laws' own."""
    controllers = experiment.controllers
    chosen = [c.fuzzy for c in controllers if c.fuzzy is not None]
    fixed = [own.system for c in controllers for own in find_law(c.law).fixed.values()]
    return list(dict.fromkeys(chosen + fixed))


def _rules(keys: FuzzyKeys) -> tuple[Rule, ...]:
    rules: tuple[Any, ...] = keys.rules
    if isinstance(rules[0], str | tuple):
        names = [tuple(variable.terms) for variable in keys.inputs]
        return rules_of_table(names, [rules] if isinstance(rules[0], str) else rules)
    antecedents = ((getattr(rule, "if"), rule.then) for rule in rules)
    return tuple(Rule((when,) if isinstance(when, str) else when, then) for when, then in antecedents)


def places_of_rules(keys: FuzzyKeys) -> list[KeyPath]:
    """Return where each rule of the system stands, below the system's own key."""
    rules: tuple[Any, ...] = keys.rules
    if isinstance(rules[0], tuple):
        return [(RULES, i, j) for i, row in enumerate(rules) for j, word in enumerate(row) if word != NONE]
    return [(RULES, i) for i, word in enumerate(rules) if word != NONE]
