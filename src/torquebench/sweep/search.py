"""Searches of a unit cube: CMA-ES, random points, the way back from what was found, and the samplers of optuna."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np

from torquebench.errors import ConfigError, Problem
from torquebench.shipped import how_to_install

Point: TypeAlias = tuple[float, ...]
"""A number from 0 to 1 for each dimension."""
S = TypeVar("S")
Asking: TypeAlias = Generator[list[Point], Sequence[S], None]
"""Yields points, is sent the score of each, and ends when its evaluations are used up."""
Search: TypeAlias = Asking[float]
"""One for the highest score."""
Method: TypeAlias = Literal["cma", "corners", "random"]
METHODS: tuple[Method, ...] = ("cma", "corners", "random")
COMPARED: tuple[Method, ...] = ("cma", "random")
"""Those that are used unless others are asked for."""
TITLES: Mapping[Method, str] = {"cma": "CMA-ES", "corners": "random corners", "random": "random search"}
K = TypeVar("K")
T = TypeVar("T")

WIDTH = 0.3
"""Standard deviation of the first generation of CMA-ES."""
FIRST = 10
"""One in so many of the points of CMA-ES comes before it begins."""
FLIPS = (0.0, 0.05, 0.15, 0.5)
"""Chances that a number of a list is not at the same end as the one before."""
BATCH = 16
"""Points of a random search that are asked for at once."""
LOWEST = 1e300
"""Stands for minus infinity, of which CMA-ES cannot take a mean."""
HALVINGS = 5
"""Halvings of the way back in one dimension: to 1/32 of it."""
Sampler: TypeAlias = Literal["random", "tpe", "cma-es", "nsga-ii"]
"""A sampler of optuna."""
TOGETHER: Mapping[Sampler, int] = {"random": 8, "tpe": 4, "cma-es": 8, "nsga-ii": 16}
"""Sampler -> points that it is asked for at once, whatever runs them; of the last two a generation."""
NEEDS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "cma": (("cma",), "falsify"),
    **dict.fromkeys(("tpe", "nsga-ii"), (("optuna",), "tune")),
    "cma-es": (("optuna", "cmaes"), "tune"),
}
"""Method or sampler -> the packages that it needs, and the extra that has them."""


def check_method(methods: Sequence[str], place: str) -> None:
    """Refuse a method or sampler of which a package is not installed.

    Args:
        methods: Those that are wanted.
        place: Where they stand.

    Raises:
        ConfigError: one is not.
    """
    for method in methods:
        packages, extra = NEEDS.get(method, ((), ""))
        for package in packages:
            if importlib.util.find_spec(package) is None:
                other = f"--set {place}=random" if "." in place else f"{place} random"
                text = f"{method} needs the package {package}: {how_to_install(extra)}; {other} needs none"
                raise ConfigError([Problem(place, text=text)])


def corner(groups: Sequence[int], rng: np.random.Generator) -> list[float]:
    """Return a corner of the cube, drawn so that the numbers of a list often stay at one end.

    Each list begins at either end and goes over to the other one between two of its numbers with a chance that is drawn
    from `FLIPS`: so whole lists at one end are as likely as blocks of a few numbers, and as ends that are all drawn.

    Args:
        groups: Number of dimensions of each list, in order.
        rng: Source of all randomness.
    """
    found = list[float]()
    for size in groups:
        flips = rng.random(size) < rng.choice(FLIPS)
        found += ((rng.integers(2) + np.cumsum(flips)) % 2).astype(float).tolist()
    return found


def random_search(groups: Sequence[int], evaluations: int, rng: np.random.Generator, corners: bool = False) -> Search:
    """Search evenly drawn points, or, as these hardly ever come near a face, such points and corners in turn.

    Args:
        groups: As of `corner`.
        evaluations: Number of points.
        rng: Source of all randomness.
        corners: Whether every other point is a corner.
    """
    for first in range(0, evaluations, BATCH):
        batch = range(first, min(first + BATCH, evaluations))
        drawn = (corner(groups, rng) if corners and i % 2 else rng.random(sum(groups)).tolist() for i in batch)
        yield list(map(tuple, drawn))


def cma_search(groups: Sequence[int], evaluations: int, rng: np.random.Generator) -> Search:
    """Search by the covariance matrix adaptation evolution strategy (Hansen, arXiv:1604.00772) of the package `cma`.

    The first tenth of the points are the middle of the cube and corners; it begins at the worst of them. A number that
    leaves the cube is put on its face for the run, so that faces are reached. A search that has converged begins anew
    at the next worst of these points with twice the points in a generation (Auger and Hansen, CEC 2005).

    Args:
        groups: As of `corner`.
        evaluations: Number of points, those of the beginning included.
        rng: Source of all randomness.
    """
    import cma

    dimensions = sum(groups)
    inner = max(dimensions, 2)  # the package has none with a single one: a second one changes nothing
    options: dict[str, Any] = {
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # global random numbers are left alone
        "verbose": -10,  # and no file in the working folder is taken for options
        "verb_log": 0,
    }
    corners = [corner(groups, rng) for _ in range(min(max(evaluations // FIRST, 2), evaluations) - 1)]
    first = [tuple(point) for point in ([0.5] * dimensions, *corners)]
    scores = yield first
    starts = [first[i] for i in np.argsort(scores, kind="stable")]
    size, left = None, evaluations - len(first)
    while left:
        more: dict[str, Any] = {} if size is None else {"popsize": size}
        start = starts.pop() if starts else corner(groups, rng)
        strategy = cma.CMAEvolutionStrategy([*start, 0.5][:inner], WIDTH, options | more)
        size = strategy.popsize
        while left and not strategy.stop():
            asked = strategy.ask()
            points = [tuple(np.clip(point[:dimensions], 0.0, 1.0).tolist()) for point in asked[:left]]
            scores = yield points
            left -= len(points)
            if len(points) == size:
                strategy.tell(asked, [min(LOWEST, -score) for score in scores])
        size = 2 * size


def start_search(method: Method, groups: Sequence[int], evaluations: int, seed: int) -> Search:
    """Return a search that has not begun.

    Args:
        method: One of `METHODS`.
        groups: As of `corner`.
        evaluations: Number of points.
        seed: Source of all randomness.
    """
    rng = np.random.default_rng([seed, METHODS.index(method)])
    if method == "cma":
        return cma_search(groups, evaluations, rng)
    return random_search(groups, evaluations, rng, corners=method == "corners")


def sampler_search(
    sampler: Sampler, dimensions: int, evaluations: int, objectives: int, seed: int
) -> Asking[tuple[float, ...]]:
    """Search for the least scores, finite ones, by a sampler of optuna.

    Args:
        sampler: The sampler; random needs no package.
        dimensions: Number of dimensions, at least one.
        evaluations: Number of points.
        objectives: Number of scores of a point.
        seed: Source of all randomness.
    """
    sizes = [min(TOGETHER[sampler], evaluations - i) for i in range(0, evaluations, TOGETHER[sampler])]
    if sampler == "random":
        rng = np.random.default_rng(seed)
        for size in sizes:
            yield [tuple(point) for point in rng.random((size, dimensions)).tolist()]
        return
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    samplers: dict[str, Callable[[], Any]] = {
        "tpe": lambda: optuna.samplers.TPESampler(seed=seed),
        "cma-es": lambda: optuna.samplers.CmaEsSampler(seed=seed, popsize=TOGETHER["cma-es"]),
        "nsga-ii": lambda: optuna.samplers.NSGAIISampler(seed=seed, population_size=TOGETHER["nsga-ii"]),
    }
    study = optuna.create_study(sampler=samplers[sampler](), directions=["minimize"] * objectives)
    space: dict[str, Any] = {str(i): optuna.distributions.FloatDistribution(0.0, 1.0) for i in range(dimensions)}
    for size in sizes:
        trials = [study.ask(space) for _ in range(size)]
        scores = yield [tuple(trial.params[key] for key in space) for trial in trials]
        for trial, own in zip(trials, scores, strict=True):
            study.tell(trial, list(own))


def shrink(found: Point, nominal: Point, still: Callable[[float], bool]) -> Search:
    """Go back from a point towards another one as far as its score allows; the last allowed point is where it ends.

    Each dimension, the least moved first, is set back whole where that is allowed; of those that are needed, the way is
    then halved.

    Args:
        found: Where to begin.
        nominal: Where to go.
        still: Whether a score is allowed.
    """
    here = list(found)
    order = sorted(range(len(found)), key=lambda i: abs(found[i] - nominal[i]))
    for i in order:
        if here[i] != nominal[i]:
            there = [*here[:i], nominal[i], *here[i + 1 :]]
            (score,) = yield [tuple(there)]
            here = there if still(score) else here
    for i in order:
        gone = nominal[i]  # too far
        for _ in range(HALVINGS if here[i] != nominal[i] else 0):
            there = [*here[:i], 0.5 * (here[i] + gone), *here[i + 1 :]]
            (score,) = yield [tuple(there)]
            if still(score):
                here = there
            else:
                gone = there[i]


def drive(
    searches: Mapping[K, Asking[S]],
    run: Callable[[list[tuple[K, Point]]], list[T]],
    score: Callable[[T], S],
    told: Callable[[K, Sequence[Point], Sequence[T]], bool],
) -> None:
    """Run searches side by side to their ends, the points of all of them in one batch.

    Args:
        searches: The searches.
        run: Evaluates points, each with the key of its search, in order.
        score: From what comes out to the score.
        told: Called with the key of a search, its points and what came out; true to end this search.
    """
    asked = dict[K, list[Point]]()
    for key, search in searches.items():
        if points := next(search, None):
            asked[key] = points
    while asked:
        out = run([(key, point) for key, points in asked.items() for point in points])
        following, first = dict[K, list[Point]](), 0
        for key, points in asked.items():
            own = out[first : first + len(points)]
            first += len(points)
            if told(key, points, own):
                searches[key].close()
                continue
            try:
                following[key] = searches[key].send([score(item) for item in own])
            except StopIteration:
                continue
        asked = following
