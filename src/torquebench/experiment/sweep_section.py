"""The ``sweep`` section of a config: values to go through, distributions to draw from, and setting them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import Field

from torquebench.errors import Fault
from torquebench.experiment.controllers import OWN_KEYS, Controller
from torquebench.experiment.groups import SWEEP, NameOr, group_of
from torquebench.experiment.reference import unit_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, assign, index_of, split_key
from torquebench.experiment.units import without_unit
from torquebench.experiment.values import Here, Node
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, Map, Place, Seq, copied, shortened, value_at
from torquebench.keys import Key, altered, values_of
from torquebench.laws.law import find_law, law_names
from torquebench.metrics import METRICS

MAX_DRAWS = 10_000_000
MAX_VALUES = 10_000
MAX_KEYS = 64
MAX_WORD = 64
NOT_VARIED = ("sweep", "falsify", "tune", "arena", "name", "description", "figures", "video")
"""Sections and keys that decide nothing of what is run."""
RANGE_WORDS = {"start", "stop", "step", "num", "min", "max", "to", "count", "spacing"}
EVERY = "controllers.*."
"""Beginning of a key that stands for every controller."""


class Value(NamedTuple):
    """One value of a key."""

    raw: Any
    """As in a config."""
    word: float | str
    """As in tables."""
    place: Place


class Axis(NamedTuple):
    """A key of the grid."""

    key: str
    place: Place
    values: tuple[Value, ...]

    @property
    def numeric(self) -> bool:
        """Whether tables show the axis as numbers."""
        return all(isinstance(value.word, float) for value in self.values)


class Random(NamedTuple):
    """A random key."""

    key: str
    place: Place
    kind: str
    """``uniform``, ``log_uniform``, ``normal`` or ``choice``."""
    numbers: tuple[float, ...]
    """Ends, or mean and standard deviation; none of a choice."""
    choices: Axis | None = None


def between(low: float, high: float, share: float, log: bool) -> float:
    """Return what lies a share of the way from one number to another, to 15 digits, so that 0.3 is 0.3.

    Args:
        low, high: The ends.
        share: 0 to 1; at the ends the numbers themselves come out.
        log: Whether steps are equal ratios instead of equal differences.
    """
    if share in (0.0, 1.0):
        return high if share else low
    x = math.exp(math.log(low) * (1.0 - share) + math.log(high) * share) if log else low + (high - low) * share
    return float(f"{x:.15g}") + 0.0


def in_tables(value: Any) -> float | str:
    """Return a config's value as it stands in tables: a number, or a word."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return float(value)
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"), default=str)


def in_words(word: float | str) -> str:
    """Return a value of a table in words."""
    return f"{word:.12g}" if isinstance(word, float) else shortened(word)[1:-1]


@dataclass(frozen=True)
class Range:
    """Evenly spaced values."""

    start: Annotated[float, Key("First value; its unit is the key's", "1", name="from")]
    stop: Annotated[float, Key("Last value, likewise", "1", name="to")]
    count: Annotated[int, Key("Number of values, both ends among them", "1", at_least=2, at_most=MAX_VALUES)]
    spacing: Annotated[Literal["linear", "log"], Key("Equal steps, or equal ratios")] = "linear"

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        low, high = self.start, self.stop
        if low == high:
            yield Fault(("to",), got=f"{high:g} twice", wanted="another end")
        elif self.spacing == "log" and min(low, high) <= 0.0:
            yield Fault((), f"spacing log from {low:g} to {high:g}", wanted="both positive")

    def numbers(self) -> list[float]:
        """Return the values."""
        steps, log = self.count - 1, self.spacing == "log"
        return [between(self.start, self.stop, i / steps, log) for i in range(self.count)]


class Values(Node):
    """A list of values, none of them twice."""

    wanted = "a list of values"

    def read(self, raw: Any, here: Here) -> Any:
        """Return the values."""
        if isinstance(raw, list) and raw:
            return _distinct([(i, in_tables(value), value) for i, value in enumerate(raw)], here)
        here.add(got=shown(raw), wanted=self.wanted)
        return BROKEN

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Annotated[list[Any], Field(min_length=1, max_length=MAX_VALUES)]


class GridValues(Values):
    """A list of values, a range, or a mapping of names to values."""

    wanted = "a list of values, a range such as {from: 0, to: 1, count: 5}, or a mapping of names to values"

    def read(self, raw: Any, here: Here) -> Any:
        """Return the values."""
        if not isinstance(raw, dict) or not raw:
            return super().read(raw, here)
        if "from" in raw:
            ends = group_of(Range).read(raw, here)
            if ends is BROKEN:
                return BROKEN
            numbers, place = ends.numbers(), here.document.place(here.path)
            whole = all(isinstance(raw[end], int) for end in ("from", "to")) and all(x == int(x) for x in numbers)
            return tuple(Value(int(x) if whole else x, float(x), place) for x in numbers)
        if raw.keys() <= RANGE_WORDS:
            here.add("looks like a range", wanted="{from: 0, to: 1, count: 5}, or names that are no words of one")
            return BROKEN
        return _distinct([(name, name, value) for name, value in raw.items()], here)

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        named = Annotated[dict[str, Any], Field(min_length=1, max_length=MAX_VALUES)]
        return super().type() | group_of(Range).type() | named


def _distinct(items: list[tuple[str | int, float | str, Any]], here: Here) -> Any:
    """Return values, each given with its name or index and its word in tables."""
    if len(items) > MAX_VALUES:
        here.add(got=f"{len(items)} values", wanted=f"at most {MAX_VALUES}")
        return BROKEN
    found: dict[float | str, Value] = {}
    for index, word, value in items:
        there = here.below(index)
        place = there.document.place(there.path)
        if value is None:
            there.add("nothing is given", wanted="a value")
        if here.path[2:] == ("run",) and isinstance(value, dict) and "draw" in value:
            there.document.add((SWEEP, "run"), "draw is what sweep.draws counts", place=place, wanted="none here")
        if isinstance(word, str) and len(word) > MAX_WORD:
            there.add(f"such a value, {shown(value)}, needs a name", wanted="{name: value, ...}")
        elif word in found:
            there.add(f"{word} is there already")
        elif value is not None and value is not BROKEN:
            found[word] = Value(value, word, place)
    return tuple(found.values()) if len(found) == len(items) else BROKEN


@dataclass(frozen=True)
class Normal:
    """A normal distribution."""

    mean: Annotated[float, Key("Mean; its unit is the key's", "1")]
    std: Annotated[float, Key("Standard deviation, likewise", "1", above=0)]


Pair: TypeAlias = tuple[float, float]
_PAIR = "two numbers: [least, greatest]"
_GAIN = "a gain, such as controllers.*.gains.k"


@dataclass(frozen=True)
class Distribution:
    """What a key is drawn from, anew in each draw: one of these keys."""

    one_of = True
    uniform: Annotated[Pair | None, Key("Evenly between two numbers", wanted=_PAIR)] = None
    log_uniform: Annotated[Pair | None, Key("With an even logarithm between two positive numbers", wanted=_PAIR)] = None
    normal: Annotated[Normal | None, Key("Normally distributed")] = None
    choice: Annotated[tuple[Value, ...] | None, Key("One of a list of values, all equally likely"), Values()] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        for kind, ends in (("uniform", self.uniform), ("log_uniform", self.log_uniform)):
            if ends is not None and not ends[0] < ends[1]:
                yield Fault((kind,), got=f"{ends[0]:g} and {ends[1]:g}", wanted="the smaller number first")
            elif ends is not None and kind == "log_uniform" and not ends[0] > 0.0:
                yield Fault((kind,), got=f"{ends[0]:g}", wanted="more than 0")


def _random(key: str, place: Place, distribution: Distribution) -> Random:
    (kind, drawn), *_ = (item for item in values_of(distribution).items() if item[1] is not None)
    if kind == "choice":
        return Random(key, place, kind, (), Axis(key, place, drawn))
    return Random(key, place, kind, (drawn.mean, drawn.std) if isinstance(drawn, Normal) else drawn)


def _in_unit(value: Any, unit: str) -> Any:
    """Return a value with every number in it that has a unit as a number in a key's unit; places stay."""
    if isinstance(value, Map):
        for name, inner in value.items():
            value[name] = _in_unit(inner, unit)
    elif isinstance(value, Seq):
        value[:] = [_in_unit(inner, unit) for inner in value]
    return without_unit(value, unit) if isinstance(value, str) else value


def refused(key: str) -> tuple[str, str] | None:
    """Return why a key may not be varied, and what is wanted instead; None where it may, if it is one."""
    parts = split_key(key.replace(EVERY, "controllers.x.", 1) if key.startswith(EVERY) else key)
    if parts is None:
        return "is not a key", "one such as run.duration or controllers.*.gains.k"
    if parts[0] in NOT_VARIED:
        return "cannot be varied", "a key that decides what is run"
    return ("is what sweep.draws counts", "draws there") if parts == ["run", "draw"] else None


class Varied(Node):
    """A mapping of keys of the config.

    Args:
        item: What stands at each of them.
        make: From the key, its place and that to what is returned.
    """

    wanted = "a mapping of keys, such as plant.payload.mass: [1, 2]"

    def __init__(self, item: Node, make: Callable[[str, Place, Any], Axis | Random]) -> None:
        self._item, self._make = item, make

    def read(self, raw: Any, here: Here) -> Any:
        """Return what is made of each key."""
        if not isinstance(raw, dict):
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        if len(raw) > MAX_KEYS:
            here.add(got=f"{len(raw)} keys", wanted=f"at most {MAX_KEYS}")
            return BROKEN
        values = {}
        for key, value in raw.items():
            if self._accepts(key, here):
                values[key] = here.read(self._item, key, _in_unit(value, unit_of(key) or ""))
        if len(values) < len(raw) or BROKEN in values.values():
            return BROKEN
        place = here.document.place
        return tuple(self._make(key, place((*here.path, key), "key"), value) for key, value in values.items())

    def _accepts(self, key: str, here: Here) -> bool:
        """Whether a key is one that may be varied; a mistake is recorded where it is not."""
        if refusal := refused(key):
            here.add(refusal[0], (key,), at="key", wanted=refusal[1])
        return refusal is None

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return Annotated[dict[str, self._item.type()], Field(max_length=MAX_KEYS)]  # type: ignore[misc]


@dataclass(frozen=True)
class Worst:
    """Trajectories of the worst runs only; a run that failed is worse than any that did not."""

    worst: Annotated[int, Key("Number of runs of each controller", "1", at_least=1, at_most=10_000)]
    by: Annotated[str, Key("Metric that is compared"), NameOr(METRICS)] = "rmse"


@dataclass(frozen=True)
class Border:
    """Where each law starts to shake: the first value of a gain at which it chatters by 0.1 % or more, or fails."""

    key: Annotated[str, Key("The gain, such as controllers.*.gains.k; a law without it has no border", wanted=_GAIN)]
    start: Annotated[float, Key("Value at which the search begins; its unit is the gain's", "1", above=0, name="from")]
    stop: Annotated[float, Key("Value at which it ends; a smaller one to search downwards", "1", above=0, name="to")]
    within: Annotated[float, Key("Width to which a border is narrowed, as a share of the value", "1", above=0)] = 0.05

    def faults(self) -> Iterator[Fault]:
        """Yield what leaves it without meaning."""
        parts = split_key(self.key.replace(EVERY, "controllers.x.", 1)) or []
        if len(parts) != 4 or (parts[0], parts[2]) != ("controllers", "gains"):
            yield Fault(("key",), got=self.key, wanted=_GAIN)
        if self.start == self.stop:
            yield Fault(("to",), got=f"{self.start:g} twice", wanted="another end")


@dataclass(frozen=True)
class Sweep:
    """Many runs of one experiment: every combination of the grid, each in every draw, for every controller."""

    draws: Annotated[
        int,
        Key(
            "Draws of each combination, with run.draw 0, 1, ..: mismatch, perturbation, noise and random keys are "
            "drawn anew in each, the same for every combination and controller",
            "1",
            at_least=1,
            at_most=MAX_DRAWS,
        ),
    ] = 1
    axes: Annotated[
        tuple[Axis, ...],
        Key(
            "Key -> its values: a list, a range, or a mapping of names to values, by which tables then call them. Keys "
            "as for --set; controllers.* stands for every controller whose law has the gain or option",
            name="grid",
        ),
        Varied(GridValues(), Axis),
    ] = ()
    random: Annotated[
        tuple[Random, ...],
        Key("Key -> its distribution; keys as in grid"),
        Varied(group_of(Distribution), _random),
    ] = ()
    certificates: Annotated[
        bool, Key("Whether the table has the figures of each run's stability certificates, which cost as much as a run")
    ] = False
    border: Annotated[
        Border | None,
        Key("Gain along which it is searched, in each case and draw, where each law starts to shake; if left out none"),
    ] = None
    keep: Annotated[str | Worst, Key("Trajectories to store, besides the metrics"), NameOr(("none", "all"), Worst)] = (
        "none"
    )

    def faults(self) -> Iterator[Fault]:
        """Yield a fault for each key that is both in the grid and random."""
        for both in {axis.key for axis in self.axes} & {r.key for r in self.random}:
            yield Fault(("random", both), "is in the grid already", at="key", wanted="it in one of the two")
        varied_keys = {axis.key for axis in self.axes} | {r.key for r in self.random}
        if self.border is not None and self.border.key in varied_keys:
            yield Fault(("border", "key"), f"{self.border.key} is varied already", wanted="another gain")

    def plain(self) -> dict[str, Any]:
        """Return what decides results, as plain values."""
        more: dict[str, Any] = {"certificates": True} if self.certificates else {}
        if self.border is not None:
            more["border"] = values_of(self.border)
        return more | {
            "draws": self.draws,
            "grid": [[axis.key, [[value.word, value.raw] for value in axis.values]] for axis in self.axes],
            "random": [
                [r.key, r.kind, list(r.numbers), [[v.word, v.raw] for v in r.choices.values] if r.choices else []]
                for r in self.random
            ],
            "keep": self.keep if isinstance(self.keep, str) else {"worst": self.keep.worst, "by": self.keep.by},
        }


def take_sweep(document: Document) -> Sweep:
    """Take the section out of a document and return it; mistakes are recorded in the document."""
    if SWEEP not in document.root:
        document.add((SWEEP,), "missing: what is varied, such as sweep: {draws: 30}", at="key")
        return Sweep()
    found = Here(document, group_of(Experiment)).read(group_of(Sweep), SWEEP, document.root[SWEEP])
    del document.root[SWEEP]
    return Sweep() if found is BROKEN else found


def varied(document: Document, values: Sequence[tuple[str, Value]]) -> tuple[Document, dict[str, list[KeyPath]]]:
    """Return a copy of a document with keys set, and where each of them is; mistakes are recorded in the copy.

    Args:
        document: The base, which is left as it is.
        values: Keys, which may be ``controllers.*.``, and what each is set to; in order.
    """
    copy, places = document.copy(), dict[str, list[KeyPath]]()
    for key, value in values:
        targets = expanded(copy, key)
        if not targets:
            copy.add(("sweep",), f"{key}: no controller's law has it", place=value.place)
        places[key] = [indexed(copy.root, parts) for parts in targets]  # before a name is set, by which one is found
        for parts in targets:
            assign(copy, parts, copied(value.raw), value.place, value.place)
    return copy, places


def overwritten(
    document: Document, values: Iterable[tuple[str, Value]], places: Mapping[str, Sequence[KeyPath]]
) -> list[tuple[str, str]]:
    """Return the keys whose value is not what it was set to, each with another key that sets it, or a part of it, too.

    Args:
        document: The copy in which they have been set.
        values: As of `varied`.
        places: Where they are.
    """
    found = []
    for key, value in values:
        if not all(_stands(value_at(document.root, path), value.raw) for path in places[key]):
            others = (other for other in places if other != key and _meet(places[key], places[other]))
            found.append((key, next(others, "another key")))
    return found


def _meet(paths: Sequence[KeyPath], others: Sequence[KeyPath]) -> bool:
    return any(path[: len(other)] == other[: len(path)] for path in paths for other in others)


def _stands(node: Any, raw: Any) -> bool:
    """Whether a value that was set is still there; more may have been added to it."""
    if isinstance(raw, dict):
        return isinstance(node, dict) and all(key in node and _stands(node[key], raw[key]) for key in raw)
    if isinstance(raw, list):
        return isinstance(node, list) and len(node) == len(raw) and all(map(_stands, node, raw))
    return bool(node is raw or node == raw)


def expanded(document: Document, key: str) -> list[list[str | int]]:
    """Return the keys that a key stands for: one, or one for each controller whose law has the gain or option."""
    if not key.startswith(EVERY):
        return [split_key(key) or []]
    rest = split_key(key.removeprefix(EVERY)) or []
    raw = document.root.get("controllers")
    items = list(enumerate(raw)) if isinstance(raw, list) else []
    return [["controllers", i, *rest] for i, item in items if isinstance(item, dict) and _has(item, rest)]


def _has(controller: Mapping[str, Any], rest: list[str | int]) -> bool:
    name = controller.get("law")
    if not isinstance(name, str) or name not in law_names():
        return False
    law, key = find_law(name), rest[0]
    if key == "gains" and len(rest) > 1:
        chosen = {option: controller.get(option, declared.values[0]) for option, declared in law.options.items()}
        return rest[1] in law.gains and law.gains[str(rest[1])].acts(chosen)
    return key in law.options or (key == "fuzzy" and bool(law.rules)) or key in OWN_KEYS


def indexed(node: Any, parts: Iterable[str | int]) -> KeyPath:
    """Return a key with the indices of list items in place of their names."""
    path: KeyPath = ()
    for part in parts:
        index = index_of(node, part)
        path = (*path, part if index is None else index)
        node = value_at(node, path[-1:])
    return path


def with_number(experiment: Experiment, path: KeyPath, value: float) -> Experiment:
    """Return an experiment with one number in place of another, unchecked.

    Args:
        experiment: What is changed.
        path: Where a number, or a vector, is now.
        value: The number.
    """
    return _replaced(experiment, path, value)  # type: ignore[no-any-return]


def number_in(experiment: Experiment, path: KeyPath) -> Any:
    """Return what an experiment has at a path of `with_number`, defaults included; None where there is nothing."""
    node: Any = experiment
    for key in path:
        if isinstance(node, tuple):
            node = node[key] if isinstance(key, int) and key < len(node) else None
        elif isinstance(node, Mapping):
            node = node.get(key)
        elif isinstance(node, Controller) and key in node.options:
            node = node.options[str(key)]
        else:
            node = getattr(node, str(key), None)
    return node


def with_draw(experiment: Experiment, draw: int) -> Experiment:
    """Return an experiment with another ``run.draw``."""
    return altered(experiment, run=altered(experiment.run, draw=draw))


def _replaced(node: Any, path: KeyPath, value: float) -> Any:
    if not path:
        return value
    key: Any = path[0]
    if isinstance(node, tuple):
        return (*node[:key], _replaced(node[key], path[1:], value), *node[key + 1 :])
    if isinstance(node, Mapping):
        return {**node, key: _replaced(node[key], path[1:], value)}
    if isinstance(node, Controller) and key not in OWN_KEYS and key != "gains":
        return altered(node, options={**node.options, key: value})
    return altered(node, **{key: _replaced(getattr(node, key), path[1:], value)})
