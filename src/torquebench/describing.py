"""Limit cycles predicted by describing functions: of a switching law, of one with a layer, beside joint friction.

One mode of the arm at rest, s = (j omega + lambda) x, under a law whose torque per unit of s is D and a chain: harmonic
balance, 1 + D G1 + G2 + F = 0, with G1 = h(omega) / (M (j omega)^2) of the switching and linear terms, G2 = lambda j
omega Hv Ht / (j omega)^2 of the equivalent control, F = B / (j omega M) of friction. Slotine and Li, Applied Nonlinear
Control, 1991, chapter 5; Atherton, Nonlinear Control Engineering, 1975.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torquebench.chain import Chain, response
from torquebench.kernel import Array

LINES = 400
"""Frequencies at which the balance is looked for."""
LOWEST = 0.3
"""The lowest of them [rad/s]."""
SWINGS = np.geomspace(1e-2, 1e3, 16)
"""Amplitudes of the velocity at which it is looked for, in speeds at which Coulomb friction is developed [1]."""


class Cycle(NamedTuple):
    """A limit cycle of one joint."""

    frequency: float
    """[Hz]."""
    amplitude: float
    """Of s, (j omega + lambda) times that of the position [rad/s]."""


def saturating(ratio: Array) -> Array:
    """Return the describing function of sat(x) at amplitudes (m,), over its slope: 1 up to an amplitude of 1.

    (2/pi) (asin(1/A) + sqrt(1 - 1/A^2)/A).
    """
    x = 1.0 / np.maximum(ratio, 1.0)
    found: Array = 2.0 / math.pi * (np.arcsin(x) + x * np.sqrt(1.0 - x * x))
    return found


def critical(
    chain: Chain, control_period: float, lam: float, model: Array | float, damping: Array
) -> tuple[Array, Array]:
    """Return the least D/M with which a mode swings for ever, and the angular frequency, (m,) each [1/s], [rad/s].

    Infinite, and NaN, where there is none below half the sampling rate.

    Args:
        chain: Sensors and actuators.
        control_period: Control period T [s].
        lam: Slope lambda [1/s].
        model: The model's inertia of the mode over the true one, (m,) or one for all: 1 where it is right, 0 without.
        damping: B/M of the mode, (m,) [1/s].
    """
    omega = np.geomspace(LOWEST, math.pi / control_period, LINES)
    seen, rate = response(chain, omega, control_period), 1j * omega
    square = rate * rate
    per_gain = (seen.velocity * rate + lam * seen.position) * seen.torque / square
    share = np.broadcast_to(model, damping.shape)[:, None]
    rest = 1.0 + share * lam * rate * seen.velocity * seen.torque / square + damping[:, None] / rate
    needed = -rest / per_gain
    a, b = needed.imag[:, :-1], needed.imag[:, 1:]
    way = np.where(a != b, a / np.where(a != b, a - b, 1.0), 0.0)
    gain = needed.real[:, :-1] + way * np.diff(needed.real, axis=1)
    least = np.where((a * b <= 0.0) & (gain > 0.0), gain, np.inf)
    place = np.argmin(least, axis=1)
    rows = np.arange(len(damping))
    at = omega[place] + way[rows, place] * np.diff(omega)[place]
    found = least[rows, place]
    return found, np.where(np.isfinite(found), at, np.nan)


def relay_cycle(chain: Chain, control_period: float, lam: float, gain: float, model: float = 0.0) -> Cycle | None:
    """Return the limit cycle of K sgn(s) on a joint without friction: A = 4 (K/M) / (pi D/M); None for none.

    Args:
        chain: Sensors and actuators.
        control_period: Control period T [s].
        lam: Slope lambda [1/s].
        gain: K/M [rad/s^2].
        model: As of `critical`.
    """
    (least,), (omega,) = critical(chain, control_period, lam, model, np.zeros(1))
    if not math.isfinite(least):
        return None
    return Cycle(float(omega) / (2.0 * math.pi), 4.0 * gain / (math.pi * float(least)))


def square_wave(mean: Array, frequency: float, corner: float) -> Array:
    """Return the RMS of what a square wave between +-1 of this mean has at `corner` and above; 0 where it has none.

    It is up for a share D = (1 + mean)/2 of its period; its harmonic i has the amplitude 4/(pi i) |sin(pi i D)|.

    Args:
        mean: Mean, within +-1, of any shape [1].
        frequency: Its frequency [Hz].
        corner: Lowest frequency that counts [Hz].
    """
    i = np.arange(1.0, 200.0)
    i = i[i * frequency >= corner]
    up = 0.5 * (1.0 + np.clip(mean, -1.0, 1.0))
    found: Array = np.sqrt(8.0 * np.sum((np.sin(np.pi * np.multiply.outer(up, i)) / i) ** 2, axis=-1)) / np.pi
    return found


class Arm(NamedTuple):
    """An arm at rest, and its friction, whose Coulomb part grows linearly up to a speed."""

    M: Array
    """Mass matrices at poses, (p, n, n) [kg m^2]."""
    viscous: Array
    """Viscous friction, (n,) [N m s/rad]."""
    coulomb: Array
    """Coulomb friction, (n,) [N m]."""
    speed: float
    """Speed from which it is developed [rad/s]."""


def swings(
    arm: Arm, chain: Chain, control_period: float, lam: float, believed: Array, K: Array, phi: Array, Kd: Array
) -> bool:
    """Whether K sat(s/phi) + Kd s has a limit cycle, or grows, in some mode and at some amplitude.

    Each mode of M^-1 D, D = K/phi + Kd, is taken by itself with the friction that its own motion meets; at a velocity
    of amplitude V the friction of a joint is worth viscous + coulomb/speed N(V/speed), and the layer N(A/phi) of
    its slope, with N of `saturating`.

    Args:
        arm: The arm.
        chain: Sensors and actuators.
        control_period: Control period T [s].
        lam: Slope lambda [1/s].
        believed: Mass matrices of the law's model, as of the arm's; zero without one.
        K, phi, Kd: Switching gain [N m], layer [rad/s] and rate gain [N m s/rad], (n,) each.
    """
    D = K / phi + Kd
    root = np.sqrt(D)
    pushed, ways = np.linalg.eigh(root[:, None] * np.linalg.inv(arm.M) * root)
    modes = np.swapaxes(ways, 1, 2)[:, -1] * root  # M v = D v / mu: the stiffest mode at each pose, up to M^-1
    moves = np.linalg.solve(arm.M, modes[..., None])[..., 0]
    weight, share = (np.einsum("pi,pij,pj->p", moves, M, moves) for M in (arm.M, believed))
    has_coulomb = bool(np.any(arm.coulomb > 0.0))
    for move, mass, model, stiff in zip(moves, weight, share / weight, pushed[:, -1], strict=True):
        size = np.abs(move) / np.max(np.abs(move))
        reach = SWINGS if has_coulomb else SWINGS[:1]
        V = reach[:, None] * size * arm.speed
        drag = arm.viscous + arm.coulomb / arm.speed * saturating(V / arm.speed)
        least, omega = critical(chain, control_period, lam, model, (drag * move * move).sum(axis=1) / mass)
        known = np.isfinite(least)
        w = np.where(known, omega, 1.0)[:, None]
        A = V * np.hypot(1.0, lam / w) if has_coulomb else np.zeros_like(V)
        left = (K / phi * saturating(A / phi) + Kd) / D
        acting = stiff * (left * D * move * move).sum(axis=1) / (D * move * move).sum()
        if np.any(known & (acting >= least)):
            return True
    return False
