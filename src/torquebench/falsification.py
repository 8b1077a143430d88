"""Searches for the worst run of a law within stated bounds, and stores it with a config that replays it."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.experiment.falsify_section import Falsify, in_unit, take_falsify
from torquebench.experiment.folder import write_experiment
from torquebench.experiment.run import Progress
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import RunDirectory, claim_folder, json_bytes
from torquebench.metrics import MetricInfo
from torquebench.report.figures.convergence import draw_convergence
from torquebench.report.figures.files import Wish, figure_files
from torquebench.report.figures.style import Unit
from torquebench.sweep.falsify import FAILED, Hunt, Space, Tried, breaks, hunt
from torquebench.sweep.search import COMPARED, METHODS, TITLES, Method, check_method
from torquebench.sweeps import document_from

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORST, SMALLEST = "worst.yaml", "smallest.yaml"
"""Configs that replay the worst run that was found, and the least that does it too."""
TOLD = 3
"""Keys that a sentence names, the farthest moved first."""


@dataclass(frozen=True)
class Falsification:
    """The worst case of each law, and the least that makes it so."""

    space: Space
    """Variables that might change."""
    hunts: Sequence[Hunt]
    """Result of each controller."""

    @property
    def asked(self) -> Falsify:
        """The config's section."""
        return self.space.asked

    @property
    def info(self) -> MetricInfo:
        """The metric that was made worse."""
        return self.asked.info

    @property
    def broken(self) -> tuple[str, ...]:
        """Controllers for which a run broke the claim, or, where nothing is claimed, failed; their own run included."""
        return tuple(own.controller for own in self.hunts if breaks(self.asked, own.worst.score))

    @property
    def ratios(self) -> dict[Method, dict[str, float]]:
        """Method -> controller -> worst value of CMA-ES over that of the method, medians over the seeds.

        Where runs fail there is no ratio, and where a larger value is better.
        """
        found: dict[Method, dict[str, float]] = {}
        for own, method in itertools.product(self.hunts if self.info.better == "lower" else (), METHODS[1:]):
            cma, other = own.worst_of("cma"), own.worst_of(method)
            if cma and other:
                above, below = statistics.median(cma), statistics.median(other)
                if max(above, below) < FAILED and below > 0.0:
                    found.setdefault(method, {})[own.controller] = above / below
        return found

    def worst_case(self, controller: str) -> Experiment:
        """Return the experiment of the worst run that was found of a controller, with it alone."""
        return self.space.checked(self._hunt(controller).worst.point, controller)

    def smallest_case(self, controller: str) -> Experiment | None:
        """Return the experiment in which as little as possible is changed that a controller still does as badly.

        "As badly" is: it breaks the claim; without one it fails, or keeps nine tenths of the harm. None where nothing
        was found.
        """
        smallest = self._hunt(controller).smallest
        return None if smallest is None else self.space.checked(smallest.point, controller)

    def _hunt(self, controller: str) -> Hunt:
        return next(own for own in self.hunts if own.controller == controller)

    def worst_by(self, own: Hunt, method: Method) -> str:
        """Return the worst run of a method, over all seeds, in words, and, where a run ends it, after how many."""
        tried = [runs for (used, _), runs in own.tried.items() if used == method]
        runs = "" if self.asked.claim is None else f" in {sum(map(len, tried))} runs"
        return self.shown(_worst(one for own in tried for one in own)) + runs

    def sentence(self, own: Hunt) -> str:
        """Return what came out for a controller in one sentence."""
        shown, nominal = own.smallest or own.worst, self.shown(own.nominal)
        claim, name = self.asked.claim, f"'{own.controller}'"
        if claim is not None and own.controller not in self.broken:
            runs = sum(len(runs) for runs in own.tried.values())
            return f"{name} keeps {claim.text} in {runs} runs: {self.shown(own.worst)} at worst; nominal {nominal}"
        if claim is not None and breaks(self.asked, own.nominal.score):
            return f"{name} breaks {claim.text} as the config is: {nominal}"
        values, variables, parts = self.space.values(shown.point), self.space.variables, list[str]()
        for key, moved in self.moved(own).items():
            several = f"{len(moved)} of {sum(v.of == key for v in variables)} {key}"
            at = moved[0]
            parts.append(
                several if len(moved) > 1 else f"{variables[at].key} {in_unit(values[at], variables[at].unit)}"
            )
        more = f" and {len(parts) - TOLD} more" if len(parts) > TOLD else ""
        given = f" with {', '.join(parts[:TOLD])}{more}" if parts else ""
        if shown.score >= FAILED:
            return f"{name} fails{given}: {self.shown(shown)}; nominal {nominal}"
        if claim is None:
            worst = f", {self.shown(own.worst)} at worst" if shown is not own.worst else ""
            return f"{name} reaches {self.info.key} {self.shown(shown)}{given}{worst}; nominal {nominal}"
        verb = "exceeds" if claim.info.better == "lower" else "falls below"
        return f"{name} {verb} {claim.metric} {self.number(claim.limit)}{given}: {self.shown(shown)}; nominal {nominal}"

    def moved(self, own: Hunt) -> dict[str, list[int]]:
        """Return what the smallest counterexample of a controller needs: key -> variables, the farthest moved first."""
        variables, values = self.space.variables, self.space.values((own.smallest or own.worst).point)
        found = dict[str, list[int]]()
        far = [x != v.nominal and abs(v.share(x) - v.nominal_share) for v, x in zip(variables, values, strict=True)]
        for i in sorted(range(len(far)), key=lambda i: -far[i]):
            if far[i]:
                found.setdefault(variables[i].of, []).append(i)
        return found

    def number(self, value: float) -> str:
        """Return a value of the metric with its unit."""
        return in_unit(self.info.scale * value, self.info.shown_unit)

    def shown(self, tried: Tried) -> str:
        """Return how a run ended, or its metric."""
        return tried.outcome.lower() if math.isnan(tried.value) else self.number(tried.value)

    def to_json(self) -> dict[str, Any]:
        """Return everything but the single runs, as ``falsify.json`` has it; metrics in SI units."""
        asked, claim = self.asked, self.asked.claim
        facts = ("key", "unit", "low", "high", "log", "step", "nominal")
        return {
            "metric": self.info.key,
            "unit": self.info.unit,
            "claim": None if claim is None else claim.stated,
            "evaluations": asked.evaluations,
            "seeds": asked.seeds,
            "variables": [{fact: getattr(v, fact) for fact in facts} for v in self.space.variables],
            "controllers": {own.controller: self._json(own) for own in self.hunts},
            "cma_over": self.ratios,
        }

    def _json(self, own: Hunt) -> dict[str, Any]:
        def run(tried: Tried) -> dict[str, Any]:
            value, failed_at = (None if math.isnan(x) else x for x in (tried.value, tried.failed_at))
            values = list(self.space.values(tried.point))
            return {"outcome": tried.outcome, "failed_at": failed_at, "value": value, "variables": values}

        searches = [
            {"method": method, "seed": self.asked.seed + i, "runs": len(runs), "worst": run(_worst(runs))}
            for (method, i), runs in own.tried.items()
        ]
        return {
            "broken": own.controller in self.broken,
            "sentence": self.sentence(own),
            "nominal": run(own.nominal),
            "worst": run(own.worst),
            "smallest": None if own.smallest is None else run(own.smallest),
            "runs_to_shrink": len(own.back),
            "searches": searches,
        }

    def table(self) -> bytes:
        """Return a row for each run of each search, as CSV."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        head = ["controller", "method", "seed", "run", "outcome", "failed_at", self.info.key]
        writer.writerow([*head, *(variable.key for variable in self.space.variables)])
        for own in self.hunts:
            for (method, i), runs in own.tried.items():
                for k, one in enumerate(runs):
                    facts = ["" if math.isnan(x) else repr(x) for x in (one.failed_at, one.value)]
                    row = [own.controller, method, self.asked.seed + i, k, one.outcome, *facts]
                    writer.writerow([*row, *map(repr, self.space.values(one.point))])
        return text.getvalue().encode()

    def write(self, directory: RunDirectory, progress: Progress | None = None) -> None:
        """Write everything: for each law ``NAME/worst.yaml`` and ``NAME/smallest.yaml``, numbers, and the figure.

        Args:
            directory: Where to.
            progress: Told each figure that is drawn.
        """
        for own in self.hunts:
            below = _Below(directory, own.controller)
            write_experiment(below, self.worst_case(own.controller), WORST)
            if smallest := self.smallest_case(own.controller):
                write_experiment(below, smallest, SMALLEST)
        directory.write("evaluations.csv", self.table())
        directory.write("falsify.json", json_bytes(self.to_json()))
        for file, content in figure_files({"convergence": self.figure}, Wish(), progress):
            directory.write(file, content)
        directory.finish({"name": self.space.base.name, "falsify": True})

    def figure(self) -> Figure:
        """Draw the worst value found so far against the number of runs."""
        sign = 1.0 if self.info.better == "lower" else -1.0

        def value(score: float) -> float:
            return math.inf if score >= FAILED else math.nan if score == -math.inf else sign * score

        courses: dict[str, dict[str, list[list[float]]]] = {}
        for own in self.hunts:
            for (method, _), runs in own.tried.items():
                worst = itertools.accumulate((one.score for one in runs), max)
                courses.setdefault(own.controller, {}).setdefault(method, []).append([value(x) for x in worst])
        claim, count = self.asked.claim, len(self.space.variables)
        told = f"{count} variable{'s' * (count != 1)}, {self.asked.evaluations} runs a search"
        return draw_convergence(
            courses,
            {own.controller: own.nominal.value for own in self.hunts},
            self.info.title,
            Unit(self.info.shown_unit, self.info.scale),
            None if claim is None else claim.limit,
            TITLES,
            (f"{self.space.base.name}: the worst run found so far", told),
        )


class _Below(RunDirectory):
    """A folder below a run directory, which keeps its checksums."""

    def __init__(self, above: RunDirectory, name: str) -> None:
        super().__init__(above.folder / name)
        self._above, self._name = above, name
        self.folder.mkdir(parents=True, exist_ok=True)

    def write(self, name: str, content: bytes) -> None:
        """Write one file, `name` relative to the folder."""
        self._above.write(f"{self._name}/{name}", content)


def _worst(runs: Iterable[Tried]) -> Tried:
    return max(runs, key=lambda one: one.score)


def space_of(
    config: str | Path | Mapping[str, Any],
    changes: Mapping[str, Any] | Sequence[str] = (),
    outside: bool = False,
    plugins: Sequence[str | Path] = (),
) -> Space:
    """Return what may change in a config by its section ``falsify``, checked.

    Args:
        config: As of `falsify`, like the others.
        changes: Edits of keys.
        outside: Whether the arm's file may be outside the folder of the config.
        plugins: Python files that register kinds of your own.

    Raises:
        ConfigError: the config has mistakes, all of them at once.
    """
    document = document_from(config, changes, outside, plugins)
    return Space(document, take_falsify(document))


def falsify(
    config: str | Path | Mapping[str, Any],
    *,
    changes: Mapping[str, Any] | Sequence[str] = (),
    methods: Sequence[Method] = COMPARED,
    workers: int | None = None,
    folder: str | Path | None = None,
    outside: bool = False,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
) -> Falsification:
    """Search the worst run of each law of a config within the bounds of its section ``falsify``.

    Args:
        config: A YAML file, the name of a shipped config, or the keys of one.
        changes: Dotted key -> value, or edits ``key=value``, set before the check.
        methods: Some of ``cma``, ``random`` and ``corners``, with the same number of runs each.
        workers: How many runs are made at once; None for one per core. Results do not depend on it.
        folder: Where to store it, new or empty; None to store nothing.
        outside: Whether the arm's file may be outside the folder of the config.
        plugins: Python files that register kinds of your own.
        progress: Called with the worst so far, how many runs are done, and of how many.

    Raises:
        ConfigError: the config has mistakes, all of them at once; or a method's package is not installed.
    """
    check_method(methods, "methods")
    space = space_of(config, changes, outside, plugins)
    directory = None if folder is None else RunDirectory(claim_folder(Path(folder), space.base.name))
    run = (lambda what, done, total: None) if progress is None else progress
    found = Falsification(space, hunt(space, methods, workers or os.cpu_count() or 1, run))
    if directory is not None:
        found.write(directory)
    return found
