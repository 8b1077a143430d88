"""Tuning from Python: every law of a config tuned alike, judged on draws that none was tuned on, and stored."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.dump import plain
from torquebench.experiment.falsify_section import in_unit
from torquebench.experiment.folder import write_experiment
from torquebench.experiment.run import Progress
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import (
    MANIFEST,
    RunDirectory,
    atomic_write,
    claim_folder,
    json_bytes,
)
from torquebench.experiment.sweep_section import with_draw
from torquebench.experiment.tune_section import HELD, TuningStudy, take_tune
from torquebench.keys import Vector, altered
from torquebench.metrics import MetricInfo
from torquebench.report.figures.files import Job, Wish, figure_files
from torquebench.report.figures.style import Unit
from torquebench.report.figures.tuning import draw_fronts, draw_tuning
from torquebench.statistics import Ratio, paired_ratio
from torquebench.sweep.search import check_method
from torquebench.sweep.tune import Evaluation, Judgement, Tuned, judge, threads, tune_laws
from torquebench.sweeps import document_from

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

TUNED, STUDY, TABLE, NUMBERS = "tuned.yaml", "study.json", "evaluations.csv", "tune.json"
"""The experiment with the gains that were found, what was asked for, every evaluation, and all other numbers."""
MOST_WORDS = 4000
"""Characters that a description may have."""


@dataclass(frozen=True)
class Tuning:
    """The laws of a config, tuned alike."""

    study: TuningStudy
    laws: Sequence[Tuned]
    """In the config's order."""
    untuned: Mapping[str, Judgement]
    """Controller -> what its own gains are worth in draws that no law was tuned on."""
    tuned: Mapping[str, Judgement]
    """The same of the gains that were found."""

    @property
    def info(self) -> MetricInfo:
        """The objective by which gains are chosen, the first."""
        return self.study.asked.infos[0]

    @property
    def seconds(self) -> float:
        """Closed loop that each law was tuned with [s]."""
        asked, starts_again = self.study.asked, self.study.asked.seeds - 1
        return _seconds(self.study) * (asked.evaluations * asked.seeds - starts_again)

    @property
    def experiment(self) -> Experiment:
        """The config with the gains that were found, in the first draw that no law was tuned on."""
        return _tuned_experiment(self.study, self.laws, f"Gains found by torquebench tune: {self._budget()}")

    def law(self, controller: str) -> Tuned:
        """Return the searches of a controller.

        Raises:
            ResultError: there is no such controller.
        """
        found = {own.controller.name: own for own in self.laws}
        if controller not in found:
            raise ResultError(f"no controller '{controller}': there are {', '.join(found)}")
        return found[controller]

    def ratio(self, controller: str) -> Ratio | None:
        """Return the objective of the tuned gains over that of the law's own, paired by draw; None if never both."""
        pairs = self.tuned[controller].draws[0], self.untuned[controller].draws[0]
        return paired_ratio(*pairs) if any(None not in pair for pair in zip(*pairs, strict=True)) else None

    def ranking(self, judged: Mapping[str, Judgement]) -> list[str]:
        """Return controllers, the best first: fewest failed runs, then least objective.

        Those that break a constraint in half of the runs or more come after those with as few failures that do not.

        Args:
            judged: `untuned` or `tuned`.
        """

        def key(name: str) -> tuple[int, bool, float]:
            own, mean = judged[name], judged[name].mean()
            return own.failed, 2 * own.broken >= own.runs, math.inf if mean is None else mean.ratio

        return sorted(judged, key=key)

    def number(self, value: float) -> str:
        """Return a value of the objective with its unit."""
        return in_unit(self.info.scale * value, self.info.shown_unit)

    def _budget(self) -> str:
        asked = self.study.asked
        kept = "".join(f", {claim.text}" for claim in asked.constraints)
        names = ", ".join(condition.name for condition in self.study.training)
        return (
            f"{asked.evaluations} evaluations x {asked.seeds} seeds of each law ({asked.sampler}, seed {asked.seed}), "
            f"{self.seconds:g} s of closed loop; least {' and '.join(asked.objectives)}{kept} in {asked.draws} "
            f"draw{'s' * (asked.draws != 1)} of {names}"
        )

    def to_json(self) -> dict[str, Any]:
        """Return everything but the single evaluations, as ``tune.json`` has it; metrics in SI units."""
        asked, study = self.study.asked, self.study
        ranks = {"untuned": self.ranking(self.untuned), "tuned": self.ranking(self.tuned)}
        return {
            "objectives": {info.key: info.unit for info in asked.infos},
            "constraints": [f"{claim.metric} {claim.sign} {claim.limit!r}" for claim in asked.constraints],
            "sampler": asked.sampler,
            "evaluations": asked.evaluations,
            "seeds": [asked.seed + i for i in range(asked.seeds)],
            "closed_loop_seconds": self.seconds,
            "training": {"draws": [0, asked.draws], "conditions": [one.name for one in study.training]},
            "test": {"draws": [HELD, HELD + asked.test.draws], "conditions": [one.name for one in study.judged]},
            "ranking": ranks,
            "controllers": {own.controller.name: self._json(own) for own in self.laws},
        }

    def _json(self, own: Tuned) -> dict[str, Any]:
        name, asked = own.controller.name, self.study.asked

        def evaluation(one: Evaluation, seed: int) -> dict[str, Any]:
            found = zip(asked.objectives, one.objectives, strict=True)
            values = {key: x if math.isfinite(x) else None for key, x in found}
            facts = {"feasible": one.feasible, "failed": one.failed, "gains": dict(one.gains)}
            return {"seed": asked.seed + seed, "evaluation": one.number, **values, **facts}

        def judgement(one: Judgement) -> dict[str, Any]:
            means = [one.mean(i) for i in range(len(asked.objectives))]
            found = {
                key: {"mean": mean and [mean.ratio, mean.low, mean.high], "draws": list(draws)}
                for key, mean, draws in zip(asked.objectives, means, one.draws, strict=True)
            }
            return {"runs": one.runs, "failed": one.failed, "broken": one.broken, **found}

        ratio = self.ratio(name)
        fronts = len(asked.objectives) > 1
        return {
            "law": own.controller.law,
            "box": own.box.to_json(),
            "untuned": evaluation(own.start, 0),
            "tuned": evaluation(own.best, own.seed),
            "seeds": [evaluation(one, i) for i, one in enumerate(own.bests)],
            **({"front": [evaluation(one, seed) for seed, one in own.front]} if fronts else {}),
            "test": {"untuned": judgement(self.untuned[name]), "tuned": judgement(self.tuned[name])},
            "test_ratio": ratio and [ratio.ratio, ratio.low, ratio.high],
        }

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each evaluation, as ``evaluations.csv`` has it."""
        import pandas as pd

        return pd.read_csv(io.BytesIO(_table(self.study, self.laws)))

    def figure(self) -> Figure:
        """Draw the best objective so far against the number of evaluations, the seeds of each law as a band."""
        courses = {
            own.controller.name: [
                list(accumulate((one.objectives[0] if one.feasible else math.inf for one in search), min))
                for search in own.searches
            ]
            for own in self.laws
        }
        info, asked = self.info, self.study.asked
        return draw_tuning(
            courses,
            self.study.base.laws,
            info.title,
            Unit(info.shown_unit, info.scale),
            (f"{self.study.base.name}: the best gains found so far", self._budget()),
            f"{asked.seeds} seeds: least to most",
        )

    def fronts(self) -> Figure | None:
        """Draw the front of each law, one objective against the other; None with a single one."""
        infos = self.study.asked.infos
        if len(infos) == 1:
            return None
        return draw_fronts(
            {own.controller.name: [one.objectives for _, one in own.front] for own in self.laws},
            {own.controller.name: own.start.objectives for own in self.laws},
            self.study.base.laws,
            [(info.title, Unit(info.shown_unit, info.scale)) for info in infos],
            (f"{self.study.base.name}: what tuning can trade", self._budget()),
        )

    def write(self, directory: RunDirectory, progress: Progress | None = None) -> None:
        """Write everything: ``tuned.yaml``, numbers, evaluations and figures.

        Args:
            directory: Where to.
            progress: Told each figure that is drawn.
        """
        write_experiment(directory, self.experiment, TUNED)
        directory.write(TABLE, _table(self.study, self.laws))
        directory.write(NUMBERS, json_bytes(self.to_json()))
        figures: dict[str, Job] = {"convergence": self.figure, "fronts": self.fronts}
        for file, content in figure_files(figures, Wish(), progress):
            directory.write(file, content)
        directory.finish({"name": self.study.base.name, "tune": True})

    def __repr__(self) -> str:
        """Say what each law's objective was and is, in draws that none was tuned on."""

        def mean(judged: Mapping[str, Judgement], name: str) -> str:
            found = judged[name].mean()
            return "fails" if found is None else self.number(found.ratio)

        each = (f"{name} {mean(self.untuned, name)} -> {mean(self.tuned, name)}" for name in self.ranking(self.tuned))
        return f"<Tuning {self.study.base.name}: {self.info.key} {', '.join(each)}>"


def _seconds(study: TuningStudy) -> float:
    """Return the closed loop of one evaluation [s]."""
    return study.asked.draws * sum(condition.experiment.run.duration for condition in study.training)


def _tuned_experiment(study: TuningStudy, laws: Sequence[Tuned], made: str) -> Experiment:
    """Return the config with the best gains so far.

    Args:
        study: The study.
        laws: What was found.
        made: How, in words.
    """
    info, parts = study.asked.infos[0], [f"{study.base.description} " if study.base.description else "", f"{made}."]
    for own in laws:
        told = " -> ".join(_told(info, one) for one in (own.start, own.best))
        by = f"seed {study.asked.seed + own.seed}, evaluation {own.best.number}" if own.best.number else "its own gains"
        parts.append(f" {own.controller.name}: {told} ({by}).")
    experiment = with_draw(study.base, HELD)
    tuned = {own.controller.name: own.tuned for own in laws}
    controllers = tuple(tuned.get(keys.name, keys) for keys in experiment.controllers)
    return altered(experiment, description="".join(parts)[:MOST_WORDS], controllers=controllers, chosen={})


def _told(info: MetricInfo, one: Evaluation) -> str:
    if not math.isfinite(one.objectives[0]):
        return "failed"
    number = in_unit(info.scale * one.objectives[0], info.shown_unit)
    return number if one.feasible else f"({number}, which breaks a constraint)"


def _head(study: TuningStudy) -> list[str]:
    """Return the titles of the table's columns, but for those of gains."""
    asked = study.asked
    worst = [f"worst_{claim.metric}" for claim in asked.constraints]
    return ["controller", "seed", "evaluation", "feasible", "failed", "lost", "broken", *asked.objectives, *worst]


def _gain_names(study: TuningStudy) -> list[str]:
    return list(dict.fromkeys(name for keys in study.base.controllers for name in keys.gains))


def _row(study: TuningStudy, name: str, seed: int, one: Evaluation) -> list[str]:
    numbers = [one.lost, one.broken, *one.objectives, *one.worst]
    gains = {key: repr(x) if isinstance(x, float) else " ".join(map(repr, x)) for key, x in one.gains.items()}
    facts = [name, str(study.asked.seed + seed), str(one.number), str(one.feasible).lower(), str(one.failed)]
    return [*facts, *map(repr, numbers), *(gains.get(key, "") for key in _gain_names(study))]


def _lines(study: TuningStudy, rows: Sequence[Sequence[str]], head: bool = True) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if head:
        writer.writerow([*_head(study), *(f"gains.{name}" for name in _gain_names(study))])
    writer.writerows(rows)
    return text.getvalue().encode()


def _table(study: TuningStudy, laws: Sequence[Tuned]) -> bytes:
    """Return a row for each evaluation, as CSV: laws, seeds and numbers in order."""
    rows = [
        _row(study, own.controller.name, seed, one)
        for own in laws
        for seed, search in enumerate(own.searches)
        for one in search
    ]
    return _lines(study, rows)


def _stored(study: TuningStudy, path: Path) -> dict[tuple[str, int, int], Evaluation]:
    """Return the evaluations of an unfinished table; a last line that was not written whole is left out.

    Raises:
        ResultError: another line is none of this study's.
    """
    if not path.is_file():
        return {}
    whole, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
    head, *rows = list(csv.reader(whole.splitlines())) or [[]]
    gains, count = _gain_names(study), len(_head(study))
    if head != [*_head(study), *(f"gains.{name}" for name in gains)]:
        raise ResultError(f"{path}: has other columns than this study")
    found, objectives = dict[tuple[str, int, int], Evaluation](), len(study.asked.objectives)
    for line, row in enumerate(rows, 2):
        try:
            name, seed, number, _, failed, *numbers = row[:count]
            lost, broken, *values = map(float, numbers)
            known = {key: _vector(cell) for key, cell in zip(gains, row[count:], strict=True) if cell}
            found[name, int(seed) - study.asked.seed, int(number)] = Evaluation(
                int(number), known, tuple(values[:objectives]), tuple(values[objectives:]), int(failed), lost, broken
            )
        except ValueError as error:
            raise ResultError(f"{path}:{line}: cannot be read ({error})") from error
    return found


def _vector(cell: str) -> Vector:
    numbers = tuple(map(float, cell.split(" ")))
    return numbers[0] if len(numbers) == 1 else numbers


def _digest(study: TuningStudy) -> str:
    """Return the digest of all that decides the evaluations."""
    experiments = {one.name: plain(one.experiment) for one in (*study.training, *study.judged)}
    content = [repr(study.asked), plain(study.base), experiments]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def _claim(folder: Path, study: TuningStudy, resume: bool) -> RunDirectory:
    """Return the folder to write to: a new or empty one, or, to go on, one in which the same study was begun.

    Raises:
        ConfigError: it holds something else.
    """
    if resume and (folder / STUDY).is_file():
        if json.loads((folder / STUDY).read_bytes()).get("digest") != _digest(study):
            text = f"{folder} holds a tuning of another study, or of other changes"
            raise ConfigError([Problem("--resume", text=text, wanted="its own study, or another folder")])
        (folder / MANIFEST).unlink(missing_ok=True)
    elif resume:
        text = f"{folder}: no tuning was begun there ({STUDY} is missing)"
        raise ConfigError([Problem("--resume", text=text, wanted="the folder of one")])
    else:
        claim_folder(folder, study.base.name)
    directory = RunDirectory(folder)
    directory.write(STUDY, json_bytes({"name": study.base.name, "digest": _digest(study)}))
    return directory


def read_study(
    config: str | Path | Mapping[str, Any],
    changes: Mapping[str, Any] | Sequence[str] = (),
    outside: bool = False,
    plugins: Sequence[str | Path] = (),
) -> TuningStudy:
    """Return what a config's section ``tune`` asks for, checked; arguments as of `tune`.

    Raises:
        ConfigError: the config has mistakes, all of them at once.
    """
    return take_tune(document_from(config, changes, outside, plugins))


def tune(
    config: str | Path | Mapping[str, Any] | TuningStudy,
    *,
    changes: Mapping[str, Any] | Sequence[str] = (),
    workers: int | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    outside: bool = False,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
) -> Tuning:
    """Tune every law of a config alike, as its section ``tune`` asks, and judge the gains on draws of their own.

    Args:
        config: A YAML file, the name of a shipped config, the keys of one, or what `read_study` made of one.
        changes: Dotted key -> value, or edits ``key=value``, set before the check.
        workers: How many runs are made at once; None for one per core. Results do not depend on it.
        folder: Where to store it, new or empty; None to store nothing.
        resume: Whether the folder is one in which this study was begun: what is there is not run again.
        outside: Whether the arm's file may be outside the folder of the config.
        plugins: Python files that register kinds of your own.
        progress: Called with what is done, how many evaluations are made, and of how many.

    Raises:
        ConfigError: the config has mistakes, all of them at once; the sampler's package is not installed; or the folder
            holds something else.
        ResultError: what is stored in the folder was altered, or another version made it.
        KeyboardInterrupt: it was interrupted; the folder keeps every evaluation, and the best gains so far.
    """
    study = config if isinstance(config, TuningStudy) else read_study(config, changes, outside, plugins)
    asked, names = study.asked, len(study.base.controllers)
    check_method([asked.sampler], "tune.sampler")
    directory = None if folder is None else _claim(Path(folder), study, resume)
    known = {} if directory is None else _stored(study, directory.folder / TABLE)
    report = (lambda what, done, total: None) if progress is None else progress
    total, found = names * (asked.evaluations * asked.seeds + 2), dict[str, Tuned]()
    with threads(workers or os.cpu_count() or 1) as pool, _log(directory, study, known) as log:

        def told(own: Tuned, seed: int, made: Sequence[Evaluation]) -> None:
            found[own.controller.name] = own
            log(own.controller.name, seed, made)

        try:
            laws = tune_laws(
                study.base, study.training, asked, pool, lambda what, done, _: report(what, done, total), known, told
            )
        except KeyboardInterrupt:
            if directory is not None and found:
                done = sum(len(search) for own in found.values() for search in own.searches)
                made = f"Interrupted after {done} of {names * asked.evaluations * asked.seeds} evaluations"
                write_experiment(directory, _tuned_experiment(study, list(found.values()), made), TUNED)
            raise
        judged: dict[str, tuple[Judgement, ...]] = {}
        draws = range(HELD, HELD + asked.test.draws)
        for i, own in enumerate(laws):
            report("judging", total - 2 * (names - i), total)
            changed = own.tuned.gains != own.controller.gains
            pair = [own.controller, own.tuned] if changed else [own.controller]
            judged[own.controller.name] = tuple(
                judge(pair, study.judged, asked.objectives, draws, pool, asked.constraints)
            )
        report("judging", total, total)
    untuned, tuned = ({name: both[i] for name, both in judged.items()} for i in (0, -1))
    tuning = Tuning(study, laws, untuned, tuned)
    if directory is not None:
        tuning.write(directory)
    return tuning


@contextmanager
def _log(
    directory: RunDirectory | None, study: TuningStudy, known: Mapping[tuple[str, int, int], Evaluation]
) -> Iterator[Callable[[str, int, Sequence[Evaluation]], None]]:
    """Have what adds the evaluations of a law and seed to the table in a folder, those that are known left out."""
    if directory is None:
        yield lambda name, seed, made: None
        return
    path = directory.folder / TABLE
    atomic_write(path, _lines(study, [_row(study, name, seed, one) for (name, seed, _), one in known.items()]))
    with path.open("ab") as file:

        def add(name: str, seed: int, made: Sequence[Evaluation]) -> None:
            rows = [_row(study, name, seed, one) for one in made if (name, seed, one.number) not in known]
            file.write(_lines(study, rows, head=False))
            file.flush()

        yield add
