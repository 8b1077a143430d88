"""From a completed run to its metrics: every metric by joint, and the headline of each.

Source of every definition: docs/definitions.md, "Metrics". This module chooses the windows, keeps undefined values
visible, and reduces each metric to its headline. Errors are those of the true position.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.errors import ResultError
from torquebench.kernel import Array, is_foreign
from torquebench.metrics.chattering import LEAST_CORNER_HZ
from torquebench.metrics.declare import IN_WORDS, METRICS, MetricInfo, reduce_joints
from torquebench.metrics.record import JointRecord
from torquebench.metrics.step_response import response_of
from torquebench.robot import RobotModel
from torquebench.sim.trajectory import Trajectory

BLOCK = 200_000
"""Samples of a signal, of all joints of all runs, that are taken side by side: some that a processor's cache holds."""


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
        info = METRICS.find(key)  # names the nearest key where there is none
        return self._values.get(key, Metric(None, (), 0)) if info.of_tool else self._values[key]

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
    """Every metric of every joint, before it is reduced to its headline; of runs side by side, R runs."""

    values: Array
    """A row for each of `METRICS`, (len(METRICS), n) or (len(METRICS), R, n); NaN where undefined."""
    stepped: npt.NDArray[np.bool_]
    """Joints that have a step, (n,) or (R, n): only these count in metrics that only a step has."""


def headlines(joints: PerJoint) -> Array:
    """Return the headline of each of `METRICS`, (len(METRICS),) or (len(METRICS), R).

    Args:
        joints: The metrics of the joints.

    Returns:
        NaN where a joint that counts has no value.
    """
    values, stepped = joints
    reduced = reduce_joints(values, "mean", "lower")
    some = bool(stepped.any()) and not stepped.all()
    if some and values.ndim > 2:  # other joints may count in each run
        runs = zip(values.swapaxes(0, 1), stepped, strict=True)
        return np.stack([headlines(PerJoint(own, counted)) for own, counted in runs], axis=1)
    for (over_joints, better, steps_only), rows in _rows_alike(METRICS.values(), some).items():
        if over_joints not in IN_WORDS:
            other = values[METRICS.names().index(over_joints)]
            worst = np.argmax(other if METRICS[over_joints].better == "lower" else -other, axis=-1)
            reduced[rows] = np.take_along_axis(values[rows], worst[None, ..., None], axis=-1)[..., 0]
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
            info.key: Metric(value, (), 0)
            if info.of_tool
            else Metric(_known(value), tuple([_known(x) for x in row]), steps if info.steps_only else n)
            for info, value, row in rows
            if not info.of_tool or math.isfinite(value)
        }
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def headlines_of(runs: Iterable[tuple[int, JointRecord]]) -> Iterator[tuple[int, Array]]:
    """Yield the headlines of many runs, each with its number, in any order; the bytes are those of each run alone.

    Runs of one length are taken side by side, as one run of an arm with all their joints: one pass over the samples,
    and one Fourier transform, serves all. A signal may be written over as soon as the next run is asked for.

    Args:
        runs: Number and record of each.
    """
    blocks: dict[tuple[Any, ...], _Block] = {}
    own = not any(is_foreign(info.formula) for info in METRICS.values())  # a user's metric may join joints
    for number, run in runs:
        # of a single joint numpy adds up the lines of a spectrum in another order
        if not own or run.arm is not None or run.q.shape[1] == 1 or 2 * run.q.size > BLOCK:
            yield number, headlines(measured(run))
            continue
        steps = run.step_like, run.step_like and bool(np.any(run.q_ref != run.q_ref[0]))
        window = run.q.shape, run.control_period, run.window.start
        kind = *window, run.chattering_from_hz, run.motion_hz, run.phi is None, *steps
        if kind not in blocks:
            blocks[kind] = _Block(run)
        if blocks[kind].add(number, run):
            yield from blocks[kind].headlines()
    for block in blocks.values():
        yield from block.headlines()


class _Block:
    """Runs side by side, for `headlines_of`.

    Args:
        run: One of them, not yet added.
    """

    def __init__(self, run: JointRecord) -> None:
        self._like, self._numbers, self._most = run, list[int](), BLOCK // run.q.size
        self._disturbances = list[Array | None]()
        seen = ["tau", "tau_max", *["q", "q_ref"] * run.step_like, *["s", "phi"] * (run.phi is not None)]
        shapes = {"e": run.q.shape} | {name: getattr(run, name).shape for name in seen}
        self._wide = {name: np.empty((*shape[:-1], self._most, shape[-1])) for name, shape in shapes.items()}

    def add(self, number: int, run: JointRecord) -> bool:
        """Add a run; true if there is no room for another one."""
        for name, wide in self._wide.items():
            if name == "e":
                np.subtract(run.q_ref, run.q, out=wide[:, len(self._numbers)])
            else:
                wide[..., len(self._numbers), :] = getattr(run, name)
        self._numbers.append(number)
        self._disturbances += run.disturbances
        return len(self._numbers) == self._most

    def headlines(self) -> Iterator[tuple[int, Array]]:
        """Yield number and headlines of each run, and forget them."""
        numbers, self._numbers = self._numbers, []
        disturbed, self._disturbances = tuple(self._disturbances), []
        if numbers:
            parts = {name: np.ascontiguousarray(wide[..., : len(numbers), :]) for name, wide in self._wide.items()}
            wide: dict[str, Any] = {name: part.reshape(*part.shape[:-2], -1) for name, part in parts.items()}
            values, stepped = measured(
                replace(self._like, _shared={"e": wide.pop("e")}, disturbances=disturbed, **wide)
            )
            joints = PerJoint(values.reshape(len(values), len(numbers), -1), stepped.reshape(len(numbers), -1))
            yield from zip(numbers, headlines(joints).T, strict=True)


def per_joint(trajectory: Trajectory, **conditions: Any) -> PerJoint:
    """Compute every metric of a completed run, joint by joint; arguments and errors as of `record_of`, `measured`."""
    return measured(record_of(trajectory, **conditions))


def record_of(
    trajectory: Trajectory,
    *,
    tau_max: Array,
    metrics_from: float,
    control_period: float,
    step_like: bool,
    phi: Array | float | None = None,
    chattering_from_hz: float = LEAST_CORNER_HZ,
    arm: RobotModel | None = None,
    disturbance: Array | None = None,
    motion_hz: tuple[float, ...] = (),
) -> JointRecord:
    """Return a completed run as metrics see it.

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
        arm: The true arm, where errors of its tool are wanted.
        disturbance: Torque that disturbs the joints at each control instant, (N, n) [N m].
        motion_hz: Frequencies with which the reference swings [Hz].

    Raises:
        ResultError: the run did not complete, or its window holds fewer than two samples, or a limit is not
            a positive number.
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
    return JointRecord(
        trajectory,
        t,
        trajectory.q,
        trajectory.q_ref,
        tau=trajectory.tau,
        s=trajectory.s,
        tau_max=limit,
        control_period=control_period,
        window=slice(first, len(t)),
        phi=None if width is None else np.asarray(width, dtype=np.float64),
        chattering_from_hz=chattering_from_hz,
        step_like=step_like,
        arm=arm,
        disturbances=(disturbance,),
        motion_hz=motion_hz,
    )


def measured(run: JointRecord, only: Collection[str] | None = None) -> PerJoint:
    """Compute every metric of a run, joint by joint.

    Args:
        run: The run.
        only: Keys of the metrics whose headlines are wanted, the others are NaN; None for all.

    Raises:
        ResultError: a metric of a plug-in does not return one number for each joint.
    """
    metrics, shape = METRICS.values(), run.tau_max.shape
    values = np.full((len(metrics), *shape), np.nan)
    # a headline may be that of the joint with the worst of another metric
    needed: Collection[str] = METRICS if only is None else {*only, *(METRICS[key].over_joints for key in only)}
    for row, info in enumerate(metrics):
        if info.key in needed and (run.step_like or not info.steps_only):
            try:
                found, wanted = np.asarray(info.formula(run)), () if info.of_tool else shape
                if found.shape != wanted:
                    raise ResultError(f"returned shape {found.shape}, wanted {wanted}: a number for each joint")
                values[row] = found
            except Exception as error:  # a user's function may raise anything
                said = str(error) if isinstance(error, ResultError) else f"{type(error).__name__}: {error}"
                raise ResultError(f"metric '{info.key}': {said}") from error
    return PerJoint(values, response_of(run).counted if run.step_like else np.zeros(shape, dtype=bool))
