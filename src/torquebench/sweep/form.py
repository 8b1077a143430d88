"""The form of a sweep's table: its columns, and what they show of every varied key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from torquebench.experiment.sweep_values import Axis, Value
from torquebench.metrics import METRICS
from torquebench.sim.trajectory import Outcome
from torquebench.sweep.columns import FIXED
from torquebench.sweep.plan import Plan

REFUSED = "REFUSED"
"""Outcome of a run that cannot be built, such as one whose drawn model is no arm."""
OUTCOMES = (*(outcome.name for outcome in Outcome), REFUSED)


def empty_columns(plan: Plan, rows: int) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a table, not filled yet, in order: those of every table, varied keys, metrics.

    Args:
        plan: The sweep.
        rows: How many.
    """
    floats = np.dtype("<f8")
    own = (*[np.dtype("<i8")] * 3, _text(plan.controllers), _text(OUTCOMES), floats)
    kinds: dict[str, Any] = dict(zip(FIXED, own, strict=True))
    kinds |= {key: floats for key in (*(axis.key for axis in plan.keys.axes), *(r.key for r in plan.keys.random))}
    kinds |= {axis.key: _text([_word(value) for value in axis.values]) for axis in _axes(plan) if not axis.numeric}
    kinds |= dict.fromkeys(METRICS.names(), floats)
    return {name: np.zeros(rows, kind) for name, kind in kinds.items()}


def values_of(plan: Plan, case: int, draw: int) -> dict[str, list[float | str]]:
    """Return what tables show of every varied key: its value for each controller; NaN or '' for one without it.

    Args:
        plan: The sweep.
        case, draw: Which runs.
    """
    found: dict[str, list[float | str]] = {}
    lacking = plan.lacking(case, draw)
    for key, value in _shown(plan, case, draw):
        none = math.nan if isinstance(value, float) else ""
        found[key] = [none if i in lacking[key] else value for i in range(len(plan.controllers))]
    return found


def _shown(plan: Plan, case: int, draw: int) -> Iterator[tuple[str, float | str]]:
    for axis, value in zip(plan.keys.axes, plan.values(case), strict=True):
        yield axis.key, value.word if axis.numeric else _word(value)
    for random in plan.keys.random:
        drawn = plan.drawn(random, draw)
        if random.choices is None:
            yield random.key, drawn
        else:
            value = random.choices.values[int(drawn)]
            yield random.key, value.word if random.choices.numeric else _word(value)


def _axes(plan: Plan) -> Iterator[Axis]:
    """Yield every key with a list of values."""
    yield from plan.keys.axes
    yield from (random.choices for random in plan.keys.random if random.choices is not None)


def _word(value: Value) -> str:
    return value.word if isinstance(value.word, str) else repr(value.raw)


def _text(words: Sequence[str]) -> np.dtype[Any]:
    return np.dtype(f"<U{max(map(len, words))}")
