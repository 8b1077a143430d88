"""Tuning: sets of gains run under conditions, their evaluations, and the searches of all laws with one budget."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeAlias

from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.controllers import Controller
from torquebench.experiment.falsify_section import Claim
from torquebench.experiment.schema import Experiment
from torquebench.experiment.sweep_section import with_draw
from torquebench.experiment.tune_section import HELD, Condition
from torquebench.keys import Vector, altered
from torquebench.laws.box import Box
from torquebench.metrics import METRICS, MetricInfo, headlines, measured
from torquebench.robot import load_model
from torquebench.statistics import Ratio, geometric_mean, undominated
from torquebench.sweep.search import Point, Sampler, check_method, drive, sampler_search
from torquebench.sweep.worker import Runner

FAILED, BROKEN = 1e6, 1e3
"""Scores of gains with which a run fails, and of gains that break a constraint, begin here; others are logarithms."""
LEAST = 1e-12
"""Metrics count as at least this in a geometric mean."""
OTHER = "another version made it, or it was altered; begin anew"


class Run(NamedTuple):
    """One closed loop of an evaluation."""

    lost: float
    """Share of its time that was left when it failed [1]; 0 where it completed."""
    values: tuple[float, ...]
    """Each metric; NaN where it failed, or does not have it."""

    @property
    def failed(self) -> bool:
        """Whether the run failed."""
        return self.lost > 0.0


class Budget(Protocol):
    """Aims and length of a search: the section `Tune` of a config, or anything like it."""

    @property
    def evaluations(self) -> int:
        """Sets of gains that are tried of each law and seed."""

    @property
    def seeds(self) -> int:
        """Searches of each law."""

    @property
    def seed(self) -> int:
        """Source of all randomness."""

    @property
    def sampler(self) -> Sampler:
        """Sampler of optuna."""

    @property
    def infos(self) -> tuple[MetricInfo, ...]:
        """Metrics that are made small."""

    @property
    def constraints(self) -> tuple[Claim, ...]:
        """Constraints that every run must keep."""

    @property
    def draws(self) -> int:
        """Draws of each condition."""


class Evaluation(NamedTuple):
    """Scores of a set of gains on the draws of tuning."""

    number: int
    """0 for the gains that the law had."""
    gains: Mapping[str, Vector]
    objectives: tuple[float, ...]
    """Geometric mean of each objective over conditions and draws; infinite where a run failed or has no value."""
    worst: tuple[float, ...]
    """Worst value of the metric of each constraint; NaN where a run failed."""
    failed: int
    """Runs that failed."""
    lost: float
    """Share of the time of all runs that was left when they failed [1]."""
    broken: float
    """By how much constraints are broken, as shares of their limits; 0 where all are kept."""

    @property
    def feasible(self) -> bool:
        """Whether no run fails and every constraint is kept."""
        return not self.broken and all(map(math.isfinite, self.objectives))

    @property
    def scores(self) -> tuple[float, ...]:
        """Score of each objective, by which sets of gains are ordered: less is better, and feasibility comes first."""
        if self.failed:
            return (FAILED * (1.0 + self.lost),) * len(self.objectives)
        if not self.feasible:
            return (BROKEN + min(self.broken, 0.5 * FAILED),) * len(self.objectives)
        return tuple(math.log(max(x, LEAST)) for x in self.objectives)


def evaluation_of(number: int, gains: Mapping[str, Vector], runs: Sequence[Run], budget: Budget) -> Evaluation:
    """Return what a set of gains is worth.

    Args:
        number: Its number.
        gains: The gains.
        runs: Its runs; their metrics are the objectives and then those of the constraints.
        budget: What is searched.
    """
    columns = list(zip(*(run.values for run in runs), strict=True))
    count, failed = len(budget.infos), sum(run.failed for run in runs)
    objectives = tuple(math.inf if any(map(math.isnan, own)) else geometric(own) for own in columns[:count])
    worst = tuple(
        math.nan if any(map(math.isnan, own)) else max(own) if claim.info.better == "lower" else min(own)
        for claim, own in zip(budget.constraints, columns[count:], strict=True)
    )
    broken = math.fsum(excess(claim, x) for claim, x in zip(budget.constraints, worst, strict=True))
    lost = sum(run.lost for run in runs) / len(runs)
    if not failed and not all(map(math.isfinite, objectives)):
        broken += 1.0
    return Evaluation(number, gains, objectives, worst, failed, lost, broken)


def geometric(values: Sequence[float]) -> float:
    """Return the geometric mean of numbers, those below `LEAST` taken as that."""
    return math.exp(math.fsum(math.log(max(x, LEAST)) for x in values) / len(values))


def excess(claim: Claim, value: float) -> float:
    """Return by how much a value breaks a constraint, as a share of its limit; 0 where it keeps it."""
    if claim.holds(value):
        return 0.0
    beyond = abs(value - claim.limit) / (abs(claim.limit) or 1.0)
    return 1.0 if math.isnan(beyond) else max(beyond, 1e-9)


class Trials:
    """Runs controllers under conditions; each thread keeps its plants, and how many there are changes nothing.

    Args:
        conditions: The conditions.
        metrics: Keys of the metrics that are looked at.
        pool: The threads.
    """

    def __init__(self, conditions: Sequence[Condition], metrics: Sequence[str], pool: ThreadPoolExecutor) -> None:
        self._conditions, self._pool, self._own = tuple(conditions), pool, threading.local()
        self._metrics, self._rows = tuple(metrics), [METRICS.names().index(key) for key in metrics]
        self._steps = 1000 * sum(condition.experiment.n_steps for condition in conditions)

    def __call__(
        self,
        asked: Sequence[Controller],
        draws: range,
        ended: Callable[[int, int], None] = lambda done, total: None,
    ) -> list[list[Run]]:
        """Return the runs of each controller: of each draw in turn those of all conditions.

        Args:
            asked: The controllers, with gains.
            draws: Numbers of the draws.
            ended: Called with the number of runs that ended, and of all.
        """
        jobs = [(own, i, draw) for own in asked for draw in draws for i in range(len(self._conditions))]
        found, size = list[Run](), len(draws) * len(self._conditions)
        for run in self._pool.map(self._run, jobs):
            found.append(run)
            ended(len(found), len(jobs))
        return [found[first : first + size] for first in range(0, len(found), size)]

    def _run(self, job: tuple[Controller, int, int]) -> Run:
        controller, place, draw = job
        if not hasattr(self._own, "runners"):
            self._own.runners = {}
        runners: dict[int, Runner] = self._own.runners
        if place not in runners:
            runners[place] = Runner(1, self._steps)
        experiment = self._conditions[place].experiment
        (ended,) = runners[place].ended(altered(with_draw(experiment, draw), controllers=(controller,)))
        if ended.record is None:
            return Run(1.0 - ended.failed_at / experiment.n_steps, (math.nan,) * len(self._rows))
        return Run(0.0, tuple(headlines(measured(ended.record, self._metrics))[self._rows].tolist()))


@dataclass
class Tuned:
    """The searches of one law."""

    controller: Controller
    """As it was."""
    box: Box
    """Where its gains were looked for."""
    searches: list[list[Evaluation]] = field(default_factory=list)
    """Of each seed the evaluations in order; the first is of the gains that the law had."""

    @property
    def start(self) -> Evaluation:
        """The evaluation of the gains that the law had."""
        return self.searches[0][0]

    @property
    def bests(self) -> list[Evaluation]:
        """The best of each seed, by the first objective; the earliest of equal ones."""
        return [min(own, key=lambda one: one.scores[0]) for own in self.searches]

    @property
    def seed(self) -> int:
        """Number of the seed that found the best."""
        bests = self.bests
        return min(range(len(bests)), key=lambda i: bests[i].scores[0])

    @property
    def best(self) -> Evaluation:
        """The best of all."""
        return self.bests[self.seed]

    @property
    def tuned(self) -> Controller:
        """The controller with the best gains."""
        return altered(self.controller, gains=dict(self.best.gains))

    @property
    def front(self) -> list[tuple[int, Evaluation]]:
        """Number of the seed and evaluation of the feasible ones than which none is better in both of two objectives.

        They are in the order of the first objective; of equal ones it is the first that was found.
        """
        known = dict[tuple[float, ...], tuple[int, Evaluation]]()
        for seed, search in enumerate(self.searches):
            for one in search:
                if one.feasible:
                    known.setdefault(one.objectives[:2], (seed, one))
        pairs = [(x, y) for x, y in known]
        return [known[pair] for pair in sorted(pairs[i] for i in undominated(pairs))]


class Judgement(NamedTuple):
    """Scores of gains in draws that no law was tuned on."""

    draws: tuple[tuple[float | None, ...], ...]
    """Of each objective the geometric mean over the conditions of each draw; None where a run of the draw failed."""
    failed: int
    """Runs that failed, of `runs`."""
    runs: int
    broken: int = 0
    """Runs that completed and break a constraint."""

    def mean(self, objective: int = 0) -> Ratio | None:
        """Return the geometric mean of an objective over the draws with its interval; None where every draw failed."""
        known = [x for x in self.draws[objective] if x is not None]
        return geometric_mean(known)._replace(failed=(self.failed, 0)) if known else None


def judge(
    controllers: Sequence[Controller],
    conditions: Sequence[Condition],
    metrics: Sequence[str],
    draws: range,
    pool: ThreadPoolExecutor,
    constraints: Sequence[Claim] = (),
) -> list[Judgement]:
    """Return what controllers are worth in draws that no law was tuned on.

    Args:
        controllers: The controllers, with gains.
        conditions: What each is run under in every draw.
        metrics: Keys of the objectives.
        draws: The draws, from `HELD` on.
        pool: The threads.
        constraints: What every run should keep.

    Raises:
        ConfigError: laws may have been tuned on one of the draws.
    """
    if draws.start < HELD:
        raise ConfigError([Problem("", "tune.test", f"draws before {HELD} are tuned on", wanted="others")])
    found, count = list[Judgement](), len(conditions)
    keys = [*metrics, *(claim.metric for claim in constraints)]
    for runs in Trials(conditions, keys, pool)(controllers, draws):
        blocks = [runs[first : first + count] for first in range(0, len(runs), count)]
        values = tuple(tuple(_over(block, i) for block in blocks) for i in range(len(metrics)))
        kept = [run.failed or _keeps(constraints, run.values[len(metrics) :]) for run in runs]
        found.append(Judgement(values, sum(run.failed for run in runs), len(runs), kept.count(False)))
    return found


def _keeps(constraints: Sequence[Claim], values: Sequence[float]) -> bool:
    return all(claim.holds(x) for claim, x in zip(constraints, values, strict=True))


def _over(runs: Sequence[Run], metric: int) -> float | None:
    values = [run.values[metric] for run in runs]
    return None if any(map(math.isnan, values)) else geometric(values)


Place: TypeAlias = tuple[str, int]
"""Controller and number of the seed."""


def box_of(experiment: Experiment, controller: Controller) -> Box:
    """Return where the gains of a controller are looked for: it depends on the arm, the control period and the chain.

    Args:
        experiment: What it is part of.
        controller: The controller.
    """
    arm, run = load_model(experiment.plant.model), experiment.run
    return Box(controller.law, arm, run.control_period, experiment.chain, controller.options, controller.gains)


@contextmanager
def threads(workers: int) -> Iterator[ThreadPoolExecutor]:
    """Have threads; what waits for one is dropped when the work is interrupted."""
    pool = ThreadPoolExecutor(workers)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def tune_laws(
    base: Experiment,
    conditions: Sequence[Condition],
    budget: Budget,
    pool: ThreadPoolExecutor,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
    known: Mapping[tuple[str, int, int], Evaluation] | None = None,
    told: Callable[[Tuned, int, Sequence[Evaluation]], None] = lambda law, seed, found: None,
) -> list[Tuned]:
    """Tune every controller of an experiment alike: the same evaluations, conditions, draws and seeds.

    The gains that a law has are its first evaluation, so that tuning never ends worse than it began; the search is not
    told of them. Results do not depend on the number of threads.

    Args:
        base: Controllers with gains, arm, control period and chain, on which the boxes depend.
        conditions: What every set of gains is run under.
        budget: What is searched, and for how long.
        pool: The threads; see `threads`.
        progress: Called with what is done, the number of evaluations that are made, and of all.
        known: (controller, number of the seed, number) -> evaluations that need not be made again.
        told: Called with a law, which has them already, the number of a seed and its next evaluations, known ones too.

    Raises:
        ConfigError: there are so many draws that laws are judged on some of them, or the sampler is not installed.
        ResultError: a known evaluation is not the one that the search asks for.
    """
    if budget.draws > HELD:
        raise ConfigError([Problem("", "tune.draws", f"draws from {HELD} on are judged on, none tuned on")])
    check_method([budget.sampler], "tune.sampler")
    known, draws = known or {}, range(budget.draws)
    keys = [info.key for info in budget.infos] + [claim.metric for claim in budget.constraints]
    trials = Trials(conditions, keys, pool)
    tuned = {own.name: Tuned(own, box_of(base, own)) for own in base.controllers}
    total, done, what = len(tuned) * budget.seeds * budget.evaluations, 0, "gains as they are"

    def evaluate(asked: Sequence[tuple[str, int, int, Mapping[str, Vector]]]) -> list[Evaluation]:
        missing = [one for one in asked if one[:3] not in known]
        changed = [altered(tuned[name].controller, gains=dict(gains)) for name, *_, gains in missing]
        ran = trials(changed, draws, lambda ended, of: progress(f"{what}: loop {ended} of {of}", done, total))
        made = {one[:3]: evaluation_of(one[2], one[3], runs, budget) for one, runs in zip(missing, ran, strict=True)}
        made |= {one[:3]: known[one[:3]] for one in asked if one[:3] in known}
        for one in asked:
            if made[one[:3]].gains != one[3]:
                raise ResultError(f"evaluation {one[2]} of '{one[0]}' has other gains than are asked for: {OTHER}")
        return [made[one[:3]] for one in asked]

    def note(place: Place, _points: Sequence[Point], found: Sequence[Evaluation]) -> bool:
        nonlocal done
        name, seed = place
        done += len(found)
        tuned[name].searches[seed].extend(found)
        told(tuned[name], seed, found)
        progress(f"'{name}'", done, total)
        return False

    def run(points: Sequence[tuple[Place, Point]]) -> list[Evaluation]:
        counted = dict[Place, int]()
        asked = list[tuple[str, int, int, Mapping[str, Vector]]]()
        for (name, seed), point in points:
            number = counted.get((name, seed), len(tuned[name].searches[seed]))
            counted[name, seed] = number + 1
            asked.append((name, seed, number, tuned[name].box.gains(point)))
        return evaluate(asked)

    starts = evaluate([(name, 0, 0, own.controller.gains) for name, own in tuned.items()])
    for (name, own), start in zip(tuned.items(), starts, strict=True):
        own.searches = [[] for _ in range(budget.seeds)]
        for seed in range(budget.seeds):
            note((name, seed), [], [start])
    searches = {
        (name, i): sampler_search(
            budget.sampler, len(own.box.sides), budget.evaluations - 1, len(budget.infos), budget.seed + i
        )
        for name, own in tuned.items()
        for i in range(budget.seeds)
        if own.box.sides
    }
    what = "next gains"
    drive(searches, run, lambda one: one.scores, note)
    return list(tuned.values())
