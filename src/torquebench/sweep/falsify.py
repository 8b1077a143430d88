"""The runs of a search for what breaks a law: from a point of the cube to an experiment, its run and its score."""

from __future__ import annotations

import functools
import itertools
import math
import operator
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from torquebench.errors import ConfigError, ModelError, Problem
from torquebench.experiment.build import Builder
from torquebench.experiment.config import MotionTorques, sized, unsized, with_gains
from torquebench.experiment.falsify_section import Allowed, Falsify, in_unit, spell_chain
from torquebench.experiment.groups import FALSIFY
from torquebench.experiment.reference import meanings_of, unit_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, assign
from torquebench.experiment.sweep_section import between, expanded, indexed, number_in, with_number
from torquebench.experiment.units import without_unit
from torquebench.experiment.yaml_tree import KeyPath, Place, tree_of, value_at
from torquebench.keys import altered
from torquebench.metrics import METRICS, MetricInfo, headlines, measured
from torquebench.sweep.checking import corners
from torquebench.sweep.search import COMPARED, Method, Point, drive, shrink, start_search
from torquebench.sweep.table import REFUSED
from torquebench.sweep.worker import Ended, Runner

FAILED = 1e100
"""Score of a run that fails at its end; one that fails at its beginning has twice that."""
SHARE = 0.9
"""Share of the worst value that a smallest counterexample keeps where nothing is claimed."""
MOST_VARIABLES = 1000
WHOLE = "whole multiple of run.control_period"
"""Words in the meaning of a key that takes these only."""


@dataclass(frozen=True)
class Variable:
    """One number that the search may change."""

    key: str
    """As for ``--set``."""
    of: str
    """The key of the section that it belongs to, which may hold a list."""
    place: Place
    paths: tuple[KeyPath, ...]
    """Where it stands in the experiment: in every controller that has it, for ``controllers.*``."""
    low: float
    high: float
    log: bool
    step: float | None
    """Of which values are whole multiples."""
    nominal: float
    unit: str

    def value(self, share: float) -> float:
        """Return the value at a share of the way from low to high, 0 to 1."""
        if share == self.nominal_share:
            return self.nominal
        if self.step is None:
            return min(max(between(self.low, self.high, share, self.log), self.low), self.high)
        first, last = multiples(self.low, self.high, self.step)
        # half a step more at both ends, or they had half the share of the multiples between
        value = between((first - 0.5) * self.step, (last + 0.5) * self.step, share, self.log)
        return float(f"{min(max(round(value / self.step), first), last) * self.step:.15g}") + 0.0

    def share(self, value: float) -> float:
        """Return how far a value is on the way from low to high, 0 to 1."""
        low, high, x = ((math.log(y) if self.log else y) for y in (self.low, self.high, max(value, self.low)))
        return min(max((x - low) / (high - low), 0.0), 1.0)

    @property
    def nominal_share(self) -> float:
        """Share of the range at which the nominal value is; beyond the end where it is outside."""
        if self.low <= self.nominal <= self.high:
            return self.share(self.nominal)
        return -1.0 if self.nominal < self.low else 2.0


def multiples(low: float, high: float, step: float) -> tuple[int, int]:
    """Return the least and the greatest factor of a step of which the product lies between two numbers.

    Args:
        low: The smaller number.
        high: The greater one.
        step: The step; round-off of a billionth of it is allowed.
    """
    return math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)


class Tried(NamedTuple):
    """One run of a search."""

    point: Point
    outcome: str
    value: float
    """The metric; NaN of a run that failed, or does not have it."""
    failed_at: float
    """Control instant of the failure; NaN where there is none."""
    score: float
    """Score by which runs are ordered: greater is worse; minus infinity for a run that says nothing."""


Key: TypeAlias = tuple[str, Method, int]
"""Controller, method and number of the seed."""


class Space:
    """Space of a search: the variables that it may change, and the experiments that come of them.

    Args:
        document: A config, out of which the section has been taken.
        asked: The section.

    Raises:
        ConfigError: a key cannot be changed, or an end of its range is invalid; all mistakes at once.
    """

    def __init__(self, document: Document, asked: Falsify) -> None:
        self.asked, self._torques, self._document = asked, MotionTorques(), document.copy()
        given = with_gains(unsized(document.copy()))
        for i, keys in enumerate(given.controllers):
            if keys.name in given.chosen:  # for the config as it is: a law does not know what the search will do to it
                path = "controllers", i, "gains"
                assign(self._document, path, tree_of(keys.gains), Place(0), Place(0))
        spell_chain(self._document, [allowed.key for allowed in asked.variables])
        found = [self._variables(allowed, given) for allowed in asked.variables]
        self.variables = tuple(variable for group in found for variable in group)
        self._refuse_overlaps()
        if len(self.variables) > MOST_VARIABLES:
            text = f"{len(self.variables)} numbers may change"
            self._document.add((FALSIFY, "variables"), text, wanted=f"at most {MOST_VARIABLES}")
        self._document.raise_problems()
        self.base = unsized(self._document)
        """The config with every variable at its own value, before its disturbances have their sizes."""
        _ = self.base.n  # kept in the copies: it reads the arm's files
        self._check()

    @property
    def groups(self) -> list[int]:
        """Number of variables of each key, in order."""
        return [sum(1 for _ in own) for _, own in itertools.groupby(self.variables, key=lambda variable: variable.of)]

    @property
    def nominal(self) -> Point:
        """The point of the config's own values."""
        return tuple(variable.nominal_share for variable in self.variables)

    def values(self, point: Point) -> tuple[float, ...]:
        """Return the value of each variable at a point."""
        return tuple(variable.value(share) for variable, share in zip(self.variables, point, strict=True))

    def experiment(self, point: Point, controller: str | None = None) -> Experiment:
        """Return the experiment at a point, unchecked.

        Args:
            point: The point.
            controller: The only controller; None for all.
        """
        found = self.base
        for variable, value in zip(self.variables, self.values(point), strict=True):
            for path in variable.paths:
                found = with_number(found, path, value)
        if controller is not None:
            found = altered(found, controllers=tuple(keys for keys in found.controllers if keys.name == controller))
        return sized(found, self._torques)

    def checked(self, point: Point, controller: str) -> Experiment:
        """Return the experiment at a point as a config of it is read, with a controller alone.

        Raises:
            ConfigError: it has mistakes.
        """
        found = sized(unsized(self._document_at(point)), self._torques)
        return altered(found, controllers=tuple(keys for keys in found.controllers if keys.name == controller))

    def _document_at(self, point: Point) -> Document:
        document = self._document.copy()
        for variable, value in zip(self.variables, self.values(point), strict=True):
            for path in variable.paths:
                assign(document, path, value, variable.place, variable.place)
        return document

    def _variables(self, allowed: Allowed, given: Experiment) -> list[Variable]:
        """Return a key's variables, and set its nominal values in the document; mistakes are recorded there."""
        document, bounds, unit = self._document, allowed.bounds, unit_of(allowed.key) or ""
        here: KeyPath = (FALSIFY, "variables", allowed.key)
        paths = [indexed(document.root, parts) for parts in expanded(document, allowed.key)]
        now = without_unit(value_at(document.root, paths[0], None), unit)
        now = number_in(given, paths[0]) if now is None else now
        listed = list(now) if isinstance(now, list | tuple) else [now]
        if isinstance(now, dict) or any(isinstance(x, list | dict) for x in listed) or not listed:
            document.add(here, "is no number, and no list of numbers", place=allowed.place, wanted="a key that is one")
            return []
        several = isinstance(now, list | tuple)
        # of what is no number, such as a key that is absent and has no default, it is what is nearest to zero
        nominal = [
            float(x)
            if isinstance(x, int | float) and not isinstance(x, bool)
            else min(max(0.0, bounds.low), bounds.high)
            for x in listed
        ]
        for path in paths:
            assign(document, path, tree_of(nominal if several else nominal[0]), allowed.place, allowed.place)
        step = bounds.step
        if step is None and any(WHOLE in meaning for meaning in meanings_of(allowed.key)):
            step = given.run.control_period
        if step is not None and operator.gt(*multiples(bounds.low, bounds.high, step)):
            document.add(here, f"has no whole multiple of {step:g} in its range", place=allowed.place)
            return []
        return [
            Variable(
                f"{allowed.key}[{i}]" if several else allowed.key,
                allowed.key,
                allowed.place,
                tuple((*path, i) if several else path for path in paths),
                bounds.low,
                bounds.high,
                bounds.spacing == "log",
                step,
                x,
                unit,
            )
            for i, x in enumerate(nominal)
        ]

    def _refuse_overlaps(self) -> None:
        """Record the variables that change the same number."""
        seen = dict[KeyPath, str]()
        for variable in self.variables:
            for path in variable.paths:
                other = next((seen[path[:i]] for i in range(1, len(path) + 1) if path[:i] in seen), None)
                if other is not None:
                    text = f"{variable.key}: {other} changes it too"
                    self._document.add((FALSIFY, "variables"), text, place=variable.place, wanted="one of the two")
            seen |= dict.fromkeys(variable.paths, variable.key)

    def _check(self) -> None:
        """Check the config at the ends of the ranges.

        Raises:
            ConfigError: it has mistakes there, all of them at once, each once.
        """
        found, build = dict[str, Problem](), Builder()
        for point in [self.nominal, *corners([(0.0, 1.0)] * len(self.variables))]:
            try:
                build.fixed(sized(unsized(self._document_at(point)), self._torques))
            except ConfigError as error:
                found |= {str(problem): problem for problem in error.problems if str(problem) not in found}
            except ModelError as error:
                found.setdefault(str(error), Problem(self._document.filename, "", " ".join(str(error).split())))
        if found:
            raise ConfigError(found.values())


def tried_of(ended: Ended, point: Point, info: MetricInfo, steps: int) -> Tried:
    """Return what a run says of a point; greater scores are worse, and the earlier a run fails, the worse it is.

    Args:
        ended: The run.
        point: The point.
        info: The metric.
        steps: Number of control instants.
    """
    if ended.outcome == REFUSED:
        return Tried(point, ended.outcome, math.nan, math.nan, -math.inf)
    if ended.record is None:
        return Tried(point, ended.outcome, math.nan, ended.failed_at, FAILED * (2.0 - ended.failed_at / steps))
    value = float(headlines(measured(ended.record, [info.key]))[METRICS.names().index(info.key)])
    score = -math.inf if math.isnan(value) else value if info.better == "lower" else -value
    return Tried(point, ended.outcome, value, math.nan, score)


def evaluator(space: Space, pool: ThreadPoolExecutor) -> Callable[[Sequence[tuple[str, Point]]], list[Tried]]:
    """Return what runs points, each with its controller, in order; how many threads there are changes nothing.

    Args:
        space: The points' experiments.
        pool: The threads.
    """
    own, info, steps = threading.local(), space.asked.info, space.base.n_steps

    def run(asked: tuple[str, Point]) -> Tried:
        if not hasattr(own, "runner"):
            own.runner = Runner(1, space.asked.evaluations * steps)
        controller, point = asked
        (ended,) = own.runner.ended(space.experiment(point, controller))
        return tried_of(ended, point, info, steps)

    return lambda points: list(pool.map(run, points))


@dataclass
class Hunt:
    """Result of the search on one controller."""

    controller: str
    nominal: Tried
    """The run of the config's own values."""
    tried: dict[tuple[Method, int], list[Tried]] = field(default_factory=dict)
    """Method and number of the seed -> its runs, in order."""
    smallest: Tried | None = None
    """The worst run after every variable has been moved back as far as the claim stays broken."""
    back: list[Tried] = field(default_factory=list)
    """The runs that this took."""

    @property
    def worst(self) -> Tried:
        """The worst run of all, be it on the way back; the first of equal ones."""
        return max(itertools.chain([self.nominal], *self.tried.values(), self.back), key=lambda one: one.score)

    def worst_of(self, method: Method) -> list[float]:
        """Return the worst score of each seed of a method."""
        return [max(one.score for one in runs) for (own, _), runs in self.tried.items() if own == method]


def breaks(asked: Falsify, score: float) -> bool:
    """Whether a run with this score breaks the claim; one that fails always does, one that says nothing never."""
    sign = 1.0 if asked.info.better == "lower" else -1.0
    broken = asked.claim is not None and score > -math.inf and not asked.claim.holds(sign * score)
    return score >= FAILED or broken


def hunt(
    space: Space,
    methods: Sequence[Method] = COMPARED,
    workers: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> list[Hunt]:
    """Search the worst run of each controller, and then the least that makes it so.

    Args:
        space: What may change.
        methods: The methods, each of which has the whole budget.
        workers: How many runs are made at once.
        progress: Called with the worst so far, the number of runs that are made, and of all.
    """
    asked, groups, names = space.asked, space.groups, [keys.name for keys in space.base.controllers]
    keys: list[Key] = [(name, method, i) for name in names for method in methods for i in range(asked.seeds)]
    total, done, worst = len(keys) * asked.evaluations, 0, ("", -math.inf, math.nan)
    with ThreadPoolExecutor(workers) as pool:
        evaluate = evaluator(space, pool)
        nominal = evaluate([(name, space.nominal) for name in names])
        hunts = {name: Hunt(name, own) for name, own in zip(names, nominal, strict=True)}

        def told(key: Key, points: Sequence[Point], out: Sequence[Tried]) -> bool:
            nonlocal done, worst
            name, method, seed = key
            hunts[name].tried.setdefault((method, seed), []).extend(out)
            done += len(points)
            most = max(out, key=lambda one: one.score)
            if most.score > worst[1]:
                worst = name, most.score, most.value
            brief = "failed" if math.isnan(worst[2]) else in_unit(asked.info.scale * worst[2], asked.info.shown_unit)
            progress(f"'{worst[0]}' {brief}", done, total)
            return asked.claim is not None and any(breaks(asked, one.score) for one in out)

        def run(points: list[tuple[Key, Point]]) -> list[Tried]:
            return evaluate([(key[0], point) for key, point in points])

        searches = {key: start_search(key[1], groups, asked.evaluations, asked.seed + key[2]) for key in keys}
        drive(searches, run, lambda one: one.score, told)
        _return(space, hunts, evaluate)
    return list(hunts.values())


def _return(
    space: Space, hunts: Mapping[str, Hunt], evaluate: Callable[[Sequence[tuple[str, Point]]], list[Tried]]
) -> None:
    """Move each controller's worst run back towards the config's own values while it stays as bad as it has to be.

    It has to break the claim; without one to fail, or else to keep most of the harm.
    """
    asked, base = space.asked, space.nominal
    back, least = {}, dict[str, float]()

    def still(name: str, score: float) -> bool:
        return score >= least[name] if name in least else breaks(asked, score)

    for name, own in hunts.items():
        worst = own.worst
        if worst is own.nominal or (asked.claim is not None and not breaks(asked, worst.score)):
            continue
        own.smallest = worst
        if asked.claim is None and worst.score < FAILED:
            least[name] = own.nominal.score + SHARE * (worst.score - own.nominal.score)
        back[name] = shrink(worst.point, base, functools.partial(still, name))

    def told(name: str, points: Sequence[Point], out: Sequence[Tried]) -> bool:
        hunts[name].back.extend(out)
        for one in out:
            if still(name, one.score):
                hunts[name].smallest = one
        return False

    drive(back, evaluate, lambda one: one.score, told)
