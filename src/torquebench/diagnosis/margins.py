"""The loop's frequency response along a motion: crossover, phase, gain and delay margin, phase lost to each part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from torquebench.certificates import Phases
from torquebench.chain import Chain, response
from torquebench.experiment.build import Loop
from torquebench.experiment.certify import truth_of
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.references import Reference
from torquebench.robot.flat_model import own_copy
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.interpreted import Call
from torquebench.timing import whole_steps

INSTANTS = 5
"""Instants along the motion at which the loop is linearised."""
LINES = 400
"""Frequencies at which its response is worked out."""
LOWEST_HZ = 0.1
STEPS = (1e-5, 1e-4)
"""Least change of position [rad] and velocity [rad/s] by which a law is differentiated."""
TINY = 1e-9
"""Change of velocity so small that only a law that switches answers it [rad/s]."""
JUMP = 1e-3
"""Share of the torque limit that such an answer must have [1]."""
SMALL = 0.02
"""Share of gravity's torque that a law without gravity may give at no error [1]."""

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Slopes:
    """A law's derivatives at instants along the motion; (m, n, n) and (m, n)."""

    stiffness: Array
    """-d tau_i / d q_j [N m/rad]."""
    damping: Array
    """-d tau_i / d qd_j [N m s/rad]."""
    at_rest: Array
    """Torque at no error and no speed, (m, n) [N m]."""
    jumps: bool
    """Whether the torque jumps where the error is zero."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of the loop of one joint, the others left free, where they are least along the motion."""

    joint: int
    """Number of the joint, from 0."""
    time: float
    """Instant of the motion [s]."""
    frequency: Array
    """Frequencies, (f,) [Hz]."""
    gain: Complex = field(repr=False)
    """Frequency response of the open loop, (f,)."""
    angle: Array = field(repr=False)
    """Its phase, unwrapped, (f,) [degrees]."""
    crossover: float | None
    """Highest frequency at which its size is 1 [Hz]; None where it never is."""
    phase: float | None
    """Phase margin there [degrees]."""
    delay: float | None
    """Further delay that the loop bears [s]; None where it bears none."""
    oscillation: float | None
    """Lowest frequency at which its phase is -180 degrees [Hz]: a loop at its limit oscillates there."""
    factor: float | None
    """Gain margin: times the gain that brings it to that limit [1]."""
    lost: Mapping[str, float]
    """Part of the chain, hold of the control period included -> phase lost to it at the crossover [degrees]."""

    def to_json(self) -> dict[str, object]:
        """Return the numbers, without the curves."""
        return {
            "joint": self.joint + 1,
            "t": self.time,
            "crossover_hz": self.crossover,
            "phase_margin_deg": self.phase,
            "delay_margin_s": self.delay,
            "oscillation_hz": self.oscillation,
            "gain_margin": self.factor,
            "phase_lost_deg": dict(self.lost),
        }


def slopes_of(experiment: Experiment, loop: Loop, by: tuple[Array, Array] | None = None) -> Slopes:
    """Return a law's derivatives along the desired motion, by central differences at no error.

    The law is called as at the start, with an empty memory; so what an integral adds is not in them.

    Args:
        experiment: With one controller.
        loop: Its objects.
        by: Half the change of each joint's position [rad] and velocity [rad/s], (n,); a law that switches has the slope
            that belongs to this amplitude.
    """
    n, controller = experiment.n, loop.controllers[0]
    belief = own_copy(loop.model.flat, control_period=experiment.run.control_period)
    dq, dqd = (np.full(n, least) for least in STEPS) if by is None else map(np.maximum, by, STEPS)

    def torque(k: int, q: Array, qd: Array, moving: bool = True) -> Array:
        call = Call(controller.law, controller.gains, belief, controller.law.new_memory(n))
        ref = Reference(*(signal[k] for signal in loop.reference))
        if not moving:
            ref = Reference(ref.q, np.zeros(n), np.zeros(n))
        tau, status, _ = call(0.0, np.array(q), np.array(qd), ref)
        return tau if status == COMPLETED else np.full(n, np.nan)

    instants = instants_of(experiment)
    stiffness, damping = np.zeros((2, len(instants), n, n))
    rest, jumps = np.zeros((len(instants), n)), False
    limit = np.asarray(loop.plant.tau_max)
    for m, k in enumerate(instants):
        q, qd = loop.reference.q[k], loop.reference.qd[k]
        for j in range(n):
            unit = np.eye(n)[j]
            stiffness[m, :, j] = -(torque(k, q + dq * unit, qd) - torque(k, q - dq * unit, qd)) / (2.0 * dq[j])
            damping[m, :, j] = -(torque(k, q, qd + dqd * unit) - torque(k, q, qd - dqd * unit)) / (2.0 * dqd[j])
            jump = torque(k, q, qd + TINY * unit) - torque(k, q, qd - TINY * unit)
            jumps = jumps or bool(np.any(np.abs(jump) > JUMP * limit))
        rest[m] = torque(k, q, np.zeros(n), moving=False)
    return Slopes(np.nan_to_num(stiffness), np.nan_to_num(damping), np.nan_to_num(rest), jumps)


def instants_of(experiment: Experiment) -> list[int]:
    """Return the control instants at which a loop is looked at, from the start of the metrics' window on."""
    first = min(whole_steps(experiment.run.metrics_from, experiment.run.control_period), experiment.n_steps - 1)
    return sorted(set(np.linspace(first, experiment.n_steps - 1, INSTANTS).astype(int).tolist()))


def weight_along(experiment: Experiment, loop: Loop) -> Array:
    """Return gravity's torque on the true arm at the instants that are looked at, (m, n) [N m]."""
    q = loop.reference.q[instants_of(experiment)]
    truth = truth_of(experiment)
    return np.asarray((truth.later if isinstance(truth, Phases) else truth).bias_forces(q, np.zeros_like(q)))


def leaves_gravity(slopes: Slopes, weight: Array) -> bool:
    """Whether a law gives nothing against gravity while it has no error."""
    heavy = float(np.max(np.abs(weight)))
    return heavy > 0.0 and float(np.max(np.abs(slopes.at_rest))) < SMALL * heavy


def margins_of(experiment: Experiment, loop: Loop, slopes: Slopes) -> Margins | None:
    """Return the margins of the joint, and at the instant, where the phase margin is least; None where none crosses.

    With P = (M s^2 + D s + G)^-1 and what the chain makes of the law, C = H_tau (K H_q + s B H_qd), the open loop of
    joint i is (C P)_ii: the other joints are left free, as they are above their own crossovers.

    Args:
        experiment: With one controller.
        loop: Its objects.
        slopes: The law's derivatives K and B.
    """
    truth, n, period = truth_of(experiment), experiment.n, experiment.run.control_period
    arm = truth.later if isinstance(truth, Phases) else truth
    friction = experiment.plant.acting
    drag = np.zeros(n) if friction is None else as_vector(friction.viscous, n)
    frequency = np.geomspace(LOWEST_HZ, 0.5 / period, LINES)
    seen = response(experiment.chain, 2.0 * math.pi * frequency, period)
    late = seen.torque * seen.position
    worst: Margins | None = None
    for m, k in enumerate(instants_of(experiment)):
        q = loop.reference.q[k]
        M = arm.mass_matrix(q[None])[0]
        near = q + 1e-5 * np.eye(n)
        weight = arm.bias_forces(np.concatenate([near, 2.0 * q - near]), np.zeros((2 * n, n)))
        G = (weight[:n] - weight[n:]).T / 2e-5
        terms = M, np.diag(drag), G, slopes.stiffness[m], slopes.damping[m]
        loops = _open_loops(experiment.chain, period, frequency, *terms)
        for i in range(n):
            found = _margins(i, k * period, frequency, loops[:, i], late)
            if found.phase is not None and (worst is None or worst.phase is None or found.phase < worst.phase):
                worst, kept = found, terms
    if worst is None or worst.crossover is None:
        return worst
    at = np.array([worst.crossover])
    whole = _open_loops(experiment.chain, period, at, *kept)[0, worst.joint]
    lost = {}
    for name, chain in _lesser(experiment.chain).items():
        without = _open_loops(chain, period, at, *kept)[0, worst.joint]
        lost[name] = float(np.degrees(np.angle(without / whole)))
    lost["hold"] = 180.0 * worst.crossover * period
    return replace(worst, lost={name: x for name, x in lost.items() if abs(x) >= 0.05})


def _lesser(chain: Chain) -> dict[str, Chain]:
    """Return the chain without each of its parts that cost phase."""
    bare: dict[str, dict[str, object]] = {
        key: {key: 0.0}
        for key in ("measurement_delay", "command_delay", "torque_delay", "actuator_lag", "jitter", "missed_deadlines")
        if getattr(chain, key) > 0.0
    }
    if chain.current_loop is not None:
        bare["current_loop"] = {"current_loop": None}
    if chain.velocity != "exact":
        bare["velocity"] = {
            "velocity": "exact",
            "velocity_filter": None,
            "velocity_noise": 0.0,
            "kalman_acceleration": None,
        }
    return {name: replace(chain, **keys) for name, keys in bare.items()}  # type: ignore[arg-type]


def _open_loops(
    chain: Chain, period: float, frequency: Array, M: Array, D: Array, G: Array, K: Array, B: Array
) -> Complex:
    """Return the open loop of each joint with the others left free, (f, n).

    Args:
        chain: Sensors and actuators.
        period: Control period [s].
        frequency: Frequencies, (f,) [Hz].
        M, D, G: Inertia, viscous friction, and stiffness of gravity, (n, n).
        K, B: The law's stiffness and damping, (n, n).
    """
    omega = 2.0 * math.pi * frequency
    seen, s = response(chain, omega, period), (1j * omega)[:, None, None]
    P = np.linalg.inv(M * s**2 + D * s + G)
    C = seen.torque[:, None, None] * (K * seen.position[:, None, None] + s * B * seen.velocity[:, None, None])
    own: Complex = np.diagonal(C @ P, axis1=1, axis2=2)
    return own


def _margins(joint: int, time: float, frequency: Array, gain: Complex, late: Complex) -> Margins:
    """Return the margins of one open loop.

    Args:
        joint, time: As of `Margins`.
        frequency: Frequencies, (f,) [Hz].
        gain: The open loop, (f,).
        late: What is in it of the chain's delays and lags, (f,): their phase is counted from zero on, the rest's from
            -270 to 90 degrees.
    """
    size, rest = np.abs(gain), np.angle(gain / late)
    angle = np.unwrap(np.angle(late)) + np.where(rest > 0.5 * math.pi, rest - 2.0 * math.pi, rest)
    falls = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
    crossover = phase = delay = oscillation = factor = None
    if len(falls):
        at = int(falls[-1])
        share = math.log(size[at]) / math.log(size[at] / size[at + 1])
        crossover = float(frequency[at] * (frequency[at + 1] / frequency[at]) ** share)
        phase = 180.0 + math.degrees(angle[at] + share * (angle[at + 1] - angle[at]))
        delay = phase / 360.0 / crossover if phase > 0.0 else None
    turns = np.flatnonzero((angle[:-1] > -math.pi) & (angle[1:] <= -math.pi))
    if len(turns):
        at = int(turns[0])
        share = (angle[at] + math.pi) / (angle[at] - angle[at + 1])
        oscillation = float(frequency[at] * (frequency[at + 1] / frequency[at]) ** share)
        factor = 1.0 / float(size[at] * (size[at + 1] / size[at]) ** share)
    return Margins(joint, time, frequency, gain, np.degrees(angle), crossover, phase, delay, oscillation, factor, {})


def torque_noise(experiment: Experiment, slopes: Slopes) -> Array:
    """Return the torque that sensor noise makes through a law's gains, its RMS, (n,) [N m].

    The mean over frequencies up to half the sampling rate of |K + s B H|^2 sigma^2, joint by joint; a tachometer's
    noise meets B alone.

    Args:
        experiment: The experiment.
        slopes: The law's derivatives.
    """
    chain, period = experiment.chain, experiment.run.control_period
    omega: Array = (np.arange(LINES, dtype=np.float64) + 0.5) * math.pi / (LINES * period)
    seen = response(chain, omega, period)
    K = np.max(np.abs(np.diagonal(slopes.stiffness, axis1=1, axis2=2)), axis=0)
    B = np.max(np.abs(np.diagonal(slopes.damping, axis1=1, axis2=2)), axis=0)
    of_position = K[None] * seen.position[:, None]
    of_rate = B[None] * seen.velocity[:, None]
    if chain.velocity in ("differentiated", "kalman"):
        of_position = of_position + 1j * omega[:, None] * of_rate
    power = np.mean(np.abs(of_position) ** 2, axis=0) * chain.position_noise**2
    if chain.velocity == "tachometer":
        power = power + np.mean(np.abs(of_rate) ** 2, axis=0) * chain.velocity_noise**2
    return np.asarray(np.sqrt(power))
