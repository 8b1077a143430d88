"""Poles of the sampled loop about rest: what swings or grows too slowly for a short run to show it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torquebench.chain import Chain
from torquebench.chain.sensors import kalman_gains
from torquebench.diagnosis.margins import Slopes, Terms, instants_of, terms_at
from torquebench.experiment.build import Loop
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array


class Pole(NamedTuple):
    """A motion of the loop by itself, exp(rate t) cos(2 pi frequency t)."""

    rate: float
    """Negative where it dies away [1/s]."""
    frequency: float
    """Zero where it does not swing [Hz]."""
    joint: int
    """Number of the joint that moves most in it, from 0."""


def poles_of(experiment: Experiment, loop: Loop, slopes: Slopes, m: int = 0) -> list[Pole]:
    """Return the poles of the loop of all joints at an instant of the desired motion, the fastest growing first.

    The state is taken from one control instant to the next, in closed form: arm and drives are linear between two, the
    law and the velocity's filter linear at each. All that makes a torque late, and measurements, is one delay, for
    they commute; a command that is drawn late or missed is late by its mean.

    Args:
        experiment: With one controller.
        loop: Its objects.
        slopes: The law's derivatives.
        m: Number of the instant, of those of the slopes.
    """
    terms = terms_at(experiment, loop, slopes, m, instants_of(experiment)[m])
    step = _step(experiment.chain, experiment.run.control_period, terms)
    values, ways = np.linalg.eig(step)
    n, found = experiment.n, list[Pole]()
    for i in np.argsort(-np.abs(values)):
        if values[i].imag >= 0.0 and abs(values[i]) > 1e-9:
            s = np.log(complex(values[i])) / experiment.run.control_period
            found.append(Pole(float(s.real), float(s.imag) / math.tau, int(np.argmax(np.abs(ways[:n, i])))))
    return found


def _step(chain: Chain, T: float, terms: Terms) -> Array:
    """Return the matrix that takes the state of a loop to the next control instant; its first rows are measured.

    Args:
        chain: Sensors and actuators.
        T: Control period [s].
        terms: What the loop is made of.
    """
    from scipy.linalg import expm

    n = len(terms.M)
    late = chain.command_delay + chain.torque_delay + chain.measurement_delay + chain.lateness(T)
    whole = int(late / T + 1e-9)
    rest = max(late - whole * T, 0.0)
    between = _between(chain, terms)
    # what moves between instants; then position and velocity as last seen, the sums of both, and commands, latest first
    sizes = [len(between) - n, *[n] * (5 + whole)]
    x, before, velocity, summed, summed_rate, *torques = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    q, qd = x[:n], x[n if terms.joints is None else 2 * n :][:n]
    seen = q
    if chain.velocity == "exact":
        velocity = qd
    elif chain.velocity == "kalman" and chain.kalman_acceleration is not None:
        alpha, beta = kalman_gains(chain.kalman_acceleration, chain.position_noise, T)
        residual = q - before - T * velocity
        seen = q - (1.0 - alpha) * residual  # the filter's own position
        velocity = velocity + beta / T * residual
    else:
        rate = qd if chain.velocity == "tachometer" else (q - before) / T
        velocity = velocity + chain.velocity_gain(T) * (rate - velocity)
    torque = -terms.drives @ (terms.K @ q + terms.I @ summed + terms.B @ velocity + terms.J @ summed_rate)
    taken = chain.command_gain(T)
    torque = (1.0 - taken) * torques[0] + taken * torque
    torques = [torque, *torques]
    for time, acting in ((rest, torques[whole + 1]), (T - rest, torques[whole])):
        moved = expm(time * between)[:-n]
        x = moved[:, :-n] @ x + moved[:, -n:] @ acting
    return np.vstack([x, seen, velocity, summed + T * q, summed_rate + T * velocity, *torques[:-1]])


def _between(chain: Chain, terms: Terms) -> Array:
    """Return the rates of arm and drives between two instants, the commands in force last and at rest.

    Args:
        chain: Sensors and actuators.
        terms: What the loop is made of.
    """
    n, joints, M, D, G = len(terms.M), terms.joints, terms.M, terms.D, terms.G
    driven = np.eye(n)
    if joints is not None:
        none, k, d = np.zeros((n, n)), np.diag(joints.stiffness), np.diag(joints.damping)
        M = np.block([[M, none], [none, np.diag(joints.inertia)]])
        D = np.block([[d, -d], [-d, d + D]])
        G = np.block([[G + k, -k], [-k, k]])
        driven = np.vstack([none, driven])
        if not terms.on_link:  # what is measured comes first
            swap = np.roll(np.arange(2 * n), n)
            M, D, G, driven = M[np.ix_(swap, swap)], D[np.ix_(swap, swap)], G[np.ix_(swap, swap)], driven[swap]
    N, drive = len(M), chain.current_loop
    order = 2 if drive is not None else 1 if chain.actuator_lag > 0.0 else 0
    A = np.zeros((2 * N + (order + 1) * n,) * 2)
    A[:N, N : 2 * N] = np.eye(N)
    A[N : 2 * N] = np.linalg.solve(M, np.hstack([-G, -D, driven, np.zeros((N, order * n))]))
    acting = slice(2 * N, 2 * N + n)
    if drive is not None:
        w, rising = drive.frequency, slice(2 * N + n, 2 * N + 2 * n)
        A[acting, rising] = np.eye(n)
        A[rising] = np.hstack(
            [np.zeros((n, 2 * N)), *(x * np.eye(n) for x in (-w * w, -2.0 * drive.damping * w, w * w))]
        )
    elif order:
        A[acting, acting], A[acting, -n:] = -np.eye(n) / chain.actuator_lag, np.eye(n) / chain.actuator_lag
    return A
