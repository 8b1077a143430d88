"""Checking the fuzzy systems of a config, and the names by which controllers choose them."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any

from torquebench.errors import FuzzyError, did_you_mean
from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.fuzzy_schema import (
    MAX_SYSTEMS,
    AnyFuzzy,
    FuzzyFunctions,
    FuzzyInput,
    FuzzyKeys,
    FuzzyTerms,
    MamdaniSystem,
    SugenoSystem,
)
from torquebench.experiment.fuzzy_system import RULES, fuzzy_system, places_of_rules
from torquebench.experiment.fuzzy_values import check_functions, check_range, check_rules, check_terms, refuse
from torquebench.experiment.keys import Keys
from torquebench.experiment.sections import Checked, Handler, as_mapping, check_fields, check_tagged
from torquebench.experiment.values import shown
from torquebench.fuzzy import BUILTIN
from torquebench.registry import SLUG

_KINDS: Mapping[str, type[FuzzyKeys]] = {"mamdani": MamdaniSystem, "sugeno": SugenoSystem}
_OUTPUTS: Mapping[str, type[Keys]] = {"mamdani": FuzzyTerms, "sugeno": FuzzyFunctions}


def check_fuzzy(document: Document, path: KeyPath, raw: Any) -> dict[str, Checked[FuzzyKeys]]:
    """Return what could be made of each fuzzy system, by name."""
    mapping = as_mapping(document, path, raw, "a mapping of names to fuzzy systems")
    if mapping is None:
        return {}
    if len(mapping) > MAX_SYSTEMS:
        document.add(path, f"got {len(mapping)} fuzzy systems, wanted at most {MAX_SYSTEMS}")
    found = {}
    for name, item in list(mapping.items())[:MAX_SYSTEMS]:
        if not SLUG.fullmatch(name):
            message = "its name is not a slug: 1 to 64 of a-z, 0-9 and -, a letter or digit at both ends"
            document.add((*path, name), message, at="key")
        elif name in BUILTIN:
            document.add((*path, name), f"'{name}' is built in: choose another name", at="key")
        checked = _Reader(document, (*path, name)).read(name, item)
        if checked is not None:
            found[name] = checked
    return found


def check_fuzzy_name(document: Document, path: KeyPath, value: Any) -> Any:
    """Return the name of a fuzzy system that is built in or defined in the config, or BROKEN."""
    own = document.root.get("fuzzy")
    names = [*BUILTIN, *(own if isinstance(own, dict) else ())]
    if isinstance(value, str) and value in names:
        return value
    near = did_you_mean(value, names) if isinstance(value, str) else ""
    hint = near if "did you mean" in near else ""
    document.add(path, f"got {shown(value)}, wanted a fuzzy system, one of {', '.join(names)}{hint}")
    return BROKEN


class _Reader:
    """Checks one fuzzy system."""

    def __init__(self, document: Document, path: KeyPath) -> None:
        self._document, self._path = document, path

    def read(self, name: str, raw: Any) -> Checked[FuzzyKeys] | None:
        kind = raw.get("kind") if isinstance(raw, dict) else None
        handlers: dict[str, Handler] = {
            "inputs": self._inputs,
            "output": functools.partial(self._output, kind),
            "rules": functools.partial(check_rules, self._document),
        }
        checked = check_tagged(self._document, self._path, raw, "kind", AnyFuzzy, _KINDS, handlers)
        if checked is None or checked.model is None:
            return checked
        if any(key not in checked.values for key in checked.model.model_fields):
            return checked
        keys = checked.build()
        if self._fits(keys):
            self._check_meaning(name, keys)
        return checked

    def _check_meaning(self, name: str, keys: FuzzyKeys) -> None:
        try:
            fuzzy_system(name, keys)
        except FuzzyError as error:
            places = places_of_rules(keys)
            for finding in error.findings:
                first, *rest = finding.where
                where = places[int(rest[0])] if first == RULES and rest else finding.where
                self._document.add((*self._path, *where), finding.message)

    def _group(self, path: KeyPath, raw: Any, model: type[Keys]) -> Any:
        """Return an input or output, or BROKEN."""
        mapping = as_mapping(self._document, path, raw, f"a mapping ({', '.join(model.model_fields)})")
        if mapping is None:
            return BROKEN
        handlers: dict[str, Handler] = {
            "range": functools.partial(check_range, self._document),
            "terms": functools.partial(check_terms, self._document),
            "functions": functools.partial(check_functions, self._document),
        }

        def elsewhere(key: str) -> str | None:
            owners = [kind for kind, other in _OUTPUTS.items() if other is not model and key in other.model_fields]
            if model is FuzzyInput or not owners:
                return None
            return f"has no effect here (it belongs to kind: {owners[0]})"

        values = check_fields(self._document, path, mapping, model, handlers, elsewhere=elsewhere)
        return model(**values) if all(key in values for key in model.model_fields) else BROKEN

    def _inputs(self, path: KeyPath, raw: Any) -> Any:
        if not isinstance(raw, list) or not 1 <= len(raw) <= 2:
            return refuse(self._document, path, raw, "a list of one or two inputs")
        groups = [self._group((*path, i), item, FuzzyInput) for i, item in enumerate(raw)]
        return BROKEN if BROKEN in groups else groups

    def _output(self, kind: Any, path: KeyPath, raw: Any) -> Any:
        return self._group(path, raw, _OUTPUTS[kind]) if kind in _OUTPUTS else BROKEN

    def _fits(self, keys: FuzzyKeys) -> bool:
        """Whether a table of rules has the size that the inputs' terms ask for; records where it has not."""
        path, rows = (*self._path, RULES), keys.rules
        first, *second = [list(variable.terms) for variable in keys.inputs]
        if not isinstance(rows[0], str | tuple):
            return True
        if isinstance(rows[0], str) == bool(second):
            wanted = "a row of consequents for each term of input 1" if second else "one row of consequents"
            self._document.add(path, f"got {shown(list(rows))}, wanted {wanted}, as the inputs are {1 + len(second)}")
            return False
        fits = self._counts(path, len(rows), "rows" if second else "consequents", first, 1)
        for i, row in enumerate(rows):
            if second and isinstance(row, tuple):
                fits &= self._counts((*path, i), len(row), "consequents", second[0], 2)
        return fits

    def _counts(self, path: KeyPath, got: int, what: str, names: Iterable[str], number: int) -> bool:
        terms = list(names)
        if got != len(terms):
            one_each = f"one for each term of input {number} ({', '.join(terms)})"
            self._document.add(path, f"got {got} {what}, wanted {len(terms)}, {one_each}")
        return got == len(terms)
