"""Reading the ``sweep`` section: values to go through and distributions to draw from, each with its place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.errors import did_you_mean
from torquebench.experiment.document import BROKEN, Document, KeyPath
from torquebench.experiment.load import SWEEP
from torquebench.experiment.overrides import split_key
from torquebench.experiment.sections import as_mapping, check_fields, check_value
from torquebench.experiment.sweep_schema import MAX_KEYS, MAX_VALUES, Distribution, Normal, Range, Sweep, worst_model
from torquebench.experiment.sweep_values import Axis, Random, SweepKeys, Value, between, in_tables
from torquebench.experiment.values import shown

NOT_VARIED = ("sweep", "name", "description", "video")
"""Sections and keys that decide nothing of what is run."""
RANGE_WORDS = {"start", "stop", "step", "num", "min", "max", "to", "count", "spacing"}
EVERY = "controllers.*."
"""How a key begins that stands for every controller."""
MAX_WORD = 64


def take_sweep(document: Document) -> SweepKeys:
    """Take the section out of a document and return it; mistakes are recorded in the document."""
    reader = _Reader(document)
    raw = document.root.pop(SWEEP, BROKEN)
    if raw is BROKEN:
        document.add((SWEEP,), "missing: what is varied, such as sweep: {draws: 30}", at="key")
    mapping = as_mapping(document, (SWEEP,), raw, f"a mapping ({', '.join(Sweep.model_fields)})")
    handlers = {"grid": reader.grid, "random": reader.random, "keep": reader.keep}
    values = check_fields(document, (SWEEP,), mapping or {}, Sweep, handlers)
    axes, random = values.get("grid") or (), values.get("random") or ()
    for both in {axis.key for axis in axes} & {r.key for r in random}:
        document.add((SWEEP, "random", both), "is in the grid already: wanted it in one of the two", at="key")
    return SweepKeys(values.get("draws", 1), tuple(axes), tuple(random), values.get("keep", "none"))


class _Reader:
    """Checks the parts of the section."""

    def __init__(self, document: Document) -> None:
        self._document = document

    def grid(self, path: KeyPath, raw: Any) -> tuple[Axis, ...]:
        found = []
        for key, value in self._keys(path, raw):
            here = (*path, key)
            values = self._values(here, value)
            if values:
                found.append(Axis(key, self._document.place(here, "key"), values))
        return tuple(found)

    def random(self, path: KeyPath, raw: Any) -> tuple[Random, ...]:
        found = []
        for key, value in self._keys(path, raw):
            drawn = self._distribution(key, (*path, key), value)
            if drawn is not None:
                found.append(drawn)
        return tuple(found)

    def keep(self, path: KeyPath, raw: Any) -> Any:
        if raw in ("none", "all") and isinstance(raw, str):
            return raw
        if not isinstance(raw, dict):
            near = did_you_mean(raw, ("none", "all")) if isinstance(raw, str) else ""
            hint = near if "did you mean" in near else ""
            self._document.add(path, f"got {shown(raw)}, wanted none, all, or a mapping such as {{worst: 3}}{hint}")
            return BROKEN
        model = worst_model()
        values = check_fields(self._document, path, raw, model)
        return model(**values) if set(values) == set(model.model_fields) else BROKEN

    def _keys(self, path: KeyPath, raw: Any) -> list[tuple[str, Any]]:
        """Return the keys that are ones, with what is written for each."""
        document = self._document
        mapping = as_mapping(document, path, raw, "a mapping of keys, such as plant.payload.mass: [1, 2]") or {}
        if len(mapping) > MAX_KEYS:
            document.add(path, f"got {len(mapping)} keys, wanted at most {MAX_KEYS}")
        found = []
        for key, value in list(mapping.items())[:MAX_KEYS]:
            here = (*path, key)
            star = key.startswith(EVERY)
            parts = split_key(key.replace(EVERY, "controllers.x.", 1) if star else key)
            if parts is None:
                document.add(here, "is not a key: wanted one such as run.duration or controllers.*.gains.k", at="key")
            elif parts[0] in NOT_VARIED:
                document.add(here, "cannot be varied: wanted a key that decides what is run", at="key")
            elif parts == ["run", "draw"]:
                document.add(here, "is what sweep.draws counts: wanted draws there", at="key")
            elif value is None:
                document.add(here, "nothing is given, wanted values")
            elif value is not BROKEN:
                found.append((key, value))
        return found

    def _values(self, path: KeyPath, raw: Any) -> tuple[Value, ...]:
        if isinstance(raw, dict) and "from" in raw:
            return self._range(path, raw)
        document = self._document
        wanted = "a list of values, a range such as {from: 0, to: 1, count: 5}, or a mapping of names to values"
        if not isinstance(raw, list | dict) or not raw:
            document.add(path, f"got {shown(raw)}, wanted {wanted}")
            return ()
        if len(raw) > MAX_VALUES:
            document.add(path, f"got {len(raw)} values, wanted at most {MAX_VALUES}")
            return ()
        if isinstance(raw, dict) and set(raw) <= RANGE_WORDS:
            document.add(
                path, "looks like a range: wanted {from: 0, to: 1, count: 5}, or names that are no words of one"
            )
            return ()
        items = list(raw.items()) if isinstance(raw, dict) else list(enumerate(raw))
        found: dict[float | str, Value] = {}
        for index, value in items:
            here = (*path, index)
            if value is None:
                document.add(here, "nothing is given, wanted a value")
            if value is None or value is BROKEN:
                continue
            if path[2] == "run" and isinstance(value, dict) and "draw" in value:
                message = "draw is what sweep.draws counts: wanted none here"
                document.add((SWEEP, "run"), message, place=document.place(here))
            word = str(index) if isinstance(raw, dict) else in_tables(value)
            if isinstance(word, str) and len(word) > MAX_WORD:
                message = f"such a value needs a name: wanted {{name: value, ...}} (it is {shown(value)})"
                document.add(here, message)
            elif word in found:
                document.add(here, f"{word} is there already")
            else:
                found[word] = Value(value, word, document.place(here))
        return tuple(found.values())

    def _range(self, path: KeyPath, raw: Mapping[str, Any]) -> tuple[Value, ...]:
        values = check_fields(self._document, path, raw, Range)
        if set(values) != set(Range.model_fields):
            return ()
        low, high, count, log = values["from"], values["to"], values["count"], values["spacing"] == "log"
        if low == high:
            self._document.add((*path, "to"), f"got {high:g} twice, wanted another end")
            return ()
        if log and not (low > 0.0 and high > 0.0):
            self._document.add(path, f"spacing log from {low:g} to {high:g}: wanted both positive")
            return ()
        place = self._document.place(path)
        numbers = [between(low, high, i / (count - 1), log) for i in range(count)]
        whole = all(isinstance(raw[end], int) for end in ("from", "to")) and all(x == int(x) for x in numbers)
        return tuple(Value(int(x) if whole else x, float(x), place) for x in numbers)

    def _distribution(self, key: str, path: KeyPath, raw: Any) -> Random | None:
        document, ways = self._document, tuple(Distribution.model_fields)
        mapping = as_mapping(
            document, path, raw, f"a mapping with one of {', '.join(ways)}, such as {{uniform: [0, 1]}}"
        )
        if mapping is None:
            return None
        found: dict[str, Any] = {}

        def choice(here: KeyPath, value: Any) -> Any:
            found["choice"] = self._values(here, value) if isinstance(value, list) else ()
            if not isinstance(value, list):
                document.add(here, f"got {shown(value)}, wanted a list of values")
            return BROKEN

        def pair(here: KeyPath, value: Any) -> Any:
            if not isinstance(value, list) or len(value) != 2:
                document.add(here, f"got {shown(value)}, wanted two numbers: [least, greatest]")
                return BROKEN
            return check_value(document, here, value, Distribution, str(here[-1]))

        handlers = {"choice": choice, "uniform": pair, "log_uniform": pair}
        values = check_fields(document, path, mapping, Distribution, handlers)
        given = [way for way in ways if way in mapping]
        if not mapping:
            document.add(path, f"missing: one of {', '.join(ways)}", at="key")
        for way in given[1:]:
            document.add((*path, way), f"{given[0]} is given already: wanted one of the two", at="key")
        if len(given) != 1:
            return None
        kind, place = given[0], document.place(path, "key")
        if kind == "choice":
            return Random(key, place, kind, (), Axis(key, place, found["choice"])) if found.get("choice") else None
        drawn = values.get(kind)
        if drawn is None:
            return None
        numbers = (drawn.mean, drawn.std) if isinstance(drawn, Normal) else drawn
        if kind != "normal" and not numbers[0] < numbers[1]:
            document.add((*path, kind), f"got {numbers[0]:g} and {numbers[1]:g}, wanted the smaller number first")
            return None
        if kind == "log_uniform" and not numbers[0] > 0.0:
            document.add((*path, kind), f"got {numbers[0]:g}, wanted more than 0")
            return None
        return Random(key, place, kind, tuple(numbers))
