"""Two runs, sweeps or arenas of the same laws compared: each metric's ratio, and what must not have become worse."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from torquebench.arena.ranking import Scores
from torquebench.arena.ranking import compare as compare_scores
from torquebench.arena.record import SELF, TUNED, read_record
from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.falsify_section import LIMITS, parts_of_claim
from torquebench.experiment.store import MANIFEST, other_machines, read_manifest
from torquebench.metrics import METRICS
from torquebench.plain import plain
from torquebench.results import load_result
from torquebench.statistics import SMALL, Outcomes, Ratio, draws_needed, mcnemar, paired_ratio
from torquebench.sweep.folder import PLAN
from torquebench.sweep.table import completed, grid_keys, metric_keys, metric_values, row_values, rows_by
from torquebench.sweeps import load_sweep

EXAMPLE = "a metric and a ratio of B to A, such as rmse > 1.05"


class Limit(NamedTuple):
    """A ratio that must not be: ``rmse > 1.05``."""

    metric: str
    sign: str
    """One of `torquebench.experiment.falsify_section.LIMITS`."""
    ratio: float

    @property
    def text(self) -> str:
        """It as it is written."""
        return f"{self.metric} {self.sign} {self.ratio:g}"

    def met(self, change: Ratio) -> bool:
        """Whether the whole interval of a ratio meets the limit: the end nearest to the other side decides."""
        return LIMITS[self.sign](change.low if self.sign in (">", ">=") else change.high, self.ratio)


def read_limit(raw: str) -> Limit | dict[str, Any]:
    """Return a ratio that must not be, or what is wrong with its text: the parts of a mistake."""
    found = parts_of_claim(raw, EXAMPLE)
    if isinstance(found, dict):
        return found
    try:
        ratio = float(found[2])
    except ValueError:
        ratio = math.nan
    if not 0.0 < ratio < math.inf:
        return {"got": f"'{found[2]}'", "wanted": "a ratio of B to A, a positive number without unit"}
    return Limit(found[0], found[1], ratio)


class Change(NamedTuple):
    """One metric of one controller, B over A."""

    controller: str
    case: str
    """Values of the grid's keys; in an arena its chain and level; empty in a run."""
    metric: str
    a: float
    """Geometric mean over draws, in SI units."""
    b: float
    ratio: Ratio
    """Of B to A over the draws that both completed; that of a single pair is its own interval."""
    needed: int | None = None
    """Draws that would show a change by the limit's ratio, or `SMALL`; see `draws_needed`. None in an arena, whose
    tunings spread too."""


class Ended(NamedTuple):
    """Counts of one controller's runs that ended differently in A and B."""

    controller: str
    case: str
    outcomes: Outcomes
    """Of B and A: the first count is of runs that failed in B alone."""


class Diff(NamedTuple):
    """Changes from A to B."""

    limits: tuple[Limit, ...]
    changes: tuple[Change, ...]
    failed: tuple[str, ...]
    """Runs that completed in A and not in B, in words."""
    mended: tuple[str, ...]
    """The reverse."""
    ended: tuple[Ended, ...]
    only_a: tuple[str, ...]
    """Controllers, or controllers in cases, that B does not have."""
    only_b: tuple[str, ...]
    verdicts: Mapping[str, tuple[str, ...]]
    """Controller, in its case, of A -> limits that it passes, in words; so is a run that fails in B alone, one that B
    lacks, and a metric that cannot be judged. Empty where no limit was named."""
    remarks: tuple[str, ...] = ()
    """That B was made where numbers have other last bits; see `torquebench.experiment.store.other_machines`."""

    @property
    def broken(self) -> tuple[str, ...]:
        """All of `verdicts`."""
        return tuple(text for texts in self.verdicts.values() for text in texts)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        data: dict[str, Any] = plain(self)
        return data | {"broken": list(self.broken)}

    def junit(self, name: str = "torquebench diff") -> bytes:
        """Return it as JUnit's XML, which servers that run tests show: a test for each controller in its case.

        Args:
            name: Name of the suite.
        """
        failures = sum(bool(texts) for texts in self.verdicts.values())
        suite = ElementTree.Element("testsuite", name=name, tests=str(len(self.verdicts)), failures=str(failures))
        for place, texts in self.verdicts.items():
            test = ElementTree.SubElement(suite, "testcase", classname=name, name=place)
            if texts:
                ElementTree.SubElement(test, "failure", message=texts[0]).text = "\n".join(texts)
        ElementTree.indent(suite)
        return bytes(ElementTree.tostring(suite, "utf-8", xml_declaration=True)) + b"\n"


Draws = Mapping[str, Sequence[float | None] | Scores]
"""Metric -> its value in each draw, None where the run failed; of an arena also over tunings and burdens."""
Values = dict[tuple[str, str], tuple[Sequence[float], Draws]]
"""Controller and case -> whether each run completed, in an arena the share of tunings in which it did, and metrics."""


def diff(a: str | Path, b: str | Path, limits: Sequence[Limit | str] = (), plugins: Sequence[Path] = ()) -> Diff:
    """Compare two stored runs, sweeps or arenas, controller by controller and case by case.

    Args:
        a, b: Folders that ``torquebench run``, ``sweep`` or ``arena`` left, or an ``arena.json``: what was, what is.
        limits: Ratios of B to A that must not be, such as ``rmse > 1.05``; over draws one is passed when the 95 %
            interval of the paired ratio is wholly beyond it.
        plugins: Python files that register laws which they use.

    Raises:
        ConfigError: a limit is none, the two are not of one kind, or the draws are not the same.
        ResultError: a folder is not finished, or was altered.
    """
    problems, asked = [], []
    for limit in limits:
        found = read_limit(limit) if isinstance(limit, str) else limit
        if isinstance(found, dict):
            problems.append(Problem("--fail-if", **found))
        else:
            asked.append(found)
    folders = Path(a), Path(b)
    kinds = [kind_of(folder) for folder in folders]
    if kinds[0] != kinds[1]:
        problems.append(Problem("B", str(b), f"is {kinds[1]}, and {a} is {kinds[0]}", wanted="two of one kind"))
    if problems:
        raise ConfigError(problems)
    read = {"a sweep": _of_sweep, "an arena": _of_arena}.get(kinds[0], _of_run)
    one, other = (read(folder, plugins) for folder in folders)
    if one[0] != other[0]:
        raise ConfigError(
            [Problem("B", str(b), "has other draws", got=str(other[0]), wanted=f"those of {a}: {one[0]}")]
        )
    made_on = {name: machine_of(folder) for name, folder in zip("AB", folders, strict=True)}
    return _compared(one[1], other[1], asked)._replace(remarks=other_machines(made_on))


def machine_of(path: Path) -> Mapping[str, str]:
    """Return the machine on which a finished run, sweep or arena was made."""
    if kind_of(path) == "an arena":
        return read_record(path).machine
    made_on = read_manifest(path / MANIFEST)[0].get("machine")
    return {key: str(value) for key, value in made_on.items()} if isinstance(made_on, dict) else {}


def kind_of(path: Path) -> str:
    """Return what a command left: a run, a sweep or an arena."""
    if path.suffix == ".json" or (path / "arena.json").is_file():
        return "an arena"
    return "a sweep" if (path / PLAN).is_file() else "a run"


def _of_run(folder: Path, plugins: Sequence[Path]) -> tuple[str, Values]:
    result = load_result(folder, plugins)
    table, values = result.metrics.to_dict("index"), Values()
    for name, trajectory in result.trajectories.items():
        known = {str(key): [x] for key, x in table[name].items() if math.isfinite(x)}
        values[name, ""] = [trajectory.completed], known if trajectory.completed else {}
    return "", values


def _of_sweep(folder: Path, plugins: Sequence[Path]) -> tuple[str, Values]:
    sweep = load_sweep(folder, plugins)
    table, plan, values = sweep._table, sweep.stored.plan, Values()
    grid, metrics = grid_keys(table), metric_keys(table)
    for (name, _), rows in rows_by(table, "controller", "case").items():
        case = ", ".join(f"{key}={value}" for key, value in row_values(table, grid, int(rows[0])).items())
        columns = {key: [x if x == x else None for x in metric_values(table, rows, key).tolist()] for key in metrics}
        values[name, case] = completed(table, rows).tolist(), columns
    return f"{plan.draws} of seed {plan.first.run.seed}", values


def _of_arena(path: Path, _plugins: Sequence[Path]) -> tuple[str, Values]:
    """Return what is stored of each entry on each chain: tuned, at each level, also held out, and as given."""
    record, values = read_record(path), Values()
    for row in record.rows:
        cases = [(f", {level:g} %", level, TUNED, held) for level in record.levels for held in (False, True)]
        for words, level, ruleset, held in (*cases, (", as given", math.inf, SELF, False)):
            if held and not record.held_out:
                continue
            try:
                own = {key: record.scores(row, level, key, ruleset, held) for key in record.metrics}
            except ResultError:  # it has no gains of this level
                continue
            runs = 1.0 - next(iter(own.values())).runs
            values[row.entry, f"{row.chain}{words}{', held out' * held}"] = runs.tolist(), own
    return f"{record.draws} of the seal {record.seal['commitment'][:16]}", values


def _compared(a: Values, b: Values, limits: Sequence[Limit]) -> Diff:
    """Return what changed between what two folders hold."""
    failed, mended, ended, changes = list[str](), list[str](), list[Ended](), list[Change]()
    verdicts = dict[str, tuple[str, ...]]()
    sizes = {limit.metric: limit.ratio for limit in limits}
    for place in a:
        found = list[str]()
        if place not in b:
            verdicts[_named(place)] = (f"{_named(place)} is missing in B",) if limits else ()
            continue
        (good_a, of_a), (good_b, of_b) = a[place], b[place]
        outcomes = mcnemar([1.0 - x for x in good_b], [1.0 - x for x in good_a])
        lost, won, runs, p = outcomes
        what = "runs" if any(isinstance(x, Scores) for x in of_a.values()) else "draws"
        text = f", in {{}} of {runs} {what} (exact McNemar p = {p:.2g})" if runs > 1 else ""
        ended += [Ended(*place, outcomes)] if lost or won else []
        failed += [f"{_named(place)} fails in B only{text.format(lost)}"] if lost else []
        mended += [f"{_named(place)} completes in B only{text.format(won)}"] if won else []
        own = list[Change]()
        for key in METRICS.names():
            if key in of_a and key in of_b:
                change = _change(place, key, of_a[key], of_b[key], sizes.get(key, SMALL))
                own += [] if change is None else [change]
        changes += own
        found += [
            f"{_named(place)}: {x.metric} is {x.ratio.ratio:.4g} times that of A{_spread(x.ratio)}, {y.text}"
            for x in own
            for y in limits
            if x.metric == y.metric and y.met(x.ratio)
        ]
        found += failed[-1:] if lost else []
        if any(good_a):
            blind = [metric for metric in sizes if metric not in {change.metric for change in own}]
            found += [f"{_named(place)}: {metric} has no ratio, and cannot be judged" for metric in blind]
        verdicts[_named(place)] = tuple(found) if limits else ()
    only_a, only_b = (tuple(_named(x) for x in own if x not in other) for own, other in ((a, b), (b, a)))
    told = tuple(failed), tuple(mended), tuple(ended)
    return Diff(tuple(limits), tuple(changes), *told, only_a, only_b, verdicts)


def _change(place: tuple[str, str], key: str, a: Any, b: Any, size: float) -> Change | None:
    """Return how a metric changed; None where a ratio means nothing: no draw in common, or the value 0 on one side.

    Args:
        place: Controller and case.
        key: The metric.
        a, b: Its values, both of one kind.
        size: Ratio of the change for which draws are counted.
    """
    if isinstance(a, Scores):
        return _change_of_scores(place, key, a, b)
    pairs = [(x, y) for x, y in zip(a, b, strict=True) if x is not None and y is not None]
    if pairs and all(x == y for x, y in pairs):  # 0 as well: nothing changed
        failed = sum(x is None for x in a), sum(y is None for y in b)
        mean = sum(x for x, _ in pairs) / len(pairs)
        return Change(*place, key, mean, mean, Ratio(1.0, 1.0, 1.0, len(pairs), failed, len(a) - len(pairs)))
    try:
        ratio = paired_ratio(b, a)
    except ResultError:
        return None
    level = math.exp(sum(math.log(x) for x, _ in pairs) / len(pairs))
    return Change(*place, key, level, level * ratio.ratio, ratio, draws_needed(ratio, size))


def _change_of_scores(place: tuple[str, str], key: str, a: Scores, b: Scores) -> Change | None:
    """Return how a metric of an arena changed; its interval holds the spread of draws and that of tunings."""
    same = a.values.shape == b.values.shape and np.array_equal(a.values, b.values, equal_nan=True)
    if np.any(a.values <= 0.0) or np.any(b.values <= 0.0):
        return None if not same else Change(*place, key, 0.0, 0.0, Ratio(1.0, 1.0, 1.0, a.values.shape[2], (0, 0), 0))
    ratio = compare_scores(b, a)
    if not ratio.pairs:
        return None
    known = ~(np.isnan(a.logs).any(axis=0) | np.isnan(b.logs).any(axis=0))
    level = math.exp(float(a.logs[:, known].mean()))
    return Change(*place, key, level, level * ratio.ratio, ratio._replace(low=1.0, high=1.0) if same else ratio)


def _named(place: tuple[str, str]) -> str:
    controller, case = place
    return f"controller '{controller}'" + (f" with {case}" if case else "")


def _spread(ratio: Ratio) -> str:
    return f" ({ratio.low:.4g} to {ratio.high:.4g})" if ratio.low < ratio.high else ""


def shown(changes: Sequence[Change], extra: Sequence[str] = ()) -> Iterator[tuple[str, list[Change]]]:
    """Yield each metric that a table has room for, with its changes.

    Args:
        changes: Those of a `Diff`.
        extra: Metrics that are shown too.
    """
    for key in dict.fromkeys(("rmse", "max_error", "chattering", "effort", *extra)):
        if own := [change for change in changes if change.metric == key]:
            yield key, own
