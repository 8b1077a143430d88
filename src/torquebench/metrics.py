"""Figures of merit of one completed run: tracking error, step response, chattering and effort.

Source of every definition: docs/definitions.md, "Metrics"; the formulas are in `measures`. This module
chooses the windows, keeps undefined values visible, and reduces each metric to its headline. Errors are those
of the true position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench import measures
from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.sim.trajectory import Trajectory

STEADY_SPAN = 0.5
"""Length of the end of a run over which the steady-state error is taken [s]."""
STEP_KINDS = ("step", "quintic")
"""Kinds of reference that have a rise time, an overshoot and a settling time."""

_Counted = npt.NDArray[np.bool_]


class MetricInfo(NamedTuple):
    """How one metric is named and read."""

    key: str
    title: str
    unit: str
    """SI unit; ``1`` for a pure number."""
    better: Literal["lower", "higher"]
    headline: str
    """How the headline follows from the joints."""


METRICS = (
    MetricInfo("rmse", "RMS error", "rad", "lower", "all joints and samples"),
    MetricInfo("max_error", "maximum error", "rad", "lower", "worst joint"),
    MetricInfo("steady_state_error", "steady-state error", "rad", "lower", "worst joint"),
    MetricInfo("iae", "IAE", "rad s", "lower", "mean of joints"),
    MetricInfo("itae", "ITAE", "rad s^2", "lower", "mean of joints"),
    MetricInfo("rise_time", "rise time 10-90 %", "s", "lower", "mean of joints"),
    MetricInfo("overshoot", "overshoot", "%", "lower", "worst joint"),
    MetricInfo("settling_time", "settling time 2 %", "s", "lower", "worst joint"),
    MetricInfo("hf", "chattering index HF", "% of tau_max", "lower", "mean of joints"),
    MetricInfo("total_variation", "torque total variation", "tau_max/s", "lower", "mean of joints"),
    MetricInfo("reversals", "torque reversals", "1/s", "lower", "mean of joints"),
    MetricInfo("effort", "control effort", "1", "lower", "mean of joints"),
    MetricInfo("saturation_fraction", "time in saturation", "1", "lower", "mean of joints"),
    MetricInfo("time_in_band", "time in boundary layer", "1", "higher", "mean of joints"),
)
"""Every metric, in the order of tables."""


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


@dataclass(frozen=True, slots=True)
class Metrics:
    """Every metric of one completed run, in SI units; `METRICS` describes the fields in the same order."""

    rmse: Metric
    max_error: Metric
    steady_state_error: Metric
    iae: Metric
    itae: Metric
    rise_time: Metric
    overshoot: Metric
    settling_time: Metric
    hf: Metric
    total_variation: Metric
    reversals: Metric
    effort: Metric
    saturation_fraction: Metric
    time_in_band: Metric

    def items(self) -> tuple[tuple[MetricInfo, Metric], ...]:
        """Return (description, metric) pairs in table order."""
        return tuple((info, getattr(self, info.key)) for info in METRICS)

    def to_json(self) -> dict[str, dict[str, Any]]:
        """Return a JSON-ready mapping from key to `Metric.to_json`, in table order; it never holds NaN."""
        return {info.key: metric.to_json() for info, metric in self.items()}


ROW = {info.key: row for row, info in enumerate(METRICS)}
WORST = [row for row, info in enumerate(METRICS) if info.headline == "worst joint"]
STEP = slice(ROW["rise_time"], ROW["settling_time"] + 1)
"""Rows of the metrics that only a step has."""
ERRORS = slice(ROW["rmse"], ROW["itae"] + 1)
"""Rows of `measures.Errors`."""
TORQUES = slice(ROW["total_variation"], ROW["saturation_fraction"] + 1)
"""Rows of `measures.Torques`."""


class PerJoint(NamedTuple):
    """Every metric of every joint, before it is reduced to its headline."""

    values: Array
    """A row for each of `METRICS`, (len(METRICS), n); NaN where undefined."""
    stepped: _Counted
    """Joints that have a step, (n,): only these count in the metrics of the step response."""


def headlines(found: PerJoint) -> Array:
    """Return the headline of each of `METRICS`, (len(METRICS),); NaN where a joint that counts has no value.

    Args:
        found: The metrics of the joints.
    """
    values = found.values
    reduced: Array = np.add.reduce(values, axis=1) / values.shape[1]
    reduced[WORST] = np.maximum.reduce(values, axis=1)[WORST]
    squares = values[ROW["rmse"]] * values[ROW["rmse"]]
    reduced[ROW["rmse"]] = np.sqrt(np.add.reduce(squares) / len(squares))
    if not found.stepped.all():
        own = values[STEP, found.stepped]
        reduced[STEP] = np.nan
        if own.size > 0:
            reduced[ROW["rise_time"]] = np.add.reduce(np.ascontiguousarray(own[0])) / own.shape[1]
            reduced[ROW["overshoot"]], reduced[ROW["settling_time"]] = np.maximum.reduce(own[1:], axis=1)
    reduced[~np.isfinite(reduced)] = np.nan
    return reduced


def _listed(row: list[float]) -> tuple[float | None, ...]:
    return tuple([x if math.isfinite(x) else None for x in row])


def compute_metrics(
    trajectory: Trajectory,
    *,
    tau_max: Array,
    metrics_from: float,
    control_period: float,
    reference_kind: str,
    phi: Array | float | None = None,
) -> Metrics:
    """Compute every metric of a completed run; arguments as of `per_joint`."""
    found = per_joint(
        trajectory,
        tau_max=tau_max,
        metrics_from=metrics_from,
        control_period=control_period,
        reference_kind=reference_kind,
        phi=phi,
    )
    return from_joints(found)


def from_joints(found: PerJoint) -> Metrics:
    """Return metrics in the form that is stored and shown."""
    counted = [found.values.shape[1]] * len(METRICS)
    counted[STEP] = [int(np.count_nonzero(found.stepped))] * 3
    reduced = [value if math.isfinite(value) else None for value in headlines(found).tolist()]
    rows = map(_listed, found.values.tolist())
    return Metrics(*map(Metric, reduced, rows, counted))


def per_joint(
    trajectory: Trajectory,
    *,
    tau_max: Array,
    metrics_from: float,
    control_period: float,
    reference_kind: str,
    phi: Array | float | None = None,
) -> PerJoint:
    """Compute every metric of a completed run, joint by joint.

    RMSE, maximum error, torque metrics and time in band use the samples with t >= `metrics_from`; the
    steady-state error the last 0.5 s; IAE, ITAE and the step response the whole run.

    Args:
        trajectory: The run.
        tau_max: Torque limit of each joint, (n,) [N m]; positive.
        metrics_from: Start of the metrics' window [s].
        control_period: Time between control instants [s].
        reference_kind: Kind of the reference; only `step` and `quintic` have a step response.
        phi: Half-width of the law's boundary layer, scalar or (n,) [rad/s]; None when it has none.

    Raises:
        ResultError: the run did not complete, or its window holds fewer than two samples, or a limit is not
            a positive number.
    """
    if not trajectory.completed:
        raise ResultError(f"a run that did not complete has no metrics ({trajectory.outcome.value})")
    t, q, q_ref, n = trajectory.t, trajectory.q, trajectory.q_ref, trajectory.q.shape[1]
    limit = np.asarray(tau_max, dtype=np.float64)
    if limit.shape != (n,) or not all(0.0 < x < math.inf for x in limit.tolist()):
        raise ResultError(f"torque limits {limit.tolist()}: wanted {n} positive numbers")
    # t >= metrics_from, whichever way k T was rounded
    first = int(np.searchsorted(t, metrics_from - 1e-6 * control_period, side="right"))
    if len(t) - first < 2:
        raise ResultError(f"the metrics' window from {metrics_from:g} s holds fewer than two samples")
    e, tau, s = q_ref - q, trajectory.tau[first:], trajectory.s[first:]
    values = np.full((len(METRICS), n), np.nan)
    stepped = np.zeros(n, dtype=bool)
    if reference_kind in STEP_KINDS:
        *response, stepped = measures.step_response(t, q, q_ref)
        values[STEP] = response
    last = math.floor(STEADY_SPAN / control_period + 1e-6)
    values[ERRORS] = measures.errors(t, e, first, last if last <= len(e) else 0)
    values[ROW["hf"]] = measures.chattering_index(tau, control_period, limit)
    values[TORQUES] = measures.torques(tau, control_period, limit)
    if phi is not None:
        values[ROW["time_in_band"]] = measures.time_in_band(s, phi)
    return PerJoint(values, stepped)
