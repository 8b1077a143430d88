"""Check every experiment of a sweep before any is run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from torquebench.errors import ConfigError, ModelError, Problem
from torquebench.experiment.build import Builder
from torquebench.experiment.config import MotionTorques, sized, unsized
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.experiment.sweep_section import Random, Value, in_words
from torquebench.experiment.yaml_tree import Place
from torquebench.sweep.plan import Combination, Plan

MAX_CORNERS = 64
"""Most combinations of least and greatest values of random keys that are tried."""
TRIED = 3
"""Draws whose random values are tried, as a value between the ends may be invalid too."""
MAX_PROBLEMS = 100


@dataclass(slots=True)
class Survey:
    """Facts found in checking a sweep."""

    steps: list[int] = field(default_factory=list)
    """Number of control instants of one loop, by case."""
    is_drawn: bool = False
    """Whether anything is random in some case; else all draws are one run."""


def check_plan(plan: Plan, progress: Callable[[], object] = lambda: None) -> Survey:
    """Check every experiment of a sweep: each case with each choice that is drawn, and at the ends of random keys.

    Draws that differ in random numbers alone are not checked one by one: these keys are tried at their least and
    greatest values, and at those of the first few draws. Plant, model, controllers and reference are built once for
    each case.

    Args:
        plan: The sweep.
        progress: Called after each case.

    Raises:
        ConfigError: there are mistakes; each is named with the value of the sweep that causes it.
    """
    checker, survey, first = _Checker(plan), Survey(), (0,) * len(plan.choices)
    low = [random.numbers[0] for random in plan.continuous]
    for case in range(plan.cases):
        experiment = checker.read(case, first, low, build=True)
        survey.steps.append(0 if experiment is None else experiment.n_steps)
        survey.is_drawn |= bool(plan.keys.random) or (experiment is not None and experiment.is_drawn)
        progress()
    checker.raise_problems()
    drawn = combinations(plan)
    ends = list(corners([extremes(plan, random) for random in plan.continuous]))
    inside = [tuple(plan.drawn(random, draw) for random in plan.continuous) for draw in range(min(TRIED, plan.draws))]
    for points in (ends or [()], *([own] for own in inside if own)):
        for case in range(plan.cases):
            for combination in sorted(drawn):
                for place, numbers in enumerate(points):
                    if ends or combination != first:
                        checker.read(case, combination, numbers, build=place == 0 and combination != first)
        checker.raise_problems()
    return survey


def combinations(plan: Plan) -> set[Combination]:
    """Return the combinations of choices that are drawn; stops looking once all have been."""
    every = math.prod(len(random.choices.values) for random in plan.choices if random.choices)
    found: set[Combination] = set()
    for draw in range(plan.draws):
        found.add(plan.combination(draw))
        if len(found) == every:
            break
    return found


def extremes(plan: Plan, random: Random) -> tuple[float, float]:
    """Return the least and greatest value of a continuous random key; of a normal one, those that are drawn."""
    if random.kind != "normal":
        return random.numbers[0], random.numbers[1]
    drawn = [plan.drawn(random, draw) for draw in range(plan.draws)]
    return min(drawn), max(drawn)


def corners(ends: Sequence[tuple[float, float]]) -> Iterator[tuple[float, ...]]:
    """Yield the corners of a box; of more than `MAX_CORNERS`, the two extreme ones and their neighbours."""
    if 2 ** len(ends) <= MAX_CORNERS:
        yield from (corner for corner in itertools.product(*ends) if corner)
        return
    for own, other in ((0, 1), (1, 0)):
        whole = [end[own] for end in ends]
        yield tuple(whole)
        yield from ((*whole[:i], ends[i][other], *whole[i + 1 :]) for i in range(len(ends)))


@dataclass(slots=True)
class _Mistake:
    problem: Problem
    values: list[set[float | str]]
    """For each key of the sweep, the values with which the mistake was seen."""


class _Checker:
    """Collects the mistakes in many variants of one document."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._build, self._torques = plan, Builder(), MotionTorques()
        self._found: dict[tuple[Place, str, str], _Mistake] = {}
        self._tried: dict[str, set[float | str]] = {}
        self._names: list[str] | None = None
        self._unchecked = False

    def read(self, case: int, combination: Combination, numbers: Sequence[float], *, build: bool) -> Experiment | None:
        """Return an experiment; None if it has mistakes, which are noted."""
        if len(self._found) >= MAX_PROBLEMS:
            return None
        values = self._plan.assigned(case, combination, numbers)
        for key, value in values:
            self._tried.setdefault(key, set()).add(value.word)
        document, _ = self._plan.variant(values)
        try:
            experiment = sized(unsized(document), self._torques)
            self._plan.border_places(document)
            self._check_names(document, experiment, values)
            if build:
                self._build.fixed(experiment)
            return experiment
        except ConfigError as error:
            self._unchecked |= error.unchecked
            placed = document.found or [(Place(0, 1, 1), problem) for problem in error.problems]
        except ModelError as error:
            placed = [(Place(0, 1, 1), Problem("", "", " ".join(str(error).split())))]
        for place, problem in placed:
            if not problem.where:
                problem = document.problem(place, key=problem.key, text=problem.message)
            mistake = self._found.setdefault(
                (place, problem.key, problem.message), _Mistake(problem, [set() for _ in values])
            )
            for seen, (_, value) in zip(mistake.values, values, strict=True):
                seen.add(value.word)
        return None

    def _check_names(self, document: Document, experiment: Experiment, values: Sequence[tuple[str, Value]]) -> None:
        names = [keys.name for keys in experiment.controllers]
        self._names = self._names or names
        if names != self._names:
            place = next((v.place for key, v in values if key.startswith("controllers")), Place(0, 1, 1))
            text = f"the controllers are {', '.join(names)} here and {', '.join(self._names)} in the first case"
            document.add(("controllers",), text, place=place, wanted="the same in every case")
            document.raise_problems()

    def raise_problems(self) -> None:
        """Raise the mistakes that were noted.

        Raises:
            ConfigError: there are some.
        """
        if self._found:
            ordered = sorted(self._found.items(), key=lambda item: item[0])
            raise ConfigError([self._explained(mistake) for _, mistake in ordered], self._unchecked)

    def _explained(self, mistake: _Mistake) -> Problem:
        """Return a mistake with the values that cause it: those without which it was not seen."""
        pairs = zip(self._tried.items(), mistake.values, strict=True)
        causes = [
            f"{key} = {in_words(next(iter(seen)))}" for (key, tried), seen in pairs if len(seen) == 1 < len(tried)
        ]
        if not causes:
            return mistake.problem
        note = mistake.problem.note
        return replace(mistake.problem, note=f"{note}{'; ' if note else ''}in the sweep: {', '.join(causes)}")
