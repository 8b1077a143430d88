"""Desired motion: what a law is given of it, how a kind is registered, and motions sampled by users.

A kind is a frozen dataclass whose fields are its keys (see `Key`), with one method::

    sample(t, n) -> Reference  # position, velocity and acceleration at each time, each (N, n)

and, if it likes, ``check(timing)``, which yields a `Fault` for each key that does not fit the run. It may say by
``metrics_from`` when the window for metrics opens where a config does not [s], by ``is_step_like = True`` that rise
time, overshoot and settling time have a meaning, by ``has_corners = True`` that its rates leave out jumps, and by a
method ``highest_hz()`` what its highest frequency is [Hz], above a multiple of which torque counts as chattering; of
one that does not say, `highest_frequency` finds it. Of a user's kind without corners it is checked that the rates are
the derivatives of the positions. A kind that depends on the arm has ``on_arm(model)`` in place of ``sample``: it
returns an object with that method, or raises a `PathError`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import numpy as np

from torquebench.errors import InconsistentReferenceError
from torquebench.kernel import Array
from torquebench.keys import Key, Kinds, Vector, as_vector


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

REFERENCES = Kinds(
    "reference",
    defaults={"metrics_from": 1.0, "is_step_like": False, "has_corners": False},
    methods=("sample(t, n)|on_arm(model)",),
)
reference = REFERENCES
"""Decorator of a class: ``@reference("lemniscate")``."""
ROUNDING = 1e-9
"""A control instant this close before an event counts as the event's [s]: k T is rounded."""


ORIGIN = Key(
    "Position from which the motion starts",
    "rad",
    ", in m for slide joints; if left out, that of run.initial_q where it is a keyframe, else zero",
)


def each_joint(value: Vector, n: int | None) -> Array:
    """Return a number for each of `n` joints, (n,); of None, as many as there are."""
    return np.atleast_1d(np.array(value, dtype=np.float64)) if n is None else as_vector(value, n)


@dataclass(frozen=True)
class Motion(ABC):
    """A kind that may be called with times alone, as a `ReferenceSource`, and that begins where it is told to."""

    origin: Annotated[Vector | None, ORIGIN] = field(default=None, kw_only=True)

    @abstractmethod
    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion of `n` joints at times (N,) [s]; None for as many as its keys have numbers."""

    def highest_hz(self) -> float:
        """Return the highest frequency of the motion [Hz]: 0, but for kinds that swing."""
        return 0.0

    @property
    def swings_hz(self) -> tuple[float, ...]:
        """Frequencies with which it goes to and fro, each once [Hz]; none for a motion that does not repeat itself."""
        return ()

    def way(self, target: Vector, n: int | None) -> Array:
        """Return how far a target is from the origin, for each of `n` joints."""
        goal = each_joint(target, n)
        return goal if self.origin is None else goal - each_joint(self.origin, n)

    def placed(self, position: Array, n: int | None) -> Array:
        """Return positions relative to the origin, (N, n), as they are [rad]."""
        return position if self.origin is None else position + each_joint(self.origin, n)

    def __call__(self, t: Array) -> Reference:
        """Return the desired motion at times (N,) [s]."""
        return self.sample(t)


def depends_on_arm(kind: Any) -> bool:
    """Whether a motion is a path of the tool, which is another motion of the joints on each arm."""
    return hasattr(kind, "on_arm")


def highest_frequency(qd: Array, control_period: float) -> float:
    """Return the frequency below which 99.9 % of the power of each joint's desired velocity lies [Hz].

    Args:
        qd: Desired velocity at each control instant, (N, n) [rad/s].
        control_period: Time between them [s].
    """
    n = len(qd)
    power = np.abs(np.fft.rfft(qd * np.hanning(n)[:, None], axis=0)) ** 2  # tapered: a motion cut off has no corners
    whole = np.sum(power, axis=0)
    power[:, whole < 1e-18 * np.max(whole)] = 0.0  # a joint that stands still but for round-off
    within = np.cumsum(power, axis=0) >= 0.999 * np.sum(power, axis=0)
    return float(np.fft.rfftfreq(n, control_period)[np.max(np.argmax(within, axis=0))])


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
        change, integral, excess = against_rate(h, value, rate)
        if np.any(excess > 1.0):
            k, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
            raise InconsistentReferenceError(
                f"{name} is not the derivative of {'q' if name == 'qd' else 'qd'}: at t = {t[k + 1]:g} s, joint "
                f"{joint + 1}, the change is {change[k, joint]:.6g} but {name} integrates to {integral[k, joint]:.6g}"
            )
    return Reference(q, qd, qdd)


def against_rate(h: float, value: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Return what a sampled value changes by over two samples, what its rate integrates to, and the gap of the two.

    The gap is over what is allowed, see `from_samples`: the rate is no derivative where it is more than 1.

    Args:
        h: Time between samples [s].
        value, rate: The value and its rate, (N, n).
    """
    change = value[2:] - value[:-2]
    integral = h / 3.0 * (rate[:-2] + 4.0 * rate[1:-1] + rate[2:])
    allowed = 0.01 * np.max(np.abs(change), axis=0) + 1e-4 * np.max(np.abs(change)) + 1e-9
    return change, integral, np.abs(change - integral) / allowed
