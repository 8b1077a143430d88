"""Sensors of an arm, as laws see it: encoders with noise, offset, ripple and steps; four ways to a velocity; delay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from torquebench.kernel import Array, kernel
from torquebench.kernel.struct import Structure
from torquebench.keys import Key, Vector, check_numbers

EXACT, DIFFERENTIATED, TACHOMETER, KALMAN = range(4)
VELOCITIES = ("exact", "differentiated", "tachometer", "kalman")
"""Names of the ways to a velocity, in the order of their numbers."""


@dataclass(frozen=True)
class Ripple:
    """Periodic error of the encoders: amplitude sin(cycles q + phase), from an eccentric disc or an uneven scale.

    Raises:
        ValueError: a number is out of range.
    """

    amplitude: Annotated[Vector, Key("Amplitude", "rad", ", in m for slide joints", at_least=0)]
    cycles: Annotated[
        Vector, Key("Periods in one turn of the joint", "1", "; in 1/m for slide joints periods over 2 pi", above=0)
    ] = 1.0
    phase: Annotated[Vector, Key("Phase at q = 0", "rad")] = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)


@dataclass(frozen=True, eq=False)
class Sensors(Structure):
    """The sensors of n joints over N control instants as kernels see them; arrays of no rows stand for none."""

    noise: Annotated[Array, 2]
    """Added to the measured position, (N, n) or (0, n) [rad]."""
    offset: Array
    """Likewise, constant, (n,) or (0,) [rad]."""
    ripple: Annotated[Array, 2]
    """Amplitude [rad], cycles and phase [rad] of the periodic error, (3, n) or (0, n)."""
    quantum: float
    """The measured position is rounded to a multiple of this; 0 for none [rad]."""
    velocity: int
    """One of EXACT, DIFFERENTIATED, TACHOMETER and KALMAN."""
    gain: float
    """Share of a new velocity that the filter takes in; 1 without a filter."""
    velocity_noise: Annotated[Array, 2]
    """Added to the tachometer's velocity, (N, n) or (0, n) [rad/s]."""
    alpha: float
    beta: float
    """Gains of the steady Kalman filter for position and velocity."""
    estimate: Array
    """The Kalman filter's position, (n,) [rad]; (0,) without."""

    @property
    def exact(self) -> bool:
        """Whether the law sees the state itself."""
        parts = (self.noise, self.offset, self.ripple)
        return self.velocity == EXACT and self.quantum == 0.0 and not any(len(part) for part in parts)


@kernel
def nearest_multiple(x: float, quantum: float) -> float:
    """Return the whole multiple of `quantum` nearest to x; x itself where floats lie further apart than multiples."""
    if abs(x) < 4503599627370496.0 * quantum:  # 2^52
        return quantum * math.floor(x / quantum + 0.5)
    return x


@kernel
def measure(sensors: Sensors, k: int, T: float, q: Array, qd: Array, seen_q: Array, seen_qd: Array) -> None:
    """Fill `seen_q` and `seen_qd`, (n,), with what is measured at control instant k; they hold what was before.

    y = round(q + amplitude sin(cycles q + phase) + offset + noise). The velocity is that of the state; or the backward
    difference through a filter, v += a ((y - y_before)/T - v) with v = 0 at first; or a tachometer's, the true one
    with noise through that filter, v = qd + noise at first; or a steady Kalman filter's, with r = y - (x + T v),
    x += T v + alpha r, v += beta r/T, from x = y and v = 0 at first.

    Args:
        sensors: The sensors.
        k: Number of the control instant.
        T: Time between control instants [s].
        q, qd: The state, (n,) [rad, rad/s].
        seen_q, seen_qd: Measured position and velocity.
    """
    noisy, rippled, shifted = len(sensors.noise) > 0, len(sensors.ripple) > 0, len(sensors.offset) > 0
    for i in range(len(q)):
        position = q[i]
        if rippled:
            position += sensors.ripple[0, i] * math.sin(sensors.ripple[1, i] * q[i] + sensors.ripple[2, i])
        if shifted:
            position += sensors.offset[i]
        if noisy:
            position += sensors.noise[k, i]
        if sensors.quantum > 0.0:
            position = nearest_multiple(position, sensors.quantum)
        if sensors.velocity == EXACT:
            seen_qd[i] = qd[i]
        elif sensors.velocity == TACHOMETER:
            rate = qd[i]
            if len(sensors.velocity_noise) > 0:
                rate += sensors.velocity_noise[k, i]
            if k == 0:
                seen_qd[i] = rate
            else:
                seen_qd[i] += sensors.gain * (rate - seen_qd[i])
        elif k == 0:
            seen_qd[i] = 0.0
            if sensors.velocity == KALMAN:
                sensors.estimate[i] = position
        elif sensors.velocity == KALMAN:
            ahead = sensors.estimate[i] + T * seen_qd[i]
            residual = position - ahead
            sensors.estimate[i] = ahead + sensors.alpha * residual
            seen_qd[i] += sensors.beta * residual / T
        else:
            rate = (position - seen_q[i]) / T
            seen_qd[i] += sensors.gain * (rate - seen_qd[i])
        seen_q[i] = position


def kalman_gains(acceleration: float, noise: float, T: float) -> tuple[float, float]:
    """Return the steady gains alpha and beta of the Kalman filter of a joint whose acceleration is white.

    The model is x' = v, v' = w with w constant over each period, of standard deviation `acceleration`; the position is
    measured with white noise. With L = acceleration T^2/noise, r = (4 + L - sqrt(8 L + L^2))/4, alpha = 1 - r^2 and
    beta = 2 (2 - alpha) - 4 sqrt(1 - alpha) (Kalata 1984, IEEE Trans. AES 20(2), 174-182).

    Args:
        acceleration: Standard deviation of the acceleration [rad/s^2].
        noise: Standard deviation of the measured position [rad].
        T: Time between measurements [s].
    """
    index = acceleration * T * T / noise
    r = (4.0 + index - math.sqrt(8.0 * index + index * index)) / 4.0
    # beta = 2 (2 - alpha) - 4 sqrt(1 - alpha) without cancellation: 2 (1 - r)^2, since 1 - alpha = r^2
    return (1.0 - r) * (1.0 + r), 2.0 * (1.0 - r) ** 2
