"""From a completed run to its metrics: every metric by joint, and the headline of each.

Source of every definition: docs/definitions.md, "Metrics". This module chooses the windows, keeps undefined values
visible, and reduces each metric to its headline. Errors are those of the true position.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.metrics.chattering import LEAST_CORNER_HZ
from torquebench.metrics.declare import IN_WORDS, METRICS, MetricInfo, reduce_joints
from torquebench.metrics.record import JointRecord
from torquebench.metrics.step_response import response_of
from torquebench.sim.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of one run; `value` is None when any counted joint has none: survivors are not averaged."""

    value: float | None
    per_joint: tuple[float | None, ...]
    counted: int
    """Joints that enter the headline; a joint without a step, say, is not counted."""

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers, None where undefined; `defined` is how many counted joints have a value."""
        defined = sum(x is not None for x in self.per_joint)
        return {
            "value": self.value,
            "per_joint": list(self.per_joint),
            "counted": self.counted,
            "defined": defined,
        }


class Metrics:
    """Every metric of one completed run, in SI units: ``metrics.rmse`` or ``metrics["rmse"]``.

    Args:
        values: Key -> metric, in the order of tables.
    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, Metric]) -> None:
        self._values = dict(values)

    def __getitem__(self, key: str) -> Metric:
        METRICS.find(key)  # names the nearest key where there is none
        return self._values[key]

    def __getattr__(self, key: str) -> Metric:
        if key.startswith("_") or key not in self._values:
            raise AttributeError(f"no metric '{key}'")
        return self._values[key]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Metrics) and self._values == other._values

    def __hash__(self) -> int:
        return hash(tuple(self._values.items()))

    def __repr__(self) -> str:
        return f"<Metrics {', '.join(f'{key}={one.value}' for key, one in self._values.items())}>"

    def items(self) -> tuple[tuple[MetricInfo, Metric], ...]:
        """Return (description, metric) pairs in table order."""
        return tuple((METRICS[key], one) for key, one in self._values.items())

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Return a JSON-ready mapping from key to `Metric.to_json`, in table order; it never holds NaN."""
        return {key: one.to_json() for key, one in self._values.items()}


class PerJoint(NamedTuple):
    """Every metric of every joint, before it is reduced to its headline."""

    values: Array
    """A row for each of `METRICS`, (len(METRICS), n); NaN where undefined."""
    stepped: npt.NDArray[np.bool_]
    """Joints that have a step, (n,): only these count in metrics that only a step has."""


def headlines(joints: PerJoint) -> Array:
    """Return the headline of each of `METRICS`, (len(METRICS),); NaN where a joint that counts has no value.

    Args:
        joints: The metrics of the joints.
    """
    values, stepped = joints
    reduced = reduce_joints(values, "mean", "lower")
    some = bool(stepped.any()) and not stepped.all()
    for (over_joints, better, steps_only), rows in _rows_alike(METRICS.values(), some).items():
        if over_joints not in IN_WORDS:
            other = values[METRICS.names().index(over_joints)]
            reduced[rows] = values[rows, np.argmax(other if METRICS[over_joints].better == "lower" else -other)]
        elif steps_only:
            reduced[rows] = reduce_joints(np.ascontiguousarray(values[rows][:, stepped]), over_joints, better)
        elif over_joints != "mean":
            reduced[rows] = reduce_joints(values[rows], over_joints, better)
    reduced[~np.isfinite(reduced)] = np.nan
    return reduced


@lru_cache(maxsize=8)
def _rows_alike(metrics: tuple[MetricInfo, ...], some: bool) -> dict[tuple[str, str, bool], npt.NDArray[np.intp]]:
    """Return the rows of metrics whose joints make one number in the same way.

    Args:
        metrics: All metrics.
        some: Whether some joints have a step and others do not: metrics that only a step has are apart then.
    """
    alike: dict[tuple[str, str, bool], list[int]] = {}
    for row, info in enumerate(metrics):
        alike.setdefault((info.over_joints, info.better, some and info.steps_only), []).append(row)
    return {key: np.array(rows, dtype=np.intp) for key, rows in alike.items()}


def from_joints(joints: PerJoint) -> Metrics:
    """Return metrics in the form that is stored and shown."""
    n, steps = joints.values.shape[1], int(np.count_nonzero(joints.stepped))
    rows = zip(METRICS.values(), headlines(joints).tolist(), joints.values.tolist(), strict=True)
    return Metrics(
        {
            info.key: Metric(_known(value), tuple([_known(x) for x in row]), steps if info.steps_only else n)
            for info, value, row in rows
        }
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def per_joint(
    trajectory: Trajectory,
    *,
    tau_max: Array,
    metrics_from: float,
    control_period: float,
    step_like: bool,
    phi: Array | float | None = None,
    chattering_from_hz: float = LEAST_CORNER_HZ,
) -> PerJoint:
    """Compute every metric of a completed run, joint by joint.

    RMSE, maximum error, torque metrics and time in band use the samples with t >= `metrics_from`; the
    steady-state error the last 0.5 s; IAE, ITAE and the step response the whole run.

    Args:
        trajectory: The run.
        tau_max: Torque limit of each joint, (n,) [N m]; positive.
        metrics_from: Start of the metrics' window [s].
        control_period: Time between control instants [s].
        step_like: Whether the reference goes from one position to another and stays there, so that rise time,
            overshoot and settling time mean something.
        phi: Half-width of the law's boundary layer, scalar or (n,) [rad/s]; None when it has none.
        chattering_from_hz: Frequency from which the torque counts as chattering [Hz].

    Raises:
        ResultError: the run did not complete, or its window holds fewer than two samples, or a limit is not
            a positive number, or a metric of a plug-in does not return one number for each joint.
    """
    if not trajectory.completed:
        raise ResultError(f"a run that did not complete has no metrics ({trajectory.outcome.value})")
    t, n = trajectory.t, trajectory.q.shape[1]
    limit = np.asarray(tau_max, dtype=np.float64)
    if limit.shape != (n,) or not all(0.0 < x < math.inf for x in limit.tolist()):
        raise ResultError(f"torque limits {limit.tolist()}: wanted {n} positive numbers")
    # t >= metrics_from, whichever way k T was rounded
    first = int(t.searchsorted(metrics_from - 1e-6 * control_period, side="right"))
    if len(t) - first < 2:
        raise ResultError(f"the metrics' window from {metrics_from:g} s holds fewer than two samples")
    width = phi if phi is None or np.shape(phi) == (n,) else np.full(n, phi)
    run = JointRecord(
        trajectory,
        e=trajectory.q_ref - trajectory.q,
        tau_max=limit,
        control_period=control_period,
        window=slice(first, len(t)),
        phi=None if width is None else np.asarray(width, dtype=np.float64),
        chattering_from_hz=chattering_from_hz,
    )
    metrics, shape = METRICS.values(), (n,)
    values = np.full((len(metrics), n), np.nan)
    for row, info in enumerate(metrics):
        if step_like or not info.steps_only:
            try:
                found = np.asarray(info.formula(run))
                if found.shape != shape:
                    raise ResultError(f"returned shape {found.shape}, wanted {shape}: a number for each joint")
                values[row] = found
            except Exception as error:  # a user's function may raise anything
                said = str(error) if isinstance(error, ResultError) else f"{type(error).__name__}: {error}"
                raise ResultError(f"metric '{info.key}': {said}") from error
    return PerJoint(values, response_of(run).counted if step_like else np.zeros(n, dtype=bool))
