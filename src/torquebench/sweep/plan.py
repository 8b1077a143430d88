"""A sweep as rows, one closed loop each: the experiment of each row, and the rows of each shard."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from torquebench.certificates import FIGURES
from torquebench.disturbances import Stream, generator
from torquebench.experiment.config import MotionTorques, sized, unsized
from torquebench.experiment.dump import flat_text
from torquebench.experiment.extends import Text
from torquebench.experiment.groups import SWEEP
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, dotted, read_document
from torquebench.experiment.sweep_section import (
    Random,
    Value,
    between,
    overwritten,
    take_sweep,
    varied,
    with_draw,
    with_number,
)
from torquebench.experiment.yaml_tree import KeyPath
from torquebench.keys import altered
from torquebench.robot.library import ArmFile
from torquebench.sweep.border import COLUMNS

Combination: TypeAlias = tuple[int, ...]
"""For each random key with choices, the number of its choice."""

REMEMBERED, DRAWS_REMEMBERED = 64, 4096
"""Checked experiments, and draws of the random keys, that are kept for reuse."""


class Source(NamedTuple):
    """A sweep's file and its changes; enough to make its plan in another process."""

    text: bytes
    filename: str
    overrides: tuple[str, ...] = ()
    plugins: tuple[Path, ...] = ()
    parents: tuple[Text, ...] | None = None
    """Texts of the files that it extends; None until they are read."""
    arms: tuple[tuple[str, ArmFile], ...] = ()
    """Arms that were read from files, each with the path that the sweep's file has for it."""
    outside: bool = False
    """Whether such a file may be outside the folder of the sweep's file."""


class Row(NamedTuple):
    """One closed loop."""

    case: int
    draw: int
    controller: int


@dataclass(frozen=True, slots=True)
class _Fixed:
    """A checked experiment, and the places of the varied keys in it."""

    experiment: Experiment
    unsized: Experiment
    """It before its disturbances have their sizes, which follow from other keys."""
    places: Mapping[str, list[KeyPath]]
    """Places of each varied key; continuous random ones are set there."""
    lacking: Mapping[str, frozenset[int]]
    """Varied key -> the controllers that do not have it."""
    border: Mapping[int, KeyPath]
    """Controller -> place of the gain along which its border is searched."""


class Plan:
    """The rows of a sweep.

    Args:
        source: The sweep's file and its changes.

    Raises:
        ConfigError: the file cannot be read, or its section ``sweep`` has mistakes.
    """

    def __init__(self, source: Source) -> None:
        self.document: Document = read_document(source.text, source.filename, source.parents)
        self.document.arms = {path: (None, arm) for path, arm in source.arms}
        self.document.outside = source.outside
        self._source = source._replace(parents=self.document.parents)
        self.text = flat_text(self.document, source.text)
        """The file with what it extends, as one."""
        apply_overrides(self.document, source.overrides)
        self.raw: dict[str, Any] = dict(self.document.root)
        """The file as it is after the overrides."""
        self.keys = take_sweep(self.document)
        self.document.raise_problems()
        axes, random = self.keys.axes, self.keys.random
        self.continuous: tuple[Random, ...] = tuple(r for r in random if r.choices is None)
        self.choices: tuple[Random, ...] = tuple(r for r in random if r.choices is not None)
        self.cases = math.prod(len(axis.values) for axis in axes)
        self.draws, self._torques = self.keys.draws, MotionTorques()
        self._fixed = functools.lru_cache(maxsize=REMEMBERED)(self._checked)
        self._draw = functools.lru_cache(maxsize=DRAWS_REMEMBERED)(self._drawn)
        self.pairs = self.cases * self.draws

    @property
    def source(self) -> Source:
        """The sweep's file and its changes, with what has been read besides."""
        return self._source._replace(arms=tuple((path, arm) for path, (_, arm) in sorted(self.document.arms.items())))

    @functools.cached_property
    def first(self) -> Experiment:
        """The experiment of the first case, with continuous random keys at the low end of their range."""
        return self.fixed(0)

    @functools.cached_property
    def seed(self) -> int:
        """Seed of the random keys, even where the grid varies the seed."""
        return self.first.run.seed

    @functools.cached_property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers, the same in every case."""
        return tuple(keys.name for keys in self.first.controllers)

    @property
    def figures(self) -> tuple[str, ...]:
        """Columns of figures that are no metrics."""
        return (*(FIGURES if self.keys.certificates else ()), *(COLUMNS if self.keys.border else ()))

    @property
    def rows(self) -> int:
        """Number of closed loops."""
        return self.pairs * len(self.controllers)

    def row(self, index: int) -> Row:
        """Return case, draw and controller of a row."""
        pair, controller = divmod(index, len(self.controllers))
        return Row(*divmod(pair, self.draws), controller)

    def values(self, case: int) -> tuple[Value, ...]:
        """Return the values of the grid's keys in a case; the last key goes fastest."""
        found: list[Value] = []
        for axis in reversed(self.keys.axes):
            case, i = divmod(case, len(axis.values))
            found.append(axis.values[i])
        return tuple(reversed(found))

    def drawn(self, random: Random, draw: int) -> float:
        """Return a random key's value in a draw, or the number of its choice; depends on seed, draw and key alone."""
        return self._draw(draw)[random.key]

    def _drawn(self, draw: int) -> Mapping[str, float]:
        return {random.key: self._number(random, draw) for random in self.keys.random}

    def _number(self, random: Random, draw: int) -> float:
        name = int.from_bytes(hashlib.sha256(random.key.encode()).digest()[:4], "little")
        rng = generator(self.seed, draw, Stream.SWEEP, name)
        match random.kind:
            case "choice":
                return float(rng.integers(len(random.choices.values)))  # type: ignore[union-attr]
            case "normal":
                return random.numbers[0] + random.numbers[1] * float(rng.standard_normal())
            case kind:
                low, high = random.numbers
                return min(max(between(low, high, float(rng.random()), kind == "log_uniform"), low), high)

    def combination(self, draw: int) -> Combination:
        """Return the choices of a draw."""
        return tuple(int(self.drawn(random, draw)) for random in self.choices)

    def fixed(self, case: int, combination: Combination | None = None) -> Experiment:
        """Return a case's experiment, checked, with continuous random keys at the low end of their range.

        Args:
            case: The case.
            combination: The choices; None for the first of each.

        Raises:
            ConfigError: it has mistakes.
        """
        return self._fixed(case, combination or (0,) * len(self.choices)).experiment

    def experiment(self, case: int, draw: int) -> Experiment:
        """Return the experiment of a case in a draw, with every controller.

        Raises:
            ConfigError: it has mistakes.
        """
        found = self._fixed(case, self.combination(draw))
        if not self.continuous:
            return with_draw(found.experiment, draw)
        experiment = found.unsized
        for random in self.continuous:
            value = self.drawn(random, draw)
            for path in found.places[random.key]:
                experiment = with_number(experiment, path, value)
        return with_draw(sized(experiment, self._torques), draw)

    def experiment_of(self, row: Row) -> Experiment:
        """Return the experiment of one row, with its controller alone.

        Raises:
            ConfigError: it has mistakes.
        """
        experiment = self.experiment(row.case, row.draw)
        return altered(experiment, controllers=(experiment.controllers[row.controller],))

    def assigned(self, case: int, combination: Combination, numbers: Sequence[float]) -> list[tuple[str, Value]]:
        """Return every varied key with its value.

        Args:
            case: The case.
            combination: The choices.
            numbers: Values of the continuous random keys.
        """
        values = [(axis.key, value) for axis, value in zip(self.keys.axes, self.values(case), strict=True)]
        for random, i in zip(self.choices, combination, strict=True):
            values.append((random.key, random.choices.values[i]))  # type: ignore[union-attr]
        for random, number in zip(self.continuous, numbers, strict=True):
            values.append((random.key, Value(number, number, random.place)))
        return values

    def variant(self, values: Sequence[tuple[str, Value]]) -> tuple[Document, Mapping[str, list[KeyPath]]]:
        """Return the document with keys set, unchecked, and the places of these keys.

        A key that another one overwrites is recorded as a mistake: tables would show a value that was not run.
        """
        document, places = varied(self.document, values)
        if not document.found:
            for key, other in overwritten(document, values, places):
                places_of = {axis.key: axis.place for axis in self.keys.axes} | {
                    r.key: r.place for r in self.keys.random
                }
                text = f"{key}: {other} of the sweep sets it too"
                document.add((SWEEP,), text, place=places_of[key], wanted="one of the two")
        return document, places

    def _checked(self, case: int, combination: Combination) -> _Fixed:
        numbers = [random.numbers[0] for random in self.continuous]
        document, places = self.variant(self.assigned(case, combination, numbers))
        relative = unsized(document)
        _ = relative.n  # kept in the copies that draws make of it: it reads the arm's files
        experiment = sized(relative, self._torques)
        if not self.continuous:
            _ = experiment.chattering_from_hz  # likewise; what is drawn besides does not change it
        lacking = {key: _without(paths, experiment) for key, paths in places.items()}
        return _Fixed(experiment, relative, places, lacking, self.border_places(document))

    def border_places(self, document: Document) -> dict[int, KeyPath]:
        """Return for each controller the place of the gain along which its border is searched.

        Raises:
            ConfigError: no law has the gain, or it cannot be one of the ends.
        """
        border, found = self.keys.border, dict[int, KeyPath]()
        if border is None:
            return found
        here = document.place((SWEEP, "border"))
        for end in (border.start, border.stop):
            there, places = varied(document, [(border.key, Value(end, end, here))])
            unsized(there)
            found = {int(path[1]): path for path in places[border.key]}
        return found

    def bordered(self, case: int, draw: int) -> Mapping[int, KeyPath]:
        """Return `border_places` of a case in a draw."""
        return self._fixed(case, self.combination(draw)).border

    def lacking(self, case: int, draw: int) -> Mapping[str, frozenset[int]]:
        """Return for each varied key the controllers that do not have it."""
        return self._fixed(case, self.combination(draw)).lacking


def _without(paths: Sequence[KeyPath], experiment: Experiment) -> frozenset[int]:
    own = {path[1] for path in paths if len(path) > 1 and path[0] == "controllers"}
    elsewhere = any(len(path) < 2 or path[0] != "controllers" for path in paths)
    return frozenset() if elsewhere else frozenset(range(len(experiment.controllers))) - own


def flattened(tree: Any, path: KeyPath = ()) -> Iterator[tuple[str, Any]]:
    """Yield dotted key and value of each leaf of a tree of plain values; named items of lists go by their names."""
    if isinstance(tree, dict) and tree:
        for key, value in tree.items():
            yield from flattened(value, (*path, key))
    elif isinstance(tree, list) and any(isinstance(item, dict | list) for item in tree):
        for i, item in enumerate(tree):
            name = item.get("name") if isinstance(item, dict) else None
            yield from flattened(item, (*path, name if isinstance(name, str) else i))
    else:
        yield dotted(path), tree


def pairs_of(size: int, pairs: int, shard: int) -> range:
    """Return the (case, draw) pairs of a shard, numbered case * draws + draw."""
    return range(shard * size, min((shard + 1) * size, pairs))
