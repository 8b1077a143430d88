"""The ``sweep`` section of a config: values to go through, distributions to draw from, and setting them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import Field

from torquebench.experiment.config import SWEEP, check_group
from torquebench.experiment.controllers import OWN_KEYS, Controller
from torquebench.experiment.groups import Checked, Named, group_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, assign, index_of, split_key
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN, KeyPath, Place, copied, shortened, value_at
from torquebench.keys import Key, altered
from torquebench.laws.law import find_law, law_names
from torquebench.metrics import METRICS

MAX_DRAWS = 10_000_000
MAX_VALUES = 10_000
MAX_KEYS = 64
MAX_WORD = 64
NOT_VARIED = ("sweep", "name", "description", "video")
"""Sections and keys that decide nothing of what is run."""
RANGE_WORDS = {"start", "stop", "step", "num", "min", "max", "to", "count", "spacing"}
EVERY = "controllers.*."
"""How a key begins that stands for every controller."""
_Values: TypeAlias = Annotated[list[Any], Field(min_length=1, max_length=MAX_VALUES)]
_Named: TypeAlias = Annotated[dict[str, Any], Field(min_length=1, max_length=MAX_VALUES)]


def _as_it_is(raw: Any) -> Any:
    return raw


@dataclass(frozen=True)
class Range:
    """Evenly spaced values."""

    start: Annotated[float, Key("First value; its unit is the key's", "1", name="from")]
    stop: Annotated[float, Key("Last value, likewise", "1", name="to")]
    count: Annotated[int, Key("Number of values, both ends among them", "1", at_least=2, at_most=MAX_VALUES)]
    spacing: Annotated[Literal["linear", "log"], Key("Equal steps, or equal ratios")] = "linear"


@dataclass(frozen=True)
class Normal:
    """A normal distribution."""

    mean: Annotated[float, Key("Mean; its unit is the key's", "1")]
    std: Annotated[float, Key("Standard deviation, likewise", "1", above=0)]


_PAIR = "two numbers: [least, greatest]"


@dataclass(frozen=True)
class Distribution:
    """What a key is drawn from, anew in each draw: one of these keys."""

    one_of = True
    uniform: Annotated[tuple[float, float] | None, Key("Evenly between two numbers", wanted=_PAIR)] = None
    log_uniform: Annotated[
        tuple[float, float] | None, Key("With an even logarithm between two positive numbers", wanted=_PAIR)
    ] = None
    normal: Annotated[Normal | None, Key("Normally distributed")] = None
    choice: Annotated[
        tuple[Any, ...] | None, Key("One of a list of values, all equally likely"), Checked(_as_it_is, _Values)
    ] = None


@dataclass(frozen=True)
class Worst:
    """Trajectories of the worst runs only; a run that failed is worse than any that did not."""

    worst: Annotated[int, Key("Number of runs of each controller", "1", at_least=1, at_most=10_000)]
    by: Annotated[str, Key("Metric that is compared"), Named(METRICS)] = "rmse"


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
    grid: Annotated[
        Any,
        Key(
            "Key -> its values: a list, a range, or a mapping of names to values, by which tables then call them. Keys "
            "as for --set; controllers.* stands for every controller whose law has the gain or option"
        ),
        Checked(
            _as_it_is,
            Annotated[dict[str, _Values | group_of(Range).model(True) | _Named], Field(max_length=MAX_KEYS)],
        ),
    ] = None
    random: Annotated[
        Any,
        Key("Key -> its distribution; keys as in grid"),
        Checked(_as_it_is, Annotated[dict[str, group_of(Distribution).model(True)], Field(max_length=MAX_KEYS)]),
    ] = None
    certificates: Annotated[
        bool, Key("Whether the table has the figures of each run's stability certificates, which cost as much as a run")
    ] = False
    keep: Annotated[str | Worst, Key("Trajectories to store, besides the metrics"), Named(("none", "all"), Worst)] = (
        "none"
    )


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
        """Whether tables show it as numbers."""
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


class SweepKeys(NamedTuple):
    """A sweep's section without mistakes."""

    draws: int
    axes: tuple[Axis, ...]
    random: tuple[Random, ...]
    keep: str | Worst
    certificates: bool = False

    def plain(self) -> dict[str, Any]:
        """Return what decides results, as plain values."""
        certified = {"certificates": True} if self.certificates else {}
        return certified | {
            "draws": self.draws,
            "grid": [[axis.key, [[value.word, value.raw] for value in axis.values]] for axis in self.axes],
            "random": [
                [r.key, r.kind, list(r.numbers), [[v.word, v.raw] for v in r.choices.values] if r.choices else []]
                for r in self.random
            ],
            "keep": self.keep if isinstance(self.keep, str) else {"worst": self.keep.worst, "by": self.keep.by},
        }


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


def take_sweep(document: Document) -> SweepKeys:
    """Take the section out of a document and return it; mistakes are recorded in the document."""
    if SWEEP not in document.root:
        document.add((SWEEP,), "missing: what is varied, such as sweep: {draws: 30}", at="key")
        return SweepKeys(1, (), (), "none")
    raw = document.root[SWEEP]
    sweep = check_group(document, (SWEEP,), group_of(Sweep)) or Sweep()
    given = raw if isinstance(raw, dict) else {}
    axes = _grid(document, (SWEEP, "grid"), given["grid"]) if "grid" in given else ()
    random = _random(document, (SWEEP, "random"), given["random"]) if "random" in given else ()
    for both in {axis.key for axis in axes} & {r.key for r in random}:
        document.add((SWEEP, "random", both), "is in the grid already", at="key", wanted="it in one of the two")
    del document.root[SWEEP]
    return SweepKeys(sweep.draws, axes, random, sweep.keep, sweep.certificates)


def _grid(document: Document, path: KeyPath, raw: Any) -> tuple[Axis, ...]:
    found = []
    for key, value in _keys(document, path, raw):
        here = (*path, key)
        values = _values(document, here, value)
        if values:
            found.append(Axis(key, document.place(here, "key"), values))
    return tuple(found)


def _random(document: Document, path: KeyPath, raw: Any) -> tuple[Random, ...]:
    drawn = [_distribution(document, key, (*path, key), value) for key, value in _keys(document, path, raw)]
    return tuple(random for random in drawn if random is not None)


def _keys(document: Document, path: KeyPath, raw: Any) -> list[tuple[str, Any]]:
    """Return the keys that are ones, with what is written for each."""
    if not isinstance(raw, dict):
        if raw is not BROKEN:
            document.add(path, got=shown(raw), wanted="a mapping of keys, such as plant.payload.mass: [1, 2]")
        return []
    if len(raw) > MAX_KEYS:
        document.add(path, got=f"{len(raw)} keys", wanted=f"at most {MAX_KEYS}")
    found = []
    for key, value in list(raw.items())[:MAX_KEYS]:
        here = (*path, key)
        star = key.startswith(EVERY)
        parts = split_key(key.replace(EVERY, "controllers.x.", 1) if star else key)
        if parts is None:
            document.add(here, "is not a key", at="key", wanted="one such as run.duration or controllers.*.gains.k")
        elif parts[0] in NOT_VARIED:
            document.add(here, "cannot be varied", at="key", wanted="a key that decides what is run")
        elif parts == ["run", "draw"]:
            document.add(here, "is what sweep.draws counts", at="key", wanted="draws there")
        elif value is None:
            document.add(here, "nothing is given", wanted="values")
        elif value is not BROKEN:
            found.append((key, value))
    return found


def _values(document: Document, path: KeyPath, raw: Any) -> tuple[Value, ...]:
    if isinstance(raw, dict) and "from" in raw:
        return _range(document, path, raw)
    wanted = "a list of values, a range such as {from: 0, to: 1, count: 5}, or a mapping of names to values"
    if not isinstance(raw, list | dict) or not raw:
        document.add(path, got=shown(raw), wanted=wanted)
        return ()
    if len(raw) > MAX_VALUES:
        document.add(path, got=f"{len(raw)} values", wanted=f"at most {MAX_VALUES}")
        return ()
    if isinstance(raw, dict) and set(raw) <= RANGE_WORDS:
        names = "{from: 0, to: 1, count: 5}, or names that are no words of one"
        document.add(path, "looks like a range", wanted=names)
        return ()
    items = list(raw.items()) if isinstance(raw, dict) else list(enumerate(raw))
    found: dict[float | str, Value] = {}
    for index, value in items:
        here = (*path, index)
        if value is None:
            document.add(here, "nothing is given", wanted="a value")
        if value is None or value is BROKEN:
            continue
        if path[2] == "run" and isinstance(value, dict) and "draw" in value:
            place = document.place(here)
            document.add((SWEEP, "run"), "draw is what sweep.draws counts", place=place, wanted="none here")
        word = str(index) if isinstance(raw, dict) else in_tables(value)
        if isinstance(word, str) and len(word) > MAX_WORD:
            text = f"such a value, {shown(value)}, needs a name"
            document.add(here, text, wanted="{name: value, ...}")
        elif word in found:
            document.add(here, f"{word} is there already")
        else:
            found[word] = Value(value, word, document.place(here))
    return tuple(found.values())


def _range(document: Document, path: KeyPath, raw: Mapping[str, Any]) -> tuple[Value, ...]:
    ends: Range | None = check_group(document, path, group_of(Range))
    if ends is None:
        return ()
    low, high, log = ends.start, ends.stop, ends.spacing == "log"
    if low == high:
        document.add((*path, "to"), got=f"{high:g} twice", wanted="another end")
        return ()
    if log and not (low > 0.0 and high > 0.0):
        document.add(path, f"spacing log from {low:g} to {high:g}", wanted="both positive")
        return ()
    place = document.place(path)
    numbers = [between(low, high, i / (ends.count - 1), log) for i in range(ends.count)]
    whole = all(isinstance(raw[end], int) for end in ("from", "to")) and all(x == int(x) for x in numbers)
    return tuple(Value(int(x) if whole else x, float(x), place) for x in numbers)


def _distribution(document: Document, key: str, path: KeyPath, raw: Any) -> Random | None:
    ways = tuple(group_of(Distribution).fields)
    if not isinstance(raw, dict):
        wanted = f"a mapping with one of {', '.join(ways)}, such as {{uniform: [0, 1]}}"
        document.add(path, got=shown(raw), wanted=wanted)
        return None
    distribution: Distribution | None = check_group(document, path, group_of(Distribution))
    given = [way for way in ways if way in raw]
    if not raw:
        document.add(path, f"missing: one of {', '.join(ways)}", at="key")
    for way in given[1:]:
        document.add((*path, way), f"{given[0]} is given already", at="key", wanted="one of the two")
    if len(given) != 1 or distribution is None:
        return None
    kind, place = given[0], document.place(path, "key")
    drawn: Any = getattr(distribution, kind)
    if kind == "choice":
        if not isinstance(drawn, list):
            document.add((*path, kind), got=shown(drawn), wanted="a list of values")
            return None
        values = _values(document, (*path, kind), drawn)
        return Random(key, place, kind, (), Axis(key, place, values)) if values else None
    numbers = (drawn.mean, drawn.std) if isinstance(drawn, Normal) else drawn
    if kind != "normal" and not numbers[0] < numbers[1]:
        got = f"{numbers[0]:g} and {numbers[1]:g}"
        document.add((*path, kind), got=got, wanted="the smaller number first")
        return None
    if kind == "log_uniform" and not numbers[0] > 0.0:
        document.add((*path, kind), got=f"{numbers[0]:g}", wanted="more than 0")
        return None
    return Random(key, place, kind, tuple(numbers))


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
        places[key] = [_indexed(copy.root, parts) for parts in targets]  # before a name is set, by which one is found
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
    """Whether what was set is still there; more may have been added to it."""
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


def _indexed(node: Any, parts: Iterable[str | int]) -> KeyPath:
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
