"""Declaration of metrics: the `@metric` decorator, and the registry of all metrics in the order of tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from torquebench.errors import RegistryError
from torquebench.kernel import Array
from torquebench.metrics.record import JointRecord
from torquebench.registry import SNAKE, Registry, docstring

Formula: TypeAlias = Callable[[JointRecord], Array]
_F = TypeVar("_F", bound=Formula)

IN_WORDS: dict[str, str] = {"mean": "mean of joints", "worst": "worst joint", "rms": "all joints and samples"}


@dataclass(frozen=True, slots=True, eq=False)
class MetricInfo:
    """Declaration of a metric; see `metric`."""

    key: str
    title: str
    meaning: str
    unit: str
    formula: Formula
    better: Literal["lower", "higher"]
    over_joints: str
    steps_only: bool
    of_tool: bool
    column: str
    shown_unit: str
    scale: float

    @property
    def headline(self) -> str:
        """Way in which the joints give one number, in words."""
        if self.of_tool:
            return "the tool's own"
        return IN_WORDS.get(self.over_joints) or f"joint with the worst `{self.over_joints}`"

    @property
    def is_angle(self) -> bool:
        """Whether the metric is in rad for joints that turn, and in m for joints that slide."""
        return self.unit.startswith("rad") and not self.of_tool

    @property
    def short_title(self) -> str:
        """Title where there is little room: that of its column, if it has one."""
        return self.column or self.title

    def over(self, values: Array) -> float:
        """Return the headline of values of joints, (n,)."""
        return float(reduce_joints(values, self.over_joints, self.better))


def reduce_joints(values: Array, over_joints: str, better: str) -> Array:
    """Make one number of a metric's joints: the only place where that is done.

    Args:
        values: Values of the joints along the last axis, (..., n), n at least 1.
        over_joints: ``mean``, ``worst`` or ``rms``.
        better: Which values are better, ``lower`` or ``higher``: the worst are the others.

    Returns:
        (...,), NaN where a joint has no value.
    """
    reduced: Array
    if over_joints == "worst":
        reduced = (np.maximum if better == "lower" else np.minimum).reduce(values, axis=-1)
    elif over_joints == "rms":
        reduced = np.sqrt(np.add.reduce(values * values, axis=-1) / values.shape[-1])
    else:
        reduced = np.add.reduce(values, axis=-1) / values.shape[-1]
    return reduced


METRICS: Registry[MetricInfo] = Registry("metric", SNAKE)
"""Every metric, in the order of tables: those of this package, then those of plug-in files."""


def applicable(tool: bool) -> tuple[MetricInfo, ...]:
    """Return the metrics that a run has, those of the tool only where the reference is a path of the `tool`."""
    return tuple(info for info in METRICS.values() if tool or not info.of_tool)


def metric(
    key: str,
    *,
    title: str,
    unit: str,
    meaning: str = "",
    better: Literal["lower", "higher"] = "lower",
    over_joints: str = "mean",
    steps_only: bool = False,
    of_tool: bool = False,
    column: str | None = None,
    shown_as: tuple[str, float] | None = None,
) -> Callable[[_F], _F]:
    """Register a metric: a function of one completed run that returns a value for each joint, (n,), NaN for none.

    Args:
        key: Name in ``metrics.json``, in a sweep's table and for `sweep.keep.by`: lower case with underscores.
        title: Name in figures and lists.
        unit: SI unit; ``1`` for a pure number. One that begins with ``rad`` is in m for joints that slide.
        meaning: Definition in words; the first line of the function's docstring by default.
        better: Which values are better.
        over_joints: How the joints make one number, the headline: ``mean``, ``worst``, ``rms`` for the root of the
            mean square, or the key of a metric before it: the joint that is worst in that one is taken; not for angles.
        steps_only: Whether only a reference that is like a step has it; only joints that have a step count then.
        of_tool: Whether it is one number of the tool, shape (), and not one for each joint; only where the reference is
            a path of the tool do runs have it.
        column: Title of its column in tables of headlines; the title by default, empty for no column.
        shown_as: Unit in that column, and by how much the SI value is multiplied; the SI unit by default, for rad
            thousandths of it.

    Raises:
        RegistryError: the key is taken or not of that form, or an argument is not one of the words it may be.
    """
    known = over_joints in IN_WORDS or (over_joints in METRICS and not unit.startswith("rad"))
    if better not in ("lower", "higher") or not known:
        raise RegistryError(
            f"metric '{key}': got better={better!r}, over_joints={over_joints!r}, wanted better 'lower' or 'higher' "
            f"and over_joints 'mean', 'worst' or 'rms', or the key of a metric before it, not for angles"
        )
    shown_unit, scale = shown_as or ((f"m{unit}", 1e3) if unit.startswith("rad") else (unit, 1.0))

    def register(formula: _F) -> _F:
        words = meaning or (docstring(formula) or title).strip().splitlines()[0].rstrip(".")
        info = MetricInfo(
            key=key,
            title=title,
            meaning=words,
            unit=unit,
            formula=formula,
            better=better,
            over_joints=over_joints,
            steps_only=steps_only,
            of_tool=of_tool,
            column=title if column is None else column,
            shown_unit=shown_unit,
            scale=scale,
        )
        METRICS.register(key, info, maker=formula)
        return formula

    return register
