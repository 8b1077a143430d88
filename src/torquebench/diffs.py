"""Two runs, or two sweeps, of the same laws compared: the ratio of each metric, and what must not have become worse."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.falsify_section import LIMITS, parts_of_claim
from torquebench.metrics import METRICS
from torquebench.plain import plain
from torquebench.results import load_result
from torquebench.statistics import Ratio, paired_ratio
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
        """Whether all of a ratio's interval is there: the end that is nearest to the other side."""
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
    """Values of the grid's keys; empty in a run."""
    metric: str
    a: float
    """Geometric mean over draws, in SI units."""
    b: float
    ratio: Ratio
    """Of B to A over the draws that both completed; that of a single pair is its own interval."""


class Diff(NamedTuple):
    """What changed from A to B."""

    limits: tuple[Limit, ...]
    changes: tuple[Change, ...]
    failed: tuple[str, ...]
    """Runs that completed in A and not in B, in words."""
    mended: tuple[str, ...]
    """The reverse."""
    only_a: tuple[str, ...]
    """Controllers, or controllers in cases, that B does not have."""
    only_b: tuple[str, ...]
    broken: tuple[str, ...]
    """Limits that are passed, in words; so is a run that fails in B alone, one that B lacks, and a metric that cannot
    be judged. Empty where no limit was named."""

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        data: dict[str, Any] = plain(self)
        return data


Draws = Mapping[str, Sequence[float | None]]
"""Metric -> its value in each draw; None where the run failed."""
Values = dict[tuple[str, str], tuple[Sequence[bool], Draws]]
"""Controller and case -> whether each draw completed, and its metrics."""


def diff(a: str | Path, b: str | Path, limits: Sequence[Limit | str] = (), plugins: Sequence[Path] = ()) -> Diff:
    """Compare two stored runs, or two stored sweeps, controller by controller and case by case.

    Args:
        a, b: Folders that ``torquebench run`` left, or ``torquebench sweep``: what was, and what is.
        limits: Ratios of B to A that must not be, such as ``rmse > 1.05``; of a sweep one is passed when the 95 %
            interval of the paired ratio is wholly beyond it.
        plugins: Python files that register laws which they use.

    Raises:
        ConfigError: a limit is none, one is a run and the other a sweep, or the draws are not the same.
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
    swept = [(folder / PLAN).is_file() for folder in folders]
    if swept[0] != swept[1]:
        kinds = ["a sweep" if own else "no sweep" for own in swept]
        problems.append(Problem("B", str(b), f"is {kinds[1]}, and {a} is {kinds[0]}", wanted="two of one kind"))
    if problems:
        raise ConfigError(problems)
    one, other = (_of_sweep(x, plugins) if swept[0] else _of_run(x, plugins) for x in folders)
    if one[0] != other[0]:
        raise ConfigError(
            [Problem("B", str(b), "has other draws", got=str(other[0]), wanted=f"those of {a}: {one[0]}")]
        )
    return _compared(one[1], other[1], asked)


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


def _compared(a: Values, b: Values, limits: Sequence[Limit]) -> Diff:
    """Return what changed between what two folders hold."""
    failed, mended, changes, blind = [], [], list[Change](), []
    for place in [own for own in a if own in b]:
        (good_a, of_a), (good_b, of_b) = a[place], b[place]
        lost, won = (
            sum(x and not y for x, y in zip(p, q, strict=True)) for p, q in ((good_a, good_b), (good_b, good_a))
        )
        number = "" if len(good_a) == 1 else " in {} of {} draws"
        failed += [f"{_named(place)} fails{number.format(lost, len(good_a))}"] if lost else []
        mended += [f"{_named(place)} completes{number.format(won, len(good_a))}"] if won else []
        for key in METRICS.names():
            if key in of_a and key in of_b:
                change = _change(place, key, of_a[key], of_b[key])
                changes += [] if change is None else [change]
        known = {change.metric for change in changes if (change.controller, change.case) == place}
        for metric in dict.fromkeys(limit.metric for limit in limits):
            if metric not in known and any(good_a):
                blind.append(f"{_named(place)}: {metric} has no ratio, and cannot be judged")
    only_a, only_b = (tuple(_named(x) for x in own if x not in other) for own, other in ((a, b), (b, a)))
    passed = [
        f"{_named(x[:2])}: {x.metric} is {x.ratio.ratio:.4g} times that of A{_spread(x.ratio)}, {y.text}"
        for x in changes
        for y in limits
        if x.metric == y.metric and y.met(x.ratio)
    ]
    missing = [f"{name} is missing in B" for name in only_a]
    broken = [*passed, *failed, *missing, *blind] if limits else []
    return Diff(tuple(limits), tuple(changes), tuple(failed), tuple(mended), only_a, only_b, tuple(broken))


def _change(place: tuple[str, str], key: str, a: Sequence[float | None], b: Sequence[float | None]) -> Change | None:
    """Return how a metric changed; None where a ratio means nothing: no draw in common, or the value 0 on one side."""
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
    return Change(*place, key, level, level * ratio.ratio, ratio)


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
