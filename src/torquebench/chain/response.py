"""Frequency response of a chain: from the true state to what a law sees, and from a law's torque to the joint."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from torquebench.chain.chain import Chain
from torquebench.chain.sensors import kalman_gains
from torquebench.kernel import Array
from torquebench.keys import as_vector

Complex: TypeAlias = npt.NDArray[np.complex128]


class Response(NamedTuple):
    """Complex gains at angular frequencies omega, (m,) each; without dimension."""

    position: Complex
    """From q(t) to the position that the law has at the instants t_k."""
    velocity: Complex
    """Likewise from qd(t) to the velocity."""
    torque: Complex
    """From the law's torque at the instants t_k to that on the joint, its mean over what is drawn."""


def response(chain: Chain, omega: Array, control_period: float) -> Response:
    """Return a chain's response to a small sine, between rounding, limits and offsets, which are not linear.

    Gains of single joints, and what leaks between them, are not in it: see `mixing`.

    With z = exp(j omega T): a delay d is exp(-j omega d); a filter a/(1 - (1 - a)/z), of velocities or commands; a
    difference (1 - 1/z)/(j omega T); the steady Kalman filter (beta/T) r/(1 - 1/z) with its residual r; the hold (1 -
    1/z)/(j omega T); a command late by an even draw from 0 to J, (1 - exp(-j omega J))/(j omega J); one missed with
    probability p, (1 - p)/(1 - p/z); the lag 1/(1 + j omega lag); the current loop w^2/(w^2 - omega^2 + 2 j zeta w
    omega). Jitter counts as if it were not rounded to physics steps.

    Args:
        chain: Sensors and actuators.
        omega: Angular frequencies above zero, (m,) [rad/s]; up to pi/T they mean something.
        control_period: Control period T [s].
    """
    T, rate = control_period, np.asarray(1j * np.asarray(omega), dtype=np.complex128)
    back: Complex = np.exp(-rate * T)
    seen = np.exp(-rate * chain.measurement_delay)
    velocity = _velocity(chain, rate, back, T)
    loop = chain.current_loop
    acting: Complex = 1.0 / (1.0 + rate * chain.actuator_lag)
    if loop is not None:
        w = loop.frequency
        acting = w * w / (w * w + rate * rate + 2.0 * loop.damping * w * rate)
    missed = chain.missed_deadlines
    kept = (1.0 - missed) / (1.0 - missed * back) if missed < 1.0 else np.zeros_like(back)
    waiting = np.exp(-rate * (chain.command_delay + chain.torque_delay))
    taken = chain.command_gain(T)
    waiting = waiting * taken / (1.0 - (1.0 - taken) * back)
    return Response(seen, seen * velocity, _mean(rate, T) * _mean(rate, chain.jitter) * kept * waiting * acting)


def mixing(chain: Chain, n: int, time: float) -> Array:
    """Return the matrix by which drives multiply torques within their limits: (I + cross-talk) diag(gains), (n, n) [1].

    It has no frequency, and so stands beside `response`, whose gains are the same for all joints.

    Args:
        chain: Sensors and actuators.
        n: Number of joints.
        time: Time since the start, at which motors may have weakened [s].
    """
    gains, weak, talk = as_vector(chain.torque_gain, n), chain.derating, chain.cross_talk
    if weak is not None and time >= weak.at:
        gone = min((time - weak.at) / weak.over, 1.0) if weak.over > 0.0 else 1.0
        gains = gains * (1.0 + gone * (as_vector(weak.gain, n) - 1.0))
    if talk is None:
        return np.diag(gains)
    following, preceding = as_vector(talk.following, n), as_vector(talk.preceding, n)
    leaks = np.diag(following[:-1], 1) + np.diag(preceding[1:], -1)
    return np.asarray((np.eye(n) + leaks) * gains)


def _mean(rate: Complex, time: float) -> Complex:
    """Return the mean of exp(-rate t) for t from 0 to `time`; 1 for none."""
    return np.ones_like(rate) if time == 0.0 else -np.expm1(-rate * time) / (rate * time)


def _velocity(chain: Chain, rate: Complex, back: Complex, T: float) -> Complex:
    """Return the gain from the true velocity to the measured one.

    Args:
        chain: Sensors and actuators.
        rate, back: j omega and 1/z, (m,).
        T: Control period [s].
    """
    if chain.velocity == "exact":
        return np.ones_like(rate)
    difference = 1.0 - back
    if chain.velocity == "kalman" and chain.kalman_acceleration is not None:
        alpha, beta = kalman_gains(chain.kalman_acceleration, chain.position_noise, T)
        residual = 1.0 / (1.0 + back * (back * beta / difference + alpha) / difference + back * beta / difference)
        return beta * residual / (difference * T * rate)
    gain = chain.velocity_gain(T)
    filtered = gain / (1.0 - (1.0 - gain) * back)
    return filtered if chain.velocity == "tachometer" else filtered * difference / (rate * T)
