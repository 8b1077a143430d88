"""Running an arena: each law tuned on a chain, the gains of each level picked, and judged on the sealed draws."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from torquebench.arena.ranking import best_at
from torquebench.arena.record import Judged, Row, Values, digest_of, plain_gains, source_of, stored
from torquebench.arena.study import Study, Track
from torquebench.experiment.arena_section import Arena
from torquebench.experiment.controllers import Controller
from torquebench.experiment.store import atomic_write
from torquebench.experiment.tune_section import Condition
from torquebench.experiment.values import from_json
from torquebench.keys import altered
from torquebench.laws import find_law
from torquebench.statistics import undominated
from torquebench.sweep.tune import Evaluation, Run, Trials, tune_laws

Tell = Callable[[str, int], None]
"""Is told what is being done, and how many closed loops were run since the last call."""


def loops_of(study: Study, track: Track) -> tuple[int, int]:
    """Return how many closed loops an entry takes on a chain: to tune it, and at most to judge it.

    Args:
        study: The study.
        track: The chain.
    """
    asked = study.asked
    tuning = asked.seeds * asked.evaluations * asked.draws * len(track.training)
    return tuning, _most(asked) * sum(_draws(asked, condition) for condition in track.tests)


def _most(asked: Arena) -> int:
    """Return how many sets of gains of an entry are judged at most."""
    return 1 + asked.seeds * len(asked.levels)


def _draws(asked: Arena, condition: Condition) -> int:
    return asked.tests if condition.experiment.is_drawn else 1


def run_rows(
    study: Study,
    wanted: Sequence[tuple[Track, Controller]],
    pool: ThreadPoolExecutor,
    folder: Path | None = None,
    tell: Tell = lambda what, loops: None,
) -> Iterator[Row]:
    """Tune and judge entries, one after another; rows that a folder has are read from there.

    Args:
        study: The study.
        wanted: Chain, with its tests sealed, and entry of each row.
        pool: The threads; see `threads`. Rows do not depend on how many there are.
        folder: Where each row is stored as soon as it is done; None for nowhere.
        tell: Is told the progress.
    """
    for track, controller in wanted:
        path = None if folder is None else folder / f"{track.name}--{controller.name}.json"
        if path is not None and path.is_file():
            tell(f"{track.name}: '{controller.name}'", sum(loops_of(study, track)))
            yield from_json(Row, path.read_bytes())
            continue
        row = run_row(study.asked, track, controller, pool, tell)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write(path, json.dumps(dataclasses.asdict(row)).encode())
        yield row


def run_row(asked: Arena, track: Track, controller: Controller, pool: ThreadPoolExecutor, tell: Tell) -> Row:
    """Tune and judge one entry on one chain.

    Args:
        asked: The section.
        track: The chain, with its tests sealed.
        controller: The entry, with the gains that it has by itself.
        pool: The threads.
        tell: Is told the progress.
    """
    each, before, name = asked.draws * len(track.training), 0, f"{track.name}: '{controller.name}'"

    def told(_what: str, done: int, _total: int) -> None:
        nonlocal before
        tell(f"tuning {name}", (done - before) * each)
        before = done

    base = altered(track.base, controllers=(controller,))
    training = [altered_alone(condition, controller) for condition in track.training]
    (tuned,) = tune_laws(base, training, asked, pool, told)
    best = [tuned.start]
    seeds: list[int | None] = [None]
    fronts = []
    for seed, found in enumerate(tuned.searches):
        fine = [one for one in found if one.feasible]
        front = [fine[i] for i in undominated([_point(one) for one in fine])]
        front.sort(key=_point)
        fronts.append(tuple((stored(x) or 0.0, stored(y) or 0.0) for x, y in map(_point, front)))
        points = [_point(one) for one in front]
        picked = dict.fromkeys(best_at(points, 100.0 * level) for level in asked.levels)
        own = [front[i] for i in picked if i is not None]
        best += own
        seeds += [seed] * len(own)
    tests = _judge(asked, track, [altered(controller, gains=dict(one.gains)) for one in best], pool)
    tell(f"judging {name}", _most(asked) * sum(_draws(asked, condition) for condition in track.tests))
    law = find_law(controller.law)
    length = sum(condition.experiment.run.duration for condition in track.training)
    count = asked.seeds * asked.evaluations * asked.draws
    return Row(
        chain=track.name,
        entry=controller.name,
        law=controller.law,
        options=dict(controller.options),
        fuzzy=controller.fuzzy,
        source=source_of(law),
        digest=digest_of(law),
        loops=count * len(track.training),
        seconds=count * length,
        fronts=tuple(fronts),
        judged=tuple(
            Judged(
                seed=seed,
                gains=plain_gains(one.gains),
                chattering=stored(one.objectives[1]),
                error=stored(one.objectives[0]),
                values=values,
            )
            for seed, one, values in zip(seeds, best, tests, strict=True)
        ),
    )


def altered_alone(condition: Condition, controller: Controller) -> Condition:
    """Return a condition with one controller alone."""
    return condition._replace(experiment=altered(condition.experiment, controllers=(controller,)))


def _point(one: Evaluation) -> tuple[float, float]:
    """Return chattering and error of an evaluation."""
    return one.objectives[1], one.objectives[0]


def _judge(asked: Arena, track: Track, controllers: Sequence[Controller], pool: ThreadPoolExecutor) -> list[Values]:
    """Return what came of each set of gains on the test draws; equal ones are run once."""
    unlike = list({repr(one): one for one in controllers}.values())
    found: list[Values] = [{} for _ in unlike]
    for condition in track.tests:
        trials = Trials([altered_alone(condition, unlike[0])], asked.stored, pool)
        for values, runs in zip(found, trials(unlike, range(_draws(asked, condition))), strict=True):
            values[condition.name] = {
                metric: tuple(_value(run, i) for run in runs) for i, metric in enumerate(asked.stored)
            }
    return [found[next(i for i, own in enumerate(unlike) if repr(own) == repr(one))] for one in controllers]


def _value(run: Run, place: int) -> float | None:
    return None if run.failed else stored(run.values[place])
