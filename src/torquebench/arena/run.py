"""Running an arena: each law tuned on a chain, the gains of each level picked, and judged on the sealed draws."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Callable, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from torquebench.arena.ranking import best_at
from torquebench.arena.record import Judged, Record, Row, digest_of, looks_at, picks, plain_gains, source_of, stored
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

Entry = tuple[Track, Controller]
"""A chain, with its tests sealed, and who is tuned and judged for it."""
Tell = Callable[[str, int], None]
"""Is told what is being done, and how many closed loops were run since the last call."""


def loops_of(study: Study, track: Track) -> tuple[int, int]:
    """Return how many closed loops an entry takes on a chain: to tune it, and at most to judge it.

    Args:
        study: The study.
        track: The chain.
    """
    asked = study.asked
    return asked.seeds * asked.evaluations * asked.draws * len(track.training), judging_of(asked, track)


def judging_of(asked: Arena, track: Track) -> int:
    """Return how many closed loops an entry takes on a chain at most to be judged."""
    return (1 + asked.seeds * len(asked.levels)) * sum(_draws(asked, condition) for condition in track.tests)


def _draws(asked: Arena, condition: Condition) -> int:
    return asked.tests if condition.experiment.is_drawn else 1


def run_rows(
    study: Study,
    wanted: Sequence[Entry],
    pool: ThreadPoolExecutor,
    beside: Record,
    folder: Path | None = None,
    tell: Tell = lambda what, loops: None,
    draws: Callable[[Row], Sequence[int]] | None = None,
) -> tuple[Row, ...]:
    """Tune entries one after another, then judge those of each chain together; what a folder has is read from there.

    Args:
        study: The study.
        wanted: Chain, with its tests sealed, and entry of each row; those of a chain follow each other.
        pool: The threads; see `threads`. Rows do not depend on how many there are.
        beside: The arena without these rows: how often they are compared, and with which others that it has.
        folder: Where each row is stored after its tuning and after each look; None for nowhere.
        tell: Is told the progress.
        draws: Tells in how many draws each of a row's sets of gains is judged; None for as many as comparing takes.
    """
    found = list[Row]()
    for _, group in itertools.groupby(wanted, lambda pair: pair[0].name):
        entries = list(group)
        rows = [_tuned(study, track, controller, pool, folder, tell) for track, controller in entries]
        jury = _Jury(study.asked, entries, pool, folder, tell)
        found += jury.judge(rows, beside) if draws is None else map(jury.run, entries, rows, map(draws, rows))
        tell(f"judging {jury.track.name}", jury.left)
    return tuple(found)


def _tuned(
    study: Study, track: Track, controller: Controller, pool: ThreadPoolExecutor, folder: Path | None, tell: Tell
) -> Row:
    """Return a row that is tuned, and as far judged as it was stored."""
    path = _path(folder, track, controller.name)
    if path is not None and path.is_file():
        tell(f"{track.name}: '{controller.name}'", loops_of(study, track)[0])
        return from_json(Row, path.read_bytes())
    row = tune_row(study.asked, track, controller, pool, tell)
    _store(path, row)
    return row


def _path(folder: Path | None, track: Track, entry: str) -> Path | None:
    return None if folder is None else folder / f"{track.name}--{entry}.json"


def _store(path: Path | None, row: Row) -> None:
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, json.dumps(dataclasses.asdict(row)).encode())


def tune_row(asked: Arena, track: Track, controller: Controller, pool: ThreadPoolExecutor, tell: Tell) -> Row:
    """Tune one entry on one chain, and pick its gains of each level; they are not judged yet.

    Args:
        asked: The section.
        track: The chain.
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
    best: list[tuple[int | None, Evaluation]] = [(None, tuned.start)]
    fronts = []
    for seed, found in enumerate(tuned.searches):
        fine = [one for one in found if one.feasible]
        front = [fine[i] for i in undominated([_point(one) for one in fine])]
        front.sort(key=_point)
        fronts.append(tuple((stored(x) or 0.0, stored(y) or 0.0) for x, y in map(_point, front)))
        points = [_point(one) for one in front]
        picked = dict.fromkeys(best_at(points, 100.0 * level) for level in asked.levels)
        best += [(seed, front[i]) for i in picked if i is not None]
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
                values={},
            )
            for seed, one in best
        ),
    )


def altered_alone(condition: Condition, controller: Controller) -> Condition:
    """Return a condition with one controller alone."""
    return condition._replace(experiment=altered(condition.experiment, controllers=(controller,)))


def _point(one: Evaluation) -> tuple[float, float]:
    """Return chattering and error of an evaluation."""
    return one.objectives[1], one.objectives[0]


class _Jury:
    """Judges the entries of a chain on its sealed draws.

    Args:
        asked: The section.
        entries: Chain and entry of each row.
        pool: The threads.
        folder: Where each row is stored after each look; None for nowhere.
        tell: Is told the progress.
    """

    def __init__(
        self,
        asked: Arena,
        entries: Sequence[Entry],
        pool: ThreadPoolExecutor,
        folder: Path | None,
        tell: Tell,
    ) -> None:
        self._asked, self._entries, self._pool, self._folder, self._tell = asked, entries, pool, folder, tell
        self.track = entries[0][0]
        self.left = len(entries) * judging_of(asked, self.track)
        """Closed loops that may be run yet."""

    def judge(self, rows: Sequence[Row], beside: Record) -> list[Row]:
        """Return the rows, judged draw by draw until all is decided that draws decide.

        Args:
            rows: One for each entry; they may have been judged in some draws.
            beside: The arena without these rows.
        """
        looks = looks_at(self._asked.tests, beside.looks)
        asked = [[looks[0]] * len(row.judged) for row in rows]
        found = list(map(self.run, self._entries, rows, asked))
        for before, now in itertools.pairwise(looks):
            going = dataclasses.replace(beside, rows=(*beside.rows, *found)).undecided(self.track.name, before)
            asked = [[now if one else 0 for one in _further(row, going)] for row in found]
            found = list(map(self.run, self._entries, found, asked))
        return found

    def run(self, entry: Entry, row: Row, draws: Sequence[int]) -> Row:
        """Return a row whose sets of gains are judged in as many draws each, or in as many as they were if more.

        Args:
            entry: Its chain and entry.
            row: The row.
            draws: How many draws each of its sets of gains is judged in.
        """
        seen = [draws_of(one) for one in row.judged]
        values = [{name: dict(table) for name, table in one.values.items()} for one in row.judged]
        loops = 0
        for span in sorted({(n, most) for n, most in zip(seen, draws, strict=True) if n < most}):
            alike: dict[str, list[int]] = {}
            for i, one in enumerate(row.judged):
                if (seen[i], draws[i]) == span:
                    alike.setdefault(repr(one.gains), []).append(i)
            controllers = [altered(entry[1], gains=dict(row.judged[i].gains)) for i, *_ in alike.values()]
            for condition in self.track.tests:
                numbers = range(span[0], min(span[1], _draws(self._asked, condition)))
                if not numbers:  # nothing is random, and it was run
                    continue
                trials = Trials([altered_alone(condition, controllers[0])], self._asked.stored, self._pool)
                for places, runs in zip(alike.values(), trials(controllers, numbers), strict=True):
                    for i in places:
                        table = values[i].setdefault(condition.name, {})
                        for j, metric in enumerate(self._asked.stored):
                            table[metric] = (*table.get(metric, ()), *(_value(run, j) for run in runs))
                loops += len(numbers) * len(controllers)
        judged = (dataclasses.replace(one, values=own) for one, own in zip(row.judged, values, strict=True))
        found = dataclasses.replace(row, judged=tuple(judged))
        self.left -= loops
        self._tell(f"judging {found.chain}: '{found.entry}'", loops)
        if loops:
            _store(_path(self._folder, self.track, found.entry), found)
        return found


def draws_of(one: Judged) -> int:
    """Return in how many draws a set of gains was judged."""
    return max((len(own) for table in one.values.values() for own in table.values()), default=0)


def _further(row: Row, going: Set[tuple[str, float]]) -> list[bool]:
    """Return a mask of a row's sets of gains: those that an undecided level has chosen."""
    own = [one for entry, level in going if entry == row.entry for one in picks(row, level) if one is not None]
    return [any(one is other for other in own) for one in row.judged]


def _value(run: Run, place: int) -> float | None:
    return None if run.failed else stored(run.values[place])
