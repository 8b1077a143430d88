"""Finds the best laws and gains of a sweep, each judged in the conditions in which it does worst."""

from __future__ import annotations

import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

from torquebench.errors import ConfigError, Problem, nearest
from torquebench.metrics import METRICS
from torquebench.metrics.shaking import is_still
from torquebench.sweep.summary import Figure, Group, Summary

CHOSEN = ("controllers.", "run.control_period")
"""Beginnings of the keys that a designer chooses; the others are conditions that a law has to cope with."""
COMPARISONS: dict[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "!=": operator.ne,
    "==": operator.eq,
    "": operator.eq,
}
Test: TypeAlias = Callable[[Any], bool]


class Choice(NamedTuple):
    """One law with one choice of its keys, in the conditions in which it does worst."""

    worst: Group
    """The law in the case in which the metric that was asked for is worst."""
    figures: Mapping[str, Figure]
    """Metric -> its figures in the case in which its own mean is worst; none where it is missing in one of them."""
    cases: int
    """Cases behind it."""
    runs: int
    """Runs in these."""
    completed: int

    @property
    def controller(self) -> str:
        """Name of the law's controller."""
        return self.worst.controller

    @property
    def chatters(self) -> bool | None:
        """Whether its mean chattering is large enough to count; None where that is not known."""
        return None if "chattering" not in self.figures else not is_still(self.figures["chattering"].mean)


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """Return a name for each of a sweep's keys that is as short as it can be among them.

    ``controllers.*.gains.lam`` is ``lam`` (or, beside other ones, ``*.lam``), ``plant.payload.mass`` ``payload.mass``.
    """
    candidates = dict[str, list[str]]()
    for key in keys:
        parts = key.split(".")
        own = [parts[-1], f"{parts[1]}.{parts[-1]}"] if key.startswith("controllers.") else [".".join(parts[1:])]
        candidates[key] = [name for name in (*own, key) if name and name not in METRICS]
    counts = Counter(name for own in candidates.values() for name in set(own))
    return {key: next(name for name in own if counts[name] == 1) for key, own in candidates.items()}


def conditions(summary: Summary) -> tuple[str, ...]:
    """Return the keys of a sweep's grid that nobody chooses; none where there is nothing else to choose from."""
    chosen = [key for key in summary.grid if key.startswith(CHOSEN)]
    return tuple(key for key in summary.grid if key not in chosen) if chosen or len(summary.overall) > 1 else ()


def distinct(summary: Summary) -> list[Group]:
    """Return every law in every case, by case; of those that a law cannot tell apart, lacking their key, the first."""
    found = dict[tuple[Any, ...], Group]()
    for group in summary.groups:
        found.setdefault((group.controller, *group.values.values()), group)
    return list(found.values())


def best_choices(
    summary: Summary, metric: str = "rmse", where: Mapping[str, Any] | None = None, over: Sequence[str] | None = None
) -> list[Choice]:
    """Return every law with every choice, the best first; those of which a run failed come after all others.

    Cases that a law cannot tell apart count as one. Of equal choices, the one of the first case comes first.

    Args:
        summary: The sweep's summary.
        metric: Metric that is compared by its mean.
        where: Metric or key -> what it has to be: a text such as ``<= 1``, or a value. A metric is compared in SI
            units, and a key, by its full or its short name, tells which cases count. All others are left out.
        over: Keys in whose worst value a choice counts, full or short; None for those of `conditions`.

    Raises:
        ConfigError: there is no such metric or key, or a condition is none; all mistakes at once.
    """
    names = {short: key for key, short in short_names(summary.grid).items()} | {key: key for key in summary.grid}
    problems = list[Problem]()
    on_keys, on_metrics = dict[str, Test](), dict[str, Test]()
    _known("metric", metric, summary.metrics, problems)
    worst_of = {names.get(key, key) for key in (conditions(summary) if over is None else over)}
    for key in () if over is None else over:
        _known("over", key, names, problems)
    for key, wanted in (where or {}).items():
        if _known("where", key, (*summary.metrics, *names), problems):
            test = _test(key, wanted, problems)
            (on_metrics if key in summary.metrics else on_keys)[names.get(key, key)] = test
    if problems:
        raise ConfigError(problems)
    found = dict[tuple[Any, ...], list[Group]]()
    for group in distinct(summary):
        if all(test(group.values[key]) for key, test in on_keys.items()):
            choice = tuple(value for key, value in group.values.items() if key not in worst_of)
            found.setdefault((group.controller, choice), []).append(group)
    choices = [_choice(groups, metric, summary.metrics) for groups in found.values()]
    kept = [one for one in choices if all(test(_mean(one, key)) for key, test in on_metrics.items())]
    return sorted(kept, key=partial(_rank, metric=metric))


def _choice(groups: Sequence[Group], metric: str, metrics: Sequence[str]) -> Choice:
    if len(groups) == 1:
        one = groups[0]
        return Choice(one, one.figures, 1, one.successes.trials, one.successes.successes)

    def worst(key: str) -> Group:
        sign = 1.0 if METRICS[key].better == "lower" else -1.0
        return max(groups, key=lambda group: sign * group.figures[key].mean if key in group.figures else math.inf)

    figures = {key: figure for key in metrics if (figure := worst(key).figures.get(key)) is not None}
    runs = sum(group.successes.trials for group in groups)
    return Choice(worst(metric), figures, len(groups), runs, sum(group.successes.successes for group in groups))


def _mean(choice: Choice, key: str) -> float | None:
    return choice.figures[key].mean if key in choice.figures else None


def _rank(choice: Choice, metric: str) -> tuple[bool, float, int]:
    mean = _mean(choice, metric)
    order = math.inf if mean is None else mean if METRICS[metric].better == "lower" else -mean
    return choice.completed < choice.runs or mean is None, order, choice.worst.case


def _known(role: str, name: str, known: Sequence[str] | Mapping[str, str], problems: list[Problem]) -> bool:
    if name not in known:
        problems.append(
            Problem(role, got=f"'{name}'", wanted=f"one of {', '.join(known)}", nearest=nearest(name, known) or "")
        )
    return name in known


def _test(key: str, wanted: Any, problems: list[Problem]) -> Test:
    """Return the test that a condition stands for; nothing that is missing meets one."""
    sign, text = re.findall(r"^\s*(<=|>=|<|>|!=|==|)\s*(.*?)\s*$", str(wanted), re.DOTALL)[0]
    compare = COMPARISONS[sign]
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not text or (math.isnan(limit) and sign in ("<=", ">=", "<", ">")):
        problems.append(Problem("where", key, got=repr(wanted), wanted="a text such as '<= 1', or a value"))
    return lambda value: value is not None and compare(value, text if isinstance(value, str) else limit)
