"""Response to a step: rise time, overshoot and settling time of each joint that has a step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, shared


class StepResponse(NamedTuple):
    """Response to a step; arrays (n,), NaN where undefined."""

    rise_time: Array
    """Time from 10 % to 90 % of the step [s]; NaN for a joint that never reaches 90 %."""
    overshoot: Array
    """Largest excess over the final reference [% of the step], at least 0."""
    settling_time: Array
    """Time from the step after which |q - q_end| <= 2 % of the step [s]; NaN if outside at the end."""
    counted: npt.NDArray[np.bool_]
    """Joints that have a step at all."""


def step_response(t: Array, q: Array, q_ref: Array) -> StepResponse:
    """Rise time, overshoot and settling time of each joint; crossings are interpolated between samples.

    The step goes from the reference's first value to its last. Time counts from the instant of a jump, the first
    at which the joint's reference differs from its first value; of a reference that moves smoothly, from the
    instant before, at which it begins to move. If no joint's reference ever moves, the step starts at t = 0 from
    each joint's own initial position.
    """
    n = q.shape[1]
    changed = q_ref != q_ref[0]
    moves = bool(changed.any())
    start = q_ref[0] if moves else q[0]
    amplitude = q_ref[-1] - start
    rise, over, settle = (np.full(n, np.nan) for _ in range(3))
    for i in range(n):
        if amplitude[i] == 0.0:
            continue
        first = int(np.argmax(changed[:, i])) if moves else 0
        if first > 0 and abs(q_ref[first, i] - start[i]) < 0.5 * abs(amplitude[i]):
            first -= 1
        times = t[first:]
        y = (q[first:, i] - start[i]) / amplitude[i]
        rise[i] = _reaches(times, y, 0.9) - _reaches(times, y, 0.1)
        over[i] = 100.0 * max(0.0, float(np.max(y)) - 1.0)
        settle[i] = _settles(times, y - 1.0, 0.02)
    return StepResponse(rise, over, settle, amplitude != 0.0)


def _reaches(t: Array, y: Array, level: float) -> float:
    reached = y >= level
    k = int(np.argmax(reached))
    if not reached[k]:
        return math.nan
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]))


def _settles(t: Array, deviation: Array, band: float) -> float:
    outside = np.flatnonzero(np.abs(deviation) > band)
    if len(outside) == 0:
        return 0.0
    k = int(outside[-1])
    if k == len(t) - 1:
        return math.nan
    before, after = deviation[k], deviation[k + 1]
    edge = math.copysign(band, before)
    return float(t[k] + (before - edge) / (before - after) * (t[k + 1] - t[k]) - t[0])


@shared
def response_of(run: JointRecord) -> StepResponse:
    """Return the response of a run whose reference is like a step."""
    return step_response(run.t, run.q, run.q_ref)


@metric("rise_time", title="rise time 10-90 %", unit="s", steps_only=True, column="rise")
def rise_time(run: JointRecord) -> Array:
    """Time from 10 to 90 % of the step; references `step` and `quintic` only, as the next two."""
    return response_of(run).rise_time


@metric("overshoot", title="overshoot", unit="%", over_joints="worst", steps_only=True, column="over")
def overshoot(run: JointRecord) -> Array:
    """Beyond the target, % of the step."""
    return response_of(run).overshoot


@metric("settling_time", title="settling time 2 %", unit="s", over_joints="worst", steps_only=True, column="settle")
def settling_time(run: JointRecord) -> Array:
    """Last time outside 2 % of the step."""
    return response_of(run).settling_time
