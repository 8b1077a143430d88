"""Reference trajectories: closed forms of time that state their own first and second derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.errors import InconsistentReferenceError
from torquebench.kernel import Array


class Reference(NamedTuple):
    """Desired motion; one sample (n,) inside a law, sampled arrays (N, n) outside."""

    q: Array
    """Desired joint position [rad or m]."""
    qd: Array
    """Desired joint velocity [rad/s or m/s]."""
    qdd: Array
    """Desired joint acceleration [rad/s^2 or m/s^2]."""


ReferenceSource = Callable[[Array], Reference]
"""A function from times (N,) [s] to the desired motion, arrays (N, n); (N, 1) stands for the same on every joint."""

ROUNDING = 1e-9
"""A control instant this close before an event counts as the event's [s]: k T is rounded."""


def sine(amplitude: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> ReferenceSource:
    """Raised sine q_ref = A/2 (1 - cos 2 pi f t), at rest at t = 0.

    Args:
        amplitude: Peak-to-peak excursion A of each joint, (n,) or one number for all [rad].
        frequency_hz: Frequency f of each joint, (n,) or one number for all [Hz].
    """
    half = np.atleast_1d(np.array(amplitude, dtype=np.float64)) / 2.0
    w = 2.0 * math.pi * np.atleast_1d(np.array(frequency_hz, dtype=np.float64))

    def sample(t: Array) -> Reference:
        phase = t[:, None] * w
        return Reference(half * (1.0 - np.cos(phase)), half * w * np.sin(phase), half * w * w * np.cos(phase))

    return sample


def step(target: npt.ArrayLike, at: float) -> ReferenceSource:
    """Zero before t = `at`, `target` from then on; the desired rates are zero throughout.

    Args:
        target: Position after the step, (n,) or one number for all [rad].
        at: Time of the step [s].
    """
    goal = np.atleast_1d(np.array(target, dtype=np.float64))

    def sample(t: Array) -> Reference:
        zero = np.zeros((len(t), len(goal)))
        return Reference(np.where(t[:, None] >= at - ROUNDING, goal, 0.0), zero, zero.copy())

    return sample


def ramp(target: npt.ArrayLike, rise_time: float) -> ReferenceSource:
    """Constant speed from zero to `target` in `rise_time`, then held; the desired acceleration is zero.

    Args:
        target: Final position, (n,) or one number for all [rad].
        rise_time: Duration of the motion [s].
    """
    goal = np.atleast_1d(np.array(target, dtype=np.float64))

    def sample(t: Array) -> Reference:
        x = np.clip(t / rise_time, 0.0, 1.0)[:, None]
        moving = (t < rise_time - ROUNDING)[:, None]
        return Reference(x * goal, np.where(moving, goal / rise_time, 0.0), np.zeros((len(t), len(goal))))

    return sample


def quintic(target: npt.ArrayLike, rise_time: float) -> ReferenceSource:
    """Minimum-jerk polynomial 10x^3 - 15x^4 + 6x^5, x = t / rise_time, from zero to `target`, then held.

    Args:
        target: Final position, (n,) or one number for all [rad].
        rise_time: Duration of the motion [s].
    """
    goal = np.atleast_1d(np.array(target, dtype=np.float64))

    def sample(t: Array) -> Reference:
        x = np.clip(t / rise_time, 0.0, 1.0)[:, None]
        position = x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
        velocity = 30.0 * x * x * (1.0 - x) * (1.0 - x) / rise_time
        acceleration = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (rise_time * rise_time)
        return Reference(position * goal, velocity * goal, acceleration * goal)

    return sample


def from_samples(t: Array, q: Array, qd: Array, qdd: Array) -> Reference:
    """Accept a user's sampled motion after checking that its rates are the derivatives of its positions.

    The change of `q` over two samples is compared with Simpson's integral of `qd`, and that of `qd` with the
    integral of `qdd`. The allowance for a joint is 1 % of its own largest change, plus 1e-4 of any joint's, plus 1e-9.

    Args:
        t: Sample times, evenly spaced, (N,) [s].
        q, qd, qdd: Desired position [rad], velocity [rad/s] and acceleration [rad/s^2]; each (N, n).

    Raises:
        InconsistentReferenceError: wrong shapes, uneven times, non-finite values, or rates that do not fit.
    """
    t, q, qd, qdd = (np.array(x, dtype=np.float64) for x in (t, q, qd, qdd))
    if t.ndim != 1 or len(t) < 3 or q.ndim != 2 or not (len(t) == len(q) and q.shape == qd.shape == qdd.shape):
        raise InconsistentReferenceError(
            f"shapes t {t.shape}, q {q.shape}, qd {qd.shape}, qdd {qdd.shape}: wanted (N,) with N >= 3 and three (N, n)"
        )
    if not all(np.all(np.isfinite(x)) for x in (t, q, qd, qdd)):
        raise InconsistentReferenceError("the reference has values that are not finite")
    h = t[1] - t[0]
    if h <= 0 or not np.allclose(np.diff(t), h, rtol=1e-6, atol=0):
        raise InconsistentReferenceError("reference times must be evenly spaced and increasing")
    for name, value, rate in (("qd", q, qd), ("qdd", qd, qdd)):
        change = value[2:] - value[:-2]
        integral = h / 3.0 * (rate[:-2] + 4.0 * rate[1:-1] + rate[2:])
        gap = np.abs(change - integral)
        allowed = 0.01 * np.max(np.abs(change), axis=0) + 1e-4 * np.max(np.abs(change)) + 1e-9
        if np.any(gap > allowed):
            k, joint = np.unravel_index(int(np.argmax(gap / allowed)), gap.shape)
            raise InconsistentReferenceError(
                f"{name} is not the derivative of {'q' if name == 'qd' else 'qd'}: at t = {t[k + 1]:g} s, joint "
                f"{joint + 1}, the change is {change[k, joint]:.6g} but {name} integrates to {integral[k, joint]:.6g}"
            )
    return Reference(q, qd, qdd)
